import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.io.logs.gpx.read import read_gpx
from gpszip.io.logs.raw import Request
from gpszip.io.logs.xml.text import ReplacedBytes, Utf8Transcoder, detect_encoding, root_element
from gpszip.io.storage.source import Source

DECLARED = '<?xml version="1.0" encoding="{}"?>\n'
LOG = (
    '<gpx><trk><name>{}</name><trkseg><trkpt lat="1" lon="2">'
    "<time>2024-05-04T08:00:00Z</time></trkpt></trkseg></trk></gpx>"
)


def log_of(data):
    return read_gpx(Source("walk.gpx", data=data), Request())


@pytest.mark.parametrize(
    ("declared", "written", "name"),
    [
        (None, "utf-8", "Zürich 東京 🚶"),
        (None, "utf-8-sig", "Zürich"),
        (None, "utf-16", "Zürich 東京 🚶"),
        ("UTF-16", "utf-16", "Zürich"),
        (None, "utf-16-le", "Zürich"),
        ("utf-16", "utf-16-be", "Zürich"),
        ("UTF-32", "utf-32", "Zürich"),
        ("ISO-8859-1", "latin-1", "Zürich"),
        ("windows-1252", "cp1252", "Zürich – 5 €"),
        ("windows-1251", "cp1251", "Москва"),
        ("Shift_JIS", "shift_jis", "東京"),
        ("utf-16", "utf-8", "Zürich"),
        ("UTF-8", "utf-16", "Zürich"),
        ("windows-1252", "utf-8-sig", "Zürich"),
        ("no-such-encoding", "utf-8", "Zürich"),
        ("zip", "utf-8", "Zürich"),
        ("idna", "utf-8", "Zürich"),
    ],
)
def test_declared_and_wrongly_declared_encodings_are_read(declared, written, name):
    text = (DECLARED.format(declared) if declared else "") + LOG.format(name)
    data = text.encode(written)
    log = log_of(data)
    assert log.ids == (name,)
    assert not log.repairs
    assert root_element(data) == "gpx"


@pytest.mark.parametrize("declared", ["UTF-8", "us-ascii", "utf-16"])
def test_bytes_that_do_not_fit_the_encoding_are_reported(declared):
    data = (DECLARED.format(declared) + LOG.format("Größe 5 €")).encode("cp1252")
    log = log_of(data)
    assert log.ids == ("Größe 5 €",)
    (repair,) = log.repairs
    assert (repair.count, repair.drops, repair.value) == (3, False, "text 'Größe'")
    assert root_element(data) == "gpx"


def test_a_lone_half_of_a_utf_16_pair_becomes_the_replacement_character():
    data = LOG.format("a\ud83db").encode("utf-16", "surrogatepass")
    log = log_of(data)
    assert log.ids == ("a\ufffdb",)
    assert log.repairs[0].count == 1


def test_white_space_and_marks_before_the_declaration_keep_the_numbers_of_lines():
    utf8 = Utf8Transcoder(b"\n")
    assert [
        utf8.encode(piece) for piece in (b"\n ", "\ufeff".encode(), b"\r\n<a> </a>\n", b" ")
    ] == [b"", b"", b"<a> </a>\n", b" "]
    assert utf8.skipped_lines == 2


@given(
    text=st.text(),
    cuts=st.lists(st.integers(0, 200)),
    encoding=st.sampled_from(["utf-8-sig", "utf-16", "utf-32"]),
)
def test_chunks_are_one_text_wherever_they_are_cut(text, cuts, encoding):
    data = f"<{text}".encode(encoding)
    utf8 = Utf8Transcoder(data)
    bounds = [0, *sorted(cuts), max(len(data), *cuts, 0)]
    pieces = [
        utf8.encode(data[first:last]) for first, last in zip(bounds, bounds[1:], strict=False)
    ]
    assert b"".join([*pieces, utf8.encode(b"", final=True)]).decode() == f"<{text}"
    assert utf8.replaced == ReplacedBytes(0, "")


@given(data=st.binary(max_size=400))
def test_any_bytes_are_some_encoding_and_some_root_or_none(data):
    assert "".encode(detect_encoding(data)) is not None
    assert root_element(data) is None or isinstance(root_element(data), str)


@pytest.mark.parametrize(
    ("head", "root"),
    [
        (b"", None),
        (b"t,x,y\n1,2,3", None),
        (b"PK\x03\x04", None),
        (b"<,>", None),
        (b"<gpx version=1.1>", "gpx"),
        (b"<gpx", "gpx"),
        (b"<!-- <a>", ""),
        (b"<!-- <a> --><b:c d='>'/>", "c"),
        (b"<!DOCTYPE html>", "html"),
        (b"<?a?>" * 1000 + b"<<", ""),
        (b"<<b", "b"),
    ],
)
def test_the_root_is_found_or_it_is_no_xml(head, root):
    assert root_element(head) == root
