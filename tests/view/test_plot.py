from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest

import gpszip
from gpszip.cli.plot import _KINDS, _WIDTH
from gpszip.drawing.style import COLUMN_WIDTH, PAGE_WIDTH, style
from gpszip.errors import OptionError, OutputError, UnknownTrackError
from gpszip.view.plot import PLOT_KINDS, plot
from view_logs import LAPS, laps_archive

NAMES = [each.name for each in PLOT_KINDS]


@pytest.mark.parametrize("kind", NAMES)
def test_every_kind_is_written(tmp_path, kind):
    plot(laps_archive(), tmp_path / "a.pdf", kind=kind, raw=LAPS)
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize("kind", NAMES)
@pytest.mark.parametrize("width", [60.0, 85.0, 175.0])
def test_all_texts_are_inside_of_the_picture(kind, width):
    with style():
        figure = plot(laps_archive(), kind=kind, raw=LAPS, width=width, title="Laps")
        figure.draw_without_rendering()
        drawn, size = figure.get_tightbbox(), figure.get_size_inches()
    assert (drawn.min > -0.01).all()
    assert (drawn.max < size + 0.01).all()


@pytest.mark.parametrize("kind", NAMES)
def test_a_picture_without_legend_has_less_text(kind):
    def count(legend):
        figure = plot(laps_archive(), kind=kind, raw=LAPS, legend=legend)
        return len(figure.texts) + len(figure.legends) + sum(len(a.texts) for a in figure.axes)

    if kind != "space-time":  # the name of the only track is not written
        assert count(False) < count(True)


def test_choices_of_the_command_line_are_those_of_the_table():
    assert list(_KINDS) == NAMES
    assert (_WIDTH.parse("column"), _WIDTH.parse("page")) == (COLUMN_WIDTH, PAGE_WIDTH)
    assert _WIDTH.parse("8.5cm") == pytest.approx(85.0)


def test_the_map_is_the_default():
    assert NAMES[0] == "map"
    assert any(item.get_gid() == "map" for item in gpszip.plot(laps_archive()).axes[0].collections)


def test_archives_are_taken_as_files_and_bytes(tmp_path):
    laps_archive().save(tmp_path / "laps.gpsz")
    data = laps_archive().to_bytes()
    for source in (tmp_path / "laps.gpsz", str(tmp_path / "laps.gpsz"), data, BytesIO(data)):
        assert plot(source, kind="segments").axes


def test_no_archive_is_refused():
    with pytest.raises(OptionError, match="no archive"):
        plot([], kind="rate")


def test_an_unknown_kind_names_the_others():
    with pytest.raises(OptionError, match=r"'pie' of pictures; there are map, segments, space-t"):
        plot(laps_archive(), kind="pie")


def test_one_picture_shows_one_archive():
    with pytest.raises(OptionError, match=r"map shows one archive, not 2; .*rate compares several"):
        plot([laps_archive(), laps_archive()])


def test_errors_need_the_log():
    with pytest.raises(OptionError, match="--raw, in Python raw="):
        plot(laps_archive(), kind="error")


@pytest.mark.parametrize("kind", ["error", "space-time"])
def test_kinds_over_time_need_times(kind):
    shape = gpszip.compress(LAPS, max_error=1.0, times=False, effort=1)
    with pytest.raises(OptionError, match=f"no times, so no picture of the kind {kind}"):
        plot(shape, kind=kind, raw=LAPS)


def test_a_log_of_another_kind_is_refused():
    heights = np.column_stack([LAPS.positions, LAPS.times])
    flight = gpszip.Track("laps", LAPS.times, heights)
    with pytest.raises(
        OptionError, match="track 'laps': the log is in x, y, z, the archive in x, y"
    ):
        plot(laps_archive(), raw=flight)


def test_a_log_of_other_times_is_refused():
    later = gpszip.Track("laps", LAPS.times + 1e6, LAPS.positions)
    with pytest.raises(OptionError, match="cover no sample"):
        plot(laps_archive(), kind="error", raw=later)


def test_a_log_of_other_tracks_is_refused():
    with pytest.raises(UnknownTrackError, match="stranger"):
        plot(
            laps_archive(),
            kind="error",
            raw=gpszip.Track("stranger", LAPS.times, LAPS.positions),
        )


def test_an_unknown_suffix_is_refused_and_nothing_written(tmp_path):
    with pytest.raises(OutputError, match=r"\.png, \.svg, \.pdf"):
        plot(laps_archive(), tmp_path / "map.tif")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a$b$", "$\\broken{", "<b>&", "tab\there\x00"])
def test_names_are_written_letter_by_letter(tmp_path, name):
    tracks = [gpszip.Track(each, LAPS.times, LAPS.positions) for each in (name, "other")]
    archive = gpszip.compress(tracks, max_error=0.5, effort=1)
    plot(archive, tmp_path / "a.svg", kind="space-time", title=f"Tracks of {name}")
    texts = {element.text for element in ElementTree.parse(tmp_path / "a.svg").iter()}
    shown = name.replace("\t", "\ufffd").replace("\x00", "\ufffd")
    assert {f" {shown}", f"Tracks of {shown}"} <= texts
