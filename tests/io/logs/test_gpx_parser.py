import gzip

import pytest

from gpszip.errors import InputError
from gpszip.io.logs.gpx.read import GPX_VOCABULARY
from gpszip.io.logs.read import read_logs
from gpszip.io.logs.xml.point_collector import collect_points
from gpszip.io.storage.source import Source

POINT = '<trkpt lat="1" lon="2"><time>2024-05-04T08:00:00Z</time></trkpt>\n'
OPEN, CLOSE = "<gpx>\n<trk><trkseg>\n", "</trkseg></trk></gpx>"


def parse(text, fields=("time",)):
    source = Source("walk.gpx", data=text.encode() if isinstance(text, str) else text)
    collector, _ = collect_points(source, GPX_VOCABULARY, fields)
    return collector.finish()


def refusal(text):
    with pytest.raises(InputError) as caught:
        parse(text)
    message = str(caught.value)
    assert message.startswith("walk.gpx: ")
    assert "\n" not in message
    return message


# Entities and external references. The refusal comes after the start of the declaration alone: this
# shows that nothing is declared, expanded or fetched before.

LAUGHS = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))


@pytest.mark.parametrize(
    "declaration",
    [
        f'<!DOCTYPE gpx [<!ENTITY a0 "ha">{LAUGHS}]>',
        f'<!DOCTYPE gpx [<!ENTITY a9 "{"x" * 50_000}">]>',
        '<!DOCTYPE gpx [<!ENTITY a9 SYSTEM "{path}">]>',
        '<!DOCTYPE gpx [<!ENTITY % a SYSTEM "{path}"> %a;]>',
        '<!DOCTYPE gpx SYSTEM "{path}">',
        "<!DOCTYPE gpx>",
        "<!DOCTYPE gpx [",
    ],
    ids=["laughs", "quadratic", "external", "parameter", "dtd", "plain", "start"],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_document_type_is_refused_before_anything_is_declared(declaration, encoding, tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("48.1")
    head = "<?xml version='1.0'?>\n" + declaration.replace("{path}", secret.as_uri())
    text = f"{head}<gpx><trk><name>{'&a9;' * 1000}</name></trk></gpx>"
    message = refusal(text.encode(encoding))
    assert (
        message
        == "walk.gpx: line 2: has a document type (<!DOCTYPE), which no GPX file needs; remove it"
    )


def test_entities_are_not_known_without_a_document_type():
    assert "undefined entity" in refusal(f"{OPEN}{POINT}<name>&bomb;</name>{CLOSE}")


# Limits


def test_depth_is_limited_within_points_and_around_them():
    deep = "<a>" * 201 + "</a>" * 201
    assert "line 3: elements more than 200 deep" in refusal(
        OPEN + f'<trkpt lat="1" lon="2">{deep}</trkpt>' + CLOSE
    )
    assert "line 3: elements more than 200 deep" in refusal(OPEN + deep + CLOSE)
    shallow = "<a>" * 150 + "</a>" * 150
    assert len(parse(OPEN + shallow + f'<trkpt lat="1" lon="2">{shallow}</trkpt>' + CLOSE).lat) == 1


@pytest.mark.parametrize(
    ("inside", "says"),
    [
        (f"<time>{'0' * 1_100_000}</time>", "a text of more than 1048576 letters"),
        (f"<desc>{'x' * 1_500_000}</desc>", "a text of more than 1048576 letters"),
        ("x" * 1_500_000, "a text of more than 1048576 letters"),
        (f"<a b='{'x' * 9_000_000}'/>", "a tag or comment of more than 8388608 bytes"),
        (f"<!--{'x' * 9_000_000}-->", "a tag or comment of more than 8388608 bytes"),
        ("".join(f"<a{i}/>" for i in range(10_100)), "more than 10000 different names"),
        ('<trkpt lat="3" lon="4"/>', "a <trkpt> within a point"),
        (
            '<extensions><trkpt lat="3" lon="4"><time>1</time></trkpt></extensions>',
            "a <trkpt> within a point",
        ),
    ],
    ids=["time", "desc", "bare", "attribute", "comment", "names", "nested", "nested deeper"],
)
def test_what_no_gpx_file_needs_is_refused(inside, says):
    assert says in refusal(f'{OPEN}<trkpt lat="1" lon="2">{inside}</trkpt>{CLOSE}')


def test_a_long_coordinate_and_a_long_name_are_refused():
    assert "a text of more than" in refusal(
        OPEN + POINT.replace('"1"', f'"{"1" * 1_100_000}"') + CLOSE
    )
    assert "a text of more than" in refusal(f"<gpx><trk><name>{'x' * 2_000_000}")


def test_long_texts_around_points_are_passed_over():
    long = f"<metadata><desc>{'x' * 3_000_000}</desc></metadata><!--{'x' * 3_000_000}-->"
    assert len(parse(OPEN + long + POINT + CLOSE).lat) == 1


def test_many_empty_tracks_and_segments_are_passed_over():
    parsed = parse(
        f"<gpx>{'<trk><trkseg/></trk>' * 30_000}"
        f"<trk>{'<trkseg/>' * 30_000}<trkseg>{POINT}</trkseg></trk></gpx>"
    )
    assert (parsed.names, parsed.parents.tolist(), parsed.starts.tolist()) == ((None,), [0], [0])


# Pieces


def test_points_in_many_chunks_are_those_of_one_chunk():
    count = 20_000  # of several pieces
    text = OPEN + "".join(
        f'<trkpt lon="{i}" lat="-{i}">'
        f"{f'<ele>{i}</ele>' if i % 3 else ''}<time>{i}</time></trkpt>\n"
        for i in range(count)
    )
    parsed = parse((text + CLOSE).encode("utf-16"), ("time", "ele"))
    assert parsed.lat.to_pylist() == [f"-{i}" for i in range(count)]
    assert (
        parsed.lon.to_pylist()
        == parsed.fields["time"].to_pylist()
        == [str(i) for i in range(count)]
    )
    assert parsed.fields["ele"].to_pylist() == [str(i) if i % 3 else None for i in range(count)]


def test_gzip_is_unpacked_and_damaged_gzip_refused():
    packed = gzip.compress((OPEN + POINT * 5000 + CLOSE).encode())
    assert len(parse(packed).lat) == 5000
    assert "damaged gzip file" in refusal(packed[:-20])


# Damage


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            OPEN + POINT * 3,
            "line 6: damaged GPX: the file ends within <trkseg>, after 3 points; fetch it again",
        ),
        (OPEN + POINT + POINT[:30], "line 4: damaged GPX: the file ends within <trkseg>, after"),
        (
            "\n\n" + OPEN + POINT + POINT[:10],
            "line 6: damaged GPX: the file ends within <trkseg>, after 1 point;",
        ),
        (f"<g:gpx><g:trk>{POINT}", "with </g:trk></g:gpx> after the last complete point"),
        ("<?xml version='1.0'?>", "the file ends within its first element"),
        (
            f"{OPEN}<name>Tom & Jerry</name>",
            "line 3: damaged GPX: not well-formed (invalid token), after 0 points; write & as &am",
        ),
        (f"{OPEN}{POINT}<name>\x07</name>", "line 4: damaged GPX: not well-formed (invalid token)"),
        (
            f"{OPEN}{POINT}</trk>",
            "line 4: damaged GPX: mismatched tag, after 1 point; close each element",
        ),
        (
            f"{OPEN}{POINT}{CLOSE}\n{OPEN}{POINT}{CLOSE}",
            "remove what follows the end of the first element",
        ),
        (f"{OPEN}{POINT.replace('lon', 'lat')}{CLOSE}", "duplicate attribute"),
    ],
)
def test_damage_is_named_with_its_line_and_a_remedy(text, says):
    assert says in refusal(text)


def test_utf_16_that_ends_within_a_character_is_damaged():
    data = (OPEN + POINT + CLOSE).encode("utf-16")
    assert "damaged UTF-16" in refusal(data[:-1])


def test_a_damaged_file_can_be_left_out(tmp_path):
    (tmp_path / "good.gpx").write_text(OPEN + POINT + CLOSE)
    (tmp_path / "short.gpx").write_text(OPEN + POINT)
    reading = read_logs(str(tmp_path / "*.gpx"), skip_bad=True)
    assert len(reading.tracks) == 1
    (left,) = reading.left_out
    assert left.name.endswith("short.gpx")
    assert "line 4" in left.reason
