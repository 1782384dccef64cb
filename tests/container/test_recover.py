import io
from dataclasses import replace

import pytest

from gpszip.container.catalog import open_catalog
from gpszip.container.contents import Section
from gpszip.container.layout import SectionKind
from gpszip.container.reader import from_bytes
from gpszip.container.recover import recover, recover_bytes
from gpszip.container.verify import verify, verify_bytes
from gpszip.container.writer import to_bytes
from gpszip.errors import CorruptArchiveError, InputError
from gpszip.model.error_bound import ErrorBound, rounded_bounds
from oracle import archives
from oracle.archives import section

ORIGINAL = archives.several()
DATA = to_bytes(ORIGINAL)


def _without(number):
    report = [report for report in verify_bytes(DATA).sections if report.kind == "walks"][number]
    damaged = bytearray(DATA)
    damaged[report.offset + 12] ^= 0xFF
    return bytes(damaged)


def test_an_intact_archive_loses_nothing():
    assert recover_bytes(DATA).contents == ORIGINAL
    assert recover_bytes(DATA).lost == ()


@pytest.mark.parametrize("number", range(3))
def test_other_groups_are_saved(number):
    saved = recover_bytes(_without(number))
    assert [group.payload for group in saved.contents.groups] == [
        group.payload for i, group in enumerate(ORIGINAL.groups) if i != number
    ]
    lost = range(
        ORIGINAL.groups[number].first_track,
        ORIGINAL.groups[number].first_track + ORIGINAL.groups[number].tracks,
    )
    assert saved.contents.ids == tuple(name for i, name in enumerate(ORIGINAL.ids) if i not in lost)
    assert f"{len(lost)} of 6 tracks" in saved.lost
    assert from_bytes(to_bytes(saved.contents)) == saved.contents


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (SectionKind.ATTRIBUTES, "kept columns and times of samples, as"),
        (SectionKind.CODED_ATTRIBUTES, "kept columns and times of samples, as"),
        (SectionKind.CURVES, "columns kept within an error, as"),
        (SectionKind.SHORT_CURVES, "columns kept within an error, as"),
    ],
)
def test_kept_columns_are_lost_with_any_track(kind, said):
    extras = (Section(kind, b"columns"), Section(77, b"of later"))
    data = bytearray(to_bytes(replace(ORIGINAL, extras=extras)))
    assert recover_bytes(bytes(data)).contents.extras == extras
    data[
        next(report.offset for report in verify_bytes(data).sections if report.kind == "walks") + 12
    ] ^= 0xFF
    saved = recover_bytes(bytes(data))
    assert saved.contents.extras == extras[1:]
    assert any(sentence.startswith(said) for sentence in saved.lost)


@pytest.mark.parametrize("lost", ["walks", "names"])
def test_logs_that_walks_predict_are_lost_with_any_walk_or_name(lost):
    extras = tuple(Section(SectionKind.GUIDED_LOGS, body) for body in (b"\1logs", b"\0alone"))
    data = bytearray(to_bytes(replace(ORIGINAL, extras=extras)))
    assert recover_bytes(bytes(data)).contents.extras == extras
    report = next(report for report in verify_bytes(data).sections if report.kind == lost)
    data[report.offset + report.size - 1] ^= 0xFF
    saved = recover_bytes(bytes(data))
    assert saved.contents.extras == extras[1:]
    assert any(sentence.startswith("logs kept byte by byte") for sentence in saved.lost)


@pytest.mark.parametrize("kind", [SectionKind.ATTRIBUTES, SectionKind.CURVES])
def test_kept_columns_are_saved_with_all_tracks(kind):
    extras = (Section(kind, b"columns"),)
    data = to_bytes(replace(ORIGINAL, extras=extras))
    assert recover_bytes(data[:-1]).contents.extras == extras


@pytest.mark.parametrize("maximum", [True, False])
def test_a_mean_error_bound_is_lost_with_any_track(maximum):
    error_bound = ErrorBound(5, 0, maximum)
    data = bytearray(to_bytes(replace(ORIGINAL, error_bound=error_bound, sampling=99)))
    assert recover_bytes(bytes(data)).contents.error_bound == error_bound
    data[
        next(report.offset for report in verify_bytes(data).sections if report.kind == "walks") + 12
    ] ^= 0xFF
    saved = recover_bytes(bytes(data))
    assert saved.contents.error_bound == (error_bound if maximum else None)
    assert saved.contents.sampling == 99
    assert any("error bound" in sentence for sentence in saved.lost) != maximum


@pytest.mark.parametrize(
    ("both", "metres", "said"),
    [
        (rounded_bounds(3.0, 12.0), 12.0, "; maximum <= 12 m still holds"),
        (rounded_bounds(5e-8, 7e-6), 7e-6, "; maximum <= 7e-06 m still holds"),
        (ErrorBound(999, 6, maximum=False, max_digits=999, max_exponent=9), None, ""),
    ],
)
def test_a_maximum_beside_a_mean_still_holds_for_the_tracks_that_are_left(both, metres, said):
    data = bytearray(to_bytes(replace(ORIGINAL, error_bound=both, sampling=99)))
    assert recover_bytes(bytes(data)).contents.error_bound == both
    data[
        next(report.offset for report in verify_bytes(data).sections if report.kind == "walks") + 12
    ] ^= 0xFF
    saved = recover_bytes(bytes(data))
    bound = saved.contents.error_bound
    assert (bound and (bound.metres, bound.maximum)) == (metres and (metres, True))
    assert saved.contents.sampling == 99
    assert f"the bound of the RMSE, which is one of all tracks together{said}" in saved.lost
    assert from_bytes(to_bytes(saved.contents)) == saved.contents


def test_every_truncation_saves_the_groups_before_it():
    ends = [
        report.offset + report.size
        for report in verify_bytes(DATA).sections
        if report.kind == "walks"
    ]
    for length in range(len(DATA)):
        intact = sum(end <= length for end in ends)
        try:
            saved = recover_bytes(DATA[:length])
        except CorruptArchiveError:
            assert intact == 0
        else:
            assert len(saved.contents.groups) == intact
            assert saved.lost


def test_lost_names_are_replaced_by_numbers():
    start = DATA.index(b"\xa7SEC\x02")
    saved = recover_bytes(DATA[:start] + bytes(50) + DATA[start + 10 :])
    assert saved.contents.ids == ("0", "1", "2", "3", "4", "5")
    assert saved.contents.groups == ORIGINAL.groups
    assert any("names" in sentence for sentence in saved.lost)


def test_without_grid_or_with_one_checksum_nothing_is_saved():
    with pytest.raises(CorruptArchiveError, match="grid is lost"):
        recover_bytes(DATA.replace(b"\xa7SEC\x01", b"\xa7SEC\x11", 1))
    for name in ("lone", "small"):
        with pytest.raises(CorruptArchiveError):
            recover_bytes(to_bytes(archives.small_archives()[name])[:-1])


def test_sections_within_sections_take_bounded_work():
    # each marker opens a section that claims to reach the end, so that its checksum is wrong
    size = 400_000
    nested = b"\xa7SEC\x03" + archives.number(size) + b"\0"
    data = b"\xa7Z\x1a" + section(1, b"\x10\1\1\0\0\0") + nested * (2 * size // len(nested))
    with pytest.raises(CorruptArchiveError, match="walks are lost"):
        recover_bytes(data)


def test_files(tmp_path):
    path = tmp_path / "a.gpsz"
    path.write_bytes(DATA)
    assert verify(path).ok
    assert recover(path).contents == ORIGINAL
    assert (verify(path).tracks, verify(path).groups, verify(path).form) == (6, 3, "large")
    for read in (verify, recover):
        with pytest.raises(InputError, match="no such file"):
            read(tmp_path / "b.gpsz")
        with pytest.raises(InputError, match="is a folder"):
            read(tmp_path)


def test_the_verdict_on_a_damaged_archive_lists_intact_sections():
    verdict = verify_bytes(_without(1))
    assert not verdict.ok
    assert [report.kind for report in verdict.sections].count("walks") == 2
    assert verdict.offset == open_catalog(io.BytesIO(DATA)).entries[1].offset
