import builtins

import matplotlib
import pytest

from gpszip.drawing.style import Layout, new_figure, picture_format, save_figure, style
from gpszip.errors import MissingExtraError, OptionError, OutputError


def labelled_figure():
    with style():
        figure = new_figure(60.0, 40.0)
        figure.text(0.5, 0.5, "a label")
    return figure


@pytest.mark.parametrize(
    ("kind", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")]
)
def test_files_have_their_format_and_the_same_bytes_each_time(tmp_path, kind, start):
    for name in ("one", "two"):
        save_figure(labelled_figure(), tmp_path / name, kind)
    first = (tmp_path / "one").read_bytes()
    assert first.startswith(start)
    assert first == (tmp_path / "two").read_bytes()


def test_a_png_has_the_size_of_its_page(tmp_path):
    save_figure(labelled_figure(), tmp_path / "a.png", "png", 254)
    header = (tmp_path / "a.png").read_bytes()[16:24]
    assert (int.from_bytes(header[:4]), int.from_bytes(header[4:])) == (600, 400)


def test_text_is_text_in_svg_and_fonts_are_in_pdf(tmp_path):
    save_figure(labelled_figure(), tmp_path / "a.svg", "svg")
    save_figure(labelled_figure(), tmp_path / "a.pdf", "pdf")
    assert ">a label</text>" in (tmp_path / "a.svg").read_text()
    assert b"/FontFile2" in (tmp_path / "a.pdf").read_bytes()


def test_settings_of_the_user_stay_and_do_not_show(tmp_path):
    save_figure(labelled_figure(), tmp_path / "one.svg", "svg")
    with matplotlib.rc_context({"font.size": 30, "svg.fonttype": "path"}):
        save_figure(labelled_figure(), tmp_path / "two.svg", "svg")
        assert matplotlib.rcParams["font.size"] == 30
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


def test_the_suffix_chooses_the_format():
    assert [picture_format(name) for name in ("a.PNG", "b.svg", "c.d.pdf", "-")] == [
        "png",
        "svg",
        "pdf",
        "png",
    ]
    with pytest.raises(OutputError, match=r"map\.jpg: .*end it with one of \.png, \.svg, \.pdf"):
        picture_format("map.jpg")


@pytest.mark.parametrize("width", [0.0, -5.0, 59.0, 2000.0, float("nan"), float("inf")])
def test_widths_that_no_picture_has_are_refused(width):
    with pytest.raises(OptionError, match="from 60 to 1000 mm"):
        Layout(width)


@pytest.mark.parametrize("dpi", [0, 49, 1201])
def test_resolutions_that_no_picture_has_are_refused(tmp_path, dpi):
    with pytest.raises(OptionError, match="from 50 to 1200"):
        save_figure(labelled_figure(), tmp_path / "a.png", "png", dpi)


def test_missing_matplotlib_names_the_extra(monkeypatch):
    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    with pytest.raises(MissingExtraError, match=r"gpszip\[plot\]"), style():
        pass
