"""How far a journal has been read for events."""

import pytest

from gpszip.errors import InputError
from gpszip.live.place_read import PlaceRead, read_place, state_path


def test_a_place_comes_back_from_the_first_line_of_the_state(tmp_path):
    assert read_place(tmp_path) is None
    place = PlaceRead(3, 700)
    state_path(tmp_path).write_text(f"{place.to_json()}\nand what the monitor knows\n")
    assert read_place(tmp_path) == place


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('{"version":1,"segment":3,"offset":700}\n', "read: it has version 1, and this GPSZip"),
        ('{"version":2,"segm', "read"),
        ('{"version":2,"segment":3}\n', "read"),
        ('{"version":2,"segment":null,"offset":7}\n', "read"),
        ("[]\n", "read"),
        ("", "read"),
    ],
)
def test_a_state_of_another_version_and_a_torn_one_are_refused(tmp_path, text, reason):
    state_path(tmp_path).write_text(text)
    with pytest.raises(InputError, match=f"the state of the monitor can't be {reason}") as error:
        read_place(tmp_path)
    assert error.value.path == str(state_path(tmp_path))
    assert error.value.remedy == "remove the file; the journal is then read from its start"
