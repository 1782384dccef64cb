import builtins
import json
from pathlib import Path

import pytest

KINDS = ("map", "segments", "space-time", "error", "rate", "heat")


@pytest.fixture
def walk(gpszip, log):
    done = gpszip("compress walk.csv -o walk.gpsz --max-error 1m --effort 1")
    assert done.code == 0, done.err
    return log


def test_a_picture_is_drawn_as_a_user_does(walk, shell):
    done = shell("plot walk.gpsz --raw walk.csv -o walk.svg --width column --title", "Two rounds")
    assert done.returncode == 0, done.stderr
    assert done.stdout == b""
    assert done.stderr.decode().startswith("walk.svg: map, 85 x ")
    picture = walk.with_name("walk.svg").read_text()
    assert all(f">{text}</text>" in picture for text in ("Two rounds", "200 points", "5 m"))


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_drawn(walk, gpszip, kind):
    done = gpszip("plot walk.gpsz --raw walk.csv -o out.png --dpi 60 --json --kind", kind)
    assert done.code == 0, done.err
    assert (done.json["kind"], done.json["width_mm"]) == (kind, 175.0)
    assert (done.json["output"], done.json["points_read"]) == ("out.png", 200)
    assert Path("out.png").read_bytes().startswith(b"\x89PNG")


def test_standard_output_is_a_png(archive, shell):
    done = shell("plot two.gpsz -o -")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"\x89PNG")


def test_several_archives_are_compared(walk, gpszip):
    gpszip("compress walk.csv -o coarse.gpsz --max-error 9m --effort 1")
    done = gpszip("plot walk.gpsz coarse.gpsz --kind rate -o rate.svg --no-legend")
    assert done.code == 0, done.err
    assert ">coarse</text>" not in Path("rate.svg").read_text()
    gpszip("plot walk.gpsz coarse.gpsz --kind rate -o rate.svg --force")
    assert ">coarse</text>" in Path("rate.svg").read_text()


def test_a_log_that_lost_points_says_so(walk, gpszip):
    with walk.open("a") as file:
        file.write("".join(f"{t},,\n" for t in range(1000, 1100)))
    done = gpszip("plot walk.gpsz --raw walk.csv -o out.pdf")
    assert done.code == 3
    assert done.err.startswith("gpszip: lost 100 of 300 points")
    assert Path("out.pdf").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ("two.gpsz", 2, "no output was named; add -o map.pdf"),
        ("two.gpsz -o out.jpg", 1, "end it with one of .png, .svg, .pdf"),
        ("two.gpsz -o out.pdf --kind error", 2, "give the log with --raw"),
        ("two.gpsz -o out.pdf --kind pie", 2, "'segments', 'space-time', 'error', 'rate', 'heat'"),
        ("two.gpsz two.gpsz -o out.pdf", 2, "shows one archive, not 2"),
        ("two.gpsz -o out.pdf --width 5mm", 2, "give a width from 60 to 1000 mm"),
        ("two.gpsz -o out.pdf --width wide", 2, "'wide' is no width"),
        ("two.gpsz -o out.pdf --dpi 9", 2, "50<=x<=1200"),
        ("timeless.gpsz -o out.pdf --kind space-time", 2, "the archive has no times"),
        ("missing.gpsz -o out.pdf", 1, "missing.gpsz"),
        ("missing.gpsz missing.gpsz -o out.pdf", 2, "shows one archive, not 2"),
    ],
)
def test_mistakes_are_one_line_and_write_nothing(gpszip, archive, timeless, arguments, code, words):
    done = gpszip(f"plot {arguments}")
    assert done.code == code
    assert done.out == ""
    assert done.err.count("\n") == 1
    assert words in done.err
    assert not list(Path().glob("out.*"))


def test_a_picture_is_replaced_only_with_force(gpszip, archive):
    Path("out.pdf").write_text("precious")
    assert gpszip("plot two.gpsz -o out.pdf").code == 1
    assert Path("out.pdf").read_text() == "precious"
    assert gpszip("plot two.gpsz -o out.pdf --force").code == 0
    assert Path("out.pdf").read_bytes().startswith(b"%PDF")


def test_map_draws_pictures_in_degrees_and_metres(gpszip, archive, earthly):
    for name in ("two", "earth"):
        done = gpszip(f"map {name}.gpsz -o {name}.svg")
        assert done.code == 0, done.err
        assert ">20 m</text>" in Path(f"{name}.svg").read_text()
        assert "edges" in done.err


def test_formats_lists_pictures(gpszip):
    assert {".png", ".svg", ".pdf"} <= set(json.loads(gpszip("formats --json").out)["maps"])


@pytest.mark.parametrize("command", ["plot two.gpsz -o out.png", "map two.gpsz -o out.png"])
def test_missing_matplotlib_names_the_extra(gpszip, archive, monkeypatch, command):
    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    done = gpszip(command)
    assert done.code == 1
    assert "pip install 'gpszip[plot]'" in done.err
    assert not Path("out.png").exists()
