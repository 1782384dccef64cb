import io

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.write import write_tracks
from gpszip.model import Track
from random_tests import examples

NAMES = st.text(
    st.one_of(
        st.characters(codec="utf-8", exclude_categories=["Cc"]), st.sampled_from('\t\n\r,;"')
    ),
    max_size=12,
)
MILLIMETRES = st.integers(-(10**10), 10**10)


@st.composite
def logs(draw):
    d = draw(st.integers(2, 3))
    names = draw(st.lists(NAMES, min_size=1, max_size=4, unique=True))
    tracks = []
    for name in names:
        milliseconds = draw(
            st.lists(st.integers(-(10**12), 3 * 10**12), min_size=1, max_size=8, unique=True)
        )
        positions = draw(
            st.lists(
                st.tuples(*[MILLIMETRES] * d),
                min_size=len(milliseconds),
                max_size=len(milliseconds),
            )
        )
        tracks.append(
            Track(name, np.array(sorted(milliseconds)) / 1000, np.array(positions) / 1000)
        )
    return tracks


@examples(60)
@given(logs(), st.sampled_from(["csv", "parquet", "geojson"]))
def test_what_is_written_is_read_again(tracks, format_):
    stream = io.BytesIO()
    write_tracks(tracks, stream, format_)
    reading = read_logs(io.BytesIO(stream.getvalue()), time_unit="s")
    assert [(t.id, t.times.tolist(), t.positions.tolist()) for t in reading.tracks] == [
        (t.id, t.times.tolist(), t.positions.tolist()) for t in tracks
    ]
    assert reading.points == sum(map(len, tracks))


CELLS = st.one_of(st.integers(-5, 5).map(str), st.sampled_from(["", "x", "nan", "1e400", "5", "5"]))


@examples(100)
@given(
    st.lists(st.lists(CELLS, min_size=2, max_size=5), min_size=1, max_size=30),
    st.sampled_from([{"sort": True}, {"split": True}, {}]),
)
def test_every_row_is_in_a_track_or_counted(rows, options):
    text = "track_id,t,x,y\n" + "".join(",".join(row) + "\n" for row in rows)
    try:
        reading = read_logs(io.BytesIO(text.encode()), **options)
    except InputError as error:
        assert "\n" not in str(error)
        return
    assert reading.points == reading.kept + reading.lost == len(rows)


@examples(200)
@given(
    st.binary(max_size=200),
    st.sampled_from(
        [b"", b"{", b"<gpx ", b"PAR1", b"t,x,y\n", b"\x1f\x8b", b"\xff\xfe", b"0,1,2\n"]
    ),
)
def test_junk_is_refused_with_one_line(junk, start):
    try:
        read_logs(io.BytesIO(start + junk))
    except InputError as error:
        assert "\n" not in str(error)
