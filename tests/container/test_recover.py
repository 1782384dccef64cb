import io
from dataclasses import replace

import pytest

from gpszip.container.catalog import open_catalog
from gpszip.container.contents import Section
from gpszip.container.reader import from_bytes
from gpszip.container.recover import recover, recover_bytes
from gpszip.container.verify import verify, verify_bytes
from gpszip.container.writer import to_bytes
from gpszip.errors import CorruptArchiveError, InputError
from gpszip.model.error_bound import ErrorBound
from oracle import archives
from oracle.archives import section

WHOLE = archives.several()
DATA = to_bytes(WHOLE)


def _without(number):
    report = [report for report in verify_bytes(DATA).sections if report.kind == "walks"][number]
    torn = bytearray(DATA)
    torn[report.offset + 12] ^= 0xFF
    return bytes(torn)


def test_whole_archive_loses_nothing():
    assert recover_bytes(DATA).contents == WHOLE
    assert recover_bytes(DATA).lost == ()


@pytest.mark.parametrize("number", range(3))
def test_other_groups_are_saved(number):
    saved = recover_bytes(_without(number))
    assert [group.payload for group in saved.contents.groups] == [
        group.payload for i, group in enumerate(WHOLE.groups) if i != number
    ]
    lost = range(
        WHOLE.groups[number].first_track,
        WHOLE.groups[number].first_track + WHOLE.groups[number].tracks,
    )
    assert saved.contents.ids == tuple(name for i, name in enumerate(WHOLE.ids) if i not in lost)
    assert f"{len(lost)} of 6 tracks" in saved.lost
    assert from_bytes(to_bytes(saved.contents)) == saved.contents


def test_kept_columns_are_not_given_to_the_wrong_tracks():
    extras = (Section(5, b"columns"), Section(77, b"of later"))
    data = bytearray(to_bytes(replace(WHOLE, extras=extras)))
    assert recover_bytes(bytes(data)).contents.extras == extras
    data[
        next(report.offset for report in verify_bytes(data).sections if report.kind == "walks") + 12
    ] ^= 0xFF
    saved = recover_bytes(bytes(data))
    assert saved.contents.extras == extras[1:]
    assert any("kept columns" in sentence for sentence in saved.lost)


@pytest.mark.parametrize("maximum", [True, False])
def test_a_promise_about_all_tracks_is_not_one_about_some(maximum):
    error_bound = ErrorBound(5, 0, maximum)
    data = bytearray(to_bytes(replace(WHOLE, error_bound=error_bound, sampling=99)))
    assert recover_bytes(bytes(data)).contents.error_bound == error_bound
    data[
        next(report.offset for report in verify_bytes(data).sections if report.kind == "walks") + 12
    ] ^= 0xFF
    saved = recover_bytes(bytes(data))
    assert saved.contents.error_bound == (error_bound if maximum else None)
    assert saved.contents.sampling == 99
    assert any("error promised" in sentence for sentence in saved.lost) != maximum


def test_every_truncation_saves_the_whole_groups_before_it():
    ends = [
        report.offset + report.size
        for report in verify_bytes(DATA).sections
        if report.kind == "walks"
    ]
    for length in range(len(DATA)):
        whole = sum(end <= length for end in ends)
        try:
            saved = recover_bytes(DATA[:length])
        except CorruptArchiveError:
            assert whole == 0
        else:
            assert len(saved.contents.groups) == whole
            assert saved.lost


def test_hole_in_the_middle_and_lost_names():
    start = DATA.index(b"\xa7SEC\x02")
    saved = recover_bytes(DATA[:start] + bytes(50) + DATA[start + 10 :])
    assert saved.contents.ids == ("0", "1", "2", "3", "4", "5")
    assert saved.contents.groups == WHOLE.groups
    assert any("names" in sentence for sentence in saved.lost)


def test_without_frame_or_in_one_piece_nothing_is_saved():
    with pytest.raises(CorruptArchiveError, match="frame is lost"):
        recover_bytes(DATA.replace(b"\xa7SEC\x01", b"\xa7SEC\x11", 1))
    for name in ("lone", "small"):
        with pytest.raises(CorruptArchiveError):
            recover_bytes(to_bytes(archives.small_archives()[name])[:-1])


def test_sections_within_sections_take_bounded_work():
    # each marker opens a section that claims to reach the end, so that all its bytes are summed up in vain
    size = 400_000
    hollow = b"\xa7SEC\x03" + archives.number(size) + b"\0"
    data = b"\xa7Z\x1a" + section(1, b"\x10\1\1\0\0\0") + hollow * (2 * size // len(hollow))
    with pytest.raises(CorruptArchiveError, match="walks are lost"):
        recover_bytes(data)


def test_files(tmp_path):
    path = tmp_path / "a.gpsz"
    path.write_bytes(DATA)
    assert verify(path).ok
    assert recover(path).contents == WHOLE
    assert (verify(path).tracks, verify(path).groups, verify(path).form) == (6, 3, "large")
    for read in (verify, recover):
        with pytest.raises(InputError, match="no such file"):
            read(tmp_path / "b.gpsz")
        with pytest.raises(InputError, match="is a folder"):
            read(tmp_path)


def test_verdict_of_a_torn_archive_lists_what_is_whole():
    verdict = verify_bytes(_without(1))
    assert not verdict.ok
    assert [report.kind for report in verdict.sections].count("walks") == 2
    assert verdict.offset == open_catalog(io.BytesIO(DATA)).entries[1].offset
