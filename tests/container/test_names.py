import lzma
import random

import pytest

from gpszip.container.layout import Cursor
from gpszip.container.names import encode_names, read_names
from gpszip.errors import CorruptArchiveError
from oracle.archives import number

RANDOM = random.Random(4)

IDS = {
    "none": (),
    "empty": ("",),
    "two empty": ("", ""),
    "newline": ("a\nb", "\n", "\n\n"),
    "nul": ("\0", "a\0b"),
    "same": ("x", "x", "x"),
    "digits of other scripts": ("٣", "٤"),
    "superscript": ("²",),
    "huge number": ("9" * 500,),
    "19 digits": ("1399383849620000002", "1399383849620000003"),
    "64 bits": ("18446744073709551615",),
    "padded past 64": ("0" * 65,),
    "minus": ("-1", "0", "1"),
    "gap": ("000", "001", "003"),
    "widths": ("08", "09", "10"),
    "grown": ("8", "9", "10"),
    "padded grown": ("099", "100", "101"),
    "holes": tuple(str(i * i) for i in range(100)),
    "wide holes": ("0001", "0300", "9999", "10000", "123456789012345678"),
    "one far": ("0", "999999999999999999", *map(str, range(10**17 * 9, 10**17 * 9 + 9))),
    "widest": ("999999999999999998", "999999999999999999", "1000000000000000000"),
    "long list": tuple(f"way to {i * 37 % 8000}" for i in range(3000)),
    "long growing list": tuple(str(i * 3 + i % 3) for i in range(40_000)),
    "astral": ("\U0001f6b6 walk", "\U0010ffff"),
    "slashes": ("../../etc/passwd", "a/b", "a/0"),
    "one megabyte": ("z" * 1_000_000,),
    "one random megabyte": ("".join(map(chr, RANDOM.choices(range(32, 0x2FFF), k=350_000))),),
}


@pytest.mark.parametrize("name", IDS)
def test_names_round_trip(name):
    ids = IDS[name]
    data = encode_names(ids)
    cursor = Cursor(data + b"payload")
    assert read_names(cursor, len(data) + 7) == ids
    assert cursor.read_rest() == b"payload"


@pytest.mark.parametrize(
    ("ids", "limit"),
    [
        (("0",), 2),
        (("walk",), 6),
        (tuple(f"{i:03}" for i in range(20)), 4),
        (tuple(str(i) for i in range(1, 500)), 4),
        (tuple(f"{i:05}" for i in range(70, 9000)), 6),
    ],
)
def test_numbered_and_short_names_take_few_bytes(ids, limit):
    assert len(encode_names(ids)) <= limit


def _lists():
    rng = random.Random(1)
    words = ["taxi", "bus", "porto", "walk", "run", "u005", "indoor_45_", "rec-"]
    yield tuple(f"{rng.choice(words)}{rng.randrange(1000)}" for _ in range(100))
    yield tuple(str(1_399_383_849_620_000_002 + rng.randrange(10**12)) for _ in range(148))
    yield tuple(f"indoor_{angle}_{i}" for angle in (45, 60) for i in range(12, 20))
    yield tuple(sorted(f"{rng.randrange(3000):04}" for _ in range(120)))
    yield tuple("".join(rng.choice("abcdefghijklm") for _ in range(8)) for _ in range(500))
    yield tuple(f"2014-05-{1 + i // 24:02}T{i % 24:02}:00:00Z" for i in range(700))
    yield tuple(rng.randbytes(16).hex() for _ in range(30))


@pytest.mark.parametrize("ids", list(_lists()), ids=lambda ids: ids[0])
def test_names_take_no_more_than_lzma(ids):
    reference = lzma.compress(
        "\n".join(ids).encode(),
        format=lzma.FORMAT_RAW,
        filters=[{"id": lzma.FILTER_LZMA2, "preset": 9}],
    )
    assert len(encode_names(ids)) <= len(reference)


def _bomb(packer):
    return packer.compress(bytes(200_000_000)) + packer.flush()


PACKED = number(1 << 2 | 3)


def packed(code, body, tracks=1):
    return number(tracks << 2 | 3) + number(len(body) << 2 | code) + body


FORGED = {
    "nothing": b"",
    "too many tracks": number((1 << 40) << 2) + b"\0",
    "count past 64 bits": b"\xff" * 12,
    "long varint": b"\x80\x00",
    "width": number(4 | 1) + b"\0" + number(1 << 30),
    "listed past the end": number(2 << 2 | 2) + b"\x01a\x05b",
    "listed more than bytes": number(60_000 << 2 | 2) + b"\0\0",
    "listed no text": number(1 << 2 | 2) + b"\x01\xff",
    "listed surrogate": number(1 << 2 | 2) + b"\x03\xed\xa0\x80",
    "packed past the end": PACKED + b"\x7fabc",
    "not deflate": packed(0, b"\xff\xff\xff"),
    "not lzma": packed(1, b"\xff\xff\xff"),
    "half a deflate stream": packed(0, b"\x4b\x4c"),
    "no tracks packed": packed(0, b"\x03\x00", 0),
    "other count": packed(0, b"\x4b\x04\x00", 5),
    "garbage after the stream": packed(0, b"\x4b\x04\x00\x00"),
    "model without end": packed(2, b"\x55" * 30, 60_000),
    "model of nothing": packed(2, b"", 60_000),
    "steps: nothing": packed(3, b"", 1),
    "steps: too few": packed(3, b"\0\0\0", 3),
    "steps: all ones": packed(3, b"\0\0\0" + b"\xff" * 9, 3),
    "steps: surplus byte": packed(3, b"\0\0\0\0", 1),
    "steps: surplus bit": packed(3, b"\0\0\0\x01", 2),
    "steps: wide": packed(3, b"\0\xff\0\0", 2),
    "steps: divisor": packed(3, b"\0\0\xff" + bytes(99), 2),
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_names_are_refused(name):
    with pytest.raises(CorruptArchiveError) as caught:
        read_names(Cursor(FORGED[name], base=100), len(FORGED[name]))
    assert caught.value.offset >= 100


def test_their_valid_counterparts_are_read():
    assert read_names(Cursor(packed(0, b"\x4b\x04\x00")), 8) == ("a",)
    assert read_names(Cursor(packed(3, b"\0\0\0\0", 2)), 8) == ("0", "1")
