"""The table of log formats, and formats that other packages add to it."""

import io
import json
import os
import re
import subprocess
import sys
import textwrap
import zipfile
from pathlib import Path

import numpy as np
import pytest

from gpszip.errors import InputError, OptionError, OutputError, UnknownFormatError
from gpszip.io.large.store import store_logs
from gpszip.io.logs.formats import (
    LOG_FORMATS,
    format_for_reading,
    format_for_writing,
    format_named,
    log_formats,
)
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.write import write_tracks
from gpszip.io.plugins import forget_plugins
from gpszip.io.storage.source import Source
from gpszip.model import Track

#: The example of CONTRIBUTING.md: lines of time, x and y after a line "TOY".
TOY = re.search(
    r"```python\n(.*?)```", (Path(__file__).parents[3] / "CONTRIBUTING.md").read_text(), re.DOTALL
)[1]

#: A format of XML, which could not be read if XML were refused before formats are asked.
PLACEMARKS = textwrap.dedent("""
    import re

    import numpy as np

    from gpszip.io.logs.xml.text import root_element
    from gpszip.io.logs.log_format import LogFormat
    from gpszip.io.logs.raw import RawLog


    def read_placemarks(source, request):
        lon, lat = np.array(re.findall(rb"([0-9.]+),([0-9.]+)", source.read()), float).T
        rows = np.stack([lat, lon], axis=1)
        return RawLog(source.name, (), None, np.arange(len(rows)) * 1.0, rows, geographic=True)


    FORMAT = LogFormat(
        name="placemarks",
        suffixes=(".places",),
        description="positions",
        sniff=lambda head: root_element(head) == "places",
        read=read_placemarks,
    )
""")

PLACES = b"<?xml version='1.0'?><places><at>11.5,48.1 11.6,48.2</at></places>"


#: First suffixes of the formats that are written, as errors list them.
WRITTEN_SUFFIXES = ", ".join(
    log_format.suffixes[0] for log_format in LOG_FORMATS if log_format.write is not None
)


def toy_file(path, points=200):
    rng = np.random.default_rng(1)
    rows = np.column_stack([np.arange(points), np.cumsum(rng.normal(1, 0.1, (points, 2)), axis=0)])
    path.write_text("TOY\n" + "".join(f"{t} {x} {y}\n" for t, x, y in rows))
    return path


def install(folder, source, name="toy"):
    """Write a package as pip installs it: a module, and the metadata with its entry point."""
    (folder / f"{name}_plugin.py").write_text(source)
    metadata = folder / f"{name}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[gpszip.formats]\n{name} = {name}_plugin:FORMAT\n")


def gpszip(folder, *words):
    """Run the command line with the packages of a folder installed."""
    path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-m", "gpszip", *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )


# Formats of other packages


def test_a_format_of_another_package_is_read_written_and_listed(tmp_path):
    install(tmp_path, TOY)
    log, archive, copy = toy_file(tmp_path / "walk.toy"), tmp_path / "a.gpsz", tmp_path / "b.toy"
    how = ("--rmse", "1m", "--effort", "1", "--json")
    compressed = gpszip(tmp_path, "compress", log, "-o", archive, *how)
    assert compressed.returncode == 0, compressed.stderr
    assert json.loads(compressed.stdout)["points"] == 200

    written = gpszip(tmp_path, "decompress", archive, "-o", copy)
    assert written.returncode == 0, written.stderr
    assert copy.read_text().startswith("TOY\n0.000 ")

    listed = gpszip(tmp_path, "formats")
    assert re.search(r"toy +\.toy +read, write +no +- +time, x and y in each line", listed.stdout)


def test_a_named_format_of_gpszip_is_read_whatever_other_packages_do(install_plugin):
    install_plugin("gpszip.formats", "import no_such_module\n")
    stream = io.BytesIO(b"t,x,y\n0,0,0\n1,1,1\n")
    assert len(read_logs(stream, format="csv").tracks[0]) == 2
    assert format_for_writing("walk.gpx").name == "gpx"
    with pytest.raises(InputError, match="plugin 'toy' of toy: can't be loaded"):
        format_named("toy")


def test_xml_that_no_format_recognises_is_refused_with_advice():
    with pytest.raises(
        UnknownFormatError, match="root element is 'places'; 'gpszip formats' lists"
    ):
        read_logs(io.BytesIO(PLACES))


def test_xml_is_refused_only_after_all_formats_were_asked(install_plugin):
    install_plugin("gpszip.formats", PLACEMARKS)
    (track,) = read_logs(io.BytesIO(PLACES)).tracks
    assert track.positions.shape == (2, 2)


@pytest.mark.parametrize(
    "head", [b"SQLite format 3\0", b"BZh91AY&SY", b"PK\x03\x04 in another", b'{"type": "Trip"}']
)
def test_formats_are_asked_before_a_file_is_refused(install_plugin, head):
    source = TOY.replace('head.startswith(b"TOY\\n")', f"head.startswith({head!r})")
    install_plugin("gpszip.formats", source)
    assert format_for_reading(Source("file", data=head + b"...")).name == "toy"


def test_a_zip_archive_that_is_a_log_is_not_unpacked(install_plugin):
    source = TOY.replace('head.startswith(b"TOY\\n")', 'b"toy.txt" in head[:100]').replace(
        "source.read().splitlines()", "b'TOY\\n0 0 0\\n1 1 1'.splitlines()"
    )
    install_plugin("gpszip.formats", source)
    for name, points in (("toy.txt", 2), ("other.csv", 3)):
        with zipfile.ZipFile(stream := io.BytesIO(), "w") as archive:
            archive.writestr(name, "t,x,y\n0,0,0\n1,1,1\n2,2,2\n")
        (track,) = read_logs(io.BytesIO(stream.getvalue())).tracks
        assert len(track) == points


def test_xml_within_a_zip_archive_is_asked_of_all_formats(install_plugin):
    with zipfile.ZipFile(stream := io.BytesIO(), "w") as archive:
        archive.writestr("doc.places", PLACES)
        archive.writestr("picture.png", b"\x89PNG\r\n\x1a\n\0\0")
    with pytest.raises(InputError, match=r"no log in it, only 2 files .*: 1 \.places, 1 \.png"):
        read_logs(io.BytesIO(stream.getvalue()))
    install_plugin("gpszip.formats", PLACEMARKS)
    forget_plugins()
    (track,) = read_logs(io.BytesIO(stream.getvalue())).tracks
    assert len(track) == 2


def test_a_format_of_another_package_is_read_in_batches(install_plugin, tmp_path):
    source = TOY + textwrap.dedent("""
        from dataclasses import replace

        from gpszip.io.logs.log_format import LogBatches


        def read_batches(source, request):
            log = read_toy(source, request)
            cuts = [slice(i, i + 50) for i in range(0, len(log.times), 50)]
            return LogBatches(
                replace(log, times=log.times[cut], coordinates=log.coordinates[cut]) for cut in cuts
            )


        FORMAT = replace(FORMAT, read_batches=read_batches)
    """)
    install_plugin("gpszip.formats", source)
    path = toy_file(tmp_path / "walk.toy", points=170)
    with store_logs(path, rows=1000) as log:
        (track,) = log.tracks
        times = log.read(track).times
    assert times.tolist() == read_logs(path).tracks[0].times.tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("np.array([", "np.no_such_name(["), "walk.toy: plugin 'toy' of toy failed: Attr"),
        (("lambda head: head.starts", "lambda head: head.no_such"), "plugin 'toy' of toy failed"),
        (
            ("    return RawLog", "    return str(rows)\n    RawLog"),
            "a RawLog is expected, not str",
        ),
    ],
)
def test_faults_of_another_package_are_errors_with_its_name(
    install_plugin, tmp_path, change, message
):
    source = TOY
    assert change[0] in source
    install_plugin("gpszip.formats", source.replace(*change))
    path = toy_file(tmp_path / "walk.toy")
    with pytest.raises(InputError, match=message):
        read_logs(path)
    with pytest.raises(InputError, match=message):
        store_logs(path, rows=1000)


def test_an_error_of_another_package_gets_the_file(install_plugin, tmp_path):
    refusal = 'raise InputError("no row", location="line 2", remedy="add one")'
    source = f"from gpszip.errors import InputError\n{TOY}"
    source = source.replace("    return RawLog", f"    {refusal}\n    return RawLog")
    install_plugin("gpszip.formats", source)
    path = toy_file(tmp_path / "walk.toy")
    for read in (read_logs, lambda path: store_logs(path, rows=1000)):
        with pytest.raises(InputError) as caught:
            read(path)
        assert caught.value.path == str(path)
        assert str(caught.value) == f"{path}: line 2: no row; add one"


def test_faults_while_another_package_writes_are_errors_with_its_name(install_plugin, tmp_path):
    install_plugin("gpszip.formats", TOY.replace("savetxt", "no_such_name"))
    track = Track("walk", [0, 1], [[0, 0], [1, 1]])
    with pytest.raises(OutputError, match="plugin 'toy' of toy failed: AttributeError"):
        write_tracks([track], tmp_path / "walk.toy")
    assert not (tmp_path / "walk.toy").exists()


def test_a_format_that_is_only_read_is_not_written(install_plugin, tmp_path):
    install_plugin("gpszip.formats", PLACEMARKS)
    track = Track("walk", [0, 1], [[0, 0], [1, 1]])
    with pytest.raises(OutputError, match=re.escape(f"one of {WRITTEN_SUFFIXES}")):
        write_tracks([track], tmp_path / "walk.places")
    with pytest.raises(OutputError, match="placemarks is only read"):
        write_tracks([track], tmp_path / "walk.places", "placemarks")


# The table


def test_every_format_has_a_name_and_suffixes_of_its_own():
    names = [log_format.name for log_format in LOG_FORMATS]
    suffixes = [suffix for log_format in LOG_FORMATS for suffix in log_format.suffixes]
    assert len(set(names)) == len(names)
    assert len(set(suffixes)) == len(suffixes)
    assert all(suffix == suffix.lower() and suffix[0] == "." for suffix in suffixes)


def test_formats_that_accept_any_text_are_asked_last():
    fallbacks = [log_format.is_fallback for log_format in log_formats()]
    assert fallbacks == sorted(fallbacks)


def test_errors_list_the_formats_of_the_table():
    names = ", ".join(log_format.name for log_format in LOG_FORMATS)
    with pytest.raises(OptionError, match=f"no format 'xyz'; there are {names}"):
        format_named("xyz")
    with pytest.raises(OutputError, match=re.escape(f"one of {WRITTEN_SUFFIXES}")):
        format_for_writing("walk.xyz")


def test_recognising_a_table_imports_no_reader():
    script = (
        "import sys\nfrom gpszip.io.logs.formats import LOG_FORMATS\n"
        "asked = [f for f in LOG_FORMATS if not f.is_fallback]\n"
        "found = [f.name for f in asked if f.sniff(b't,x,y\\n0,1,2\\n')]\n"
        "print(found, [name for name in ('pyarrow', 'pandas', 'numba') if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout == "[] []\n"
