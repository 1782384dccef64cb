import random

import pytest

from gpszip.container.text_model import MODEL_LIMIT, PRIME, encode_text, read_text
from gpszip.errors import CorruptArchiveError
from oracle import text_model

RANDOM = random.Random(7)

TEXTS = [
    b"\n",
    b"infinite_corridor\n",
    b"\n\n\n",
    b"abc\nabd\nab\n\nabc\n",
    "Überlingen\nÜberall\n".encode(),
    bytes(range(256)) + b"\n",
    bytes(RANDOM.choice(b"abc\n\xff") for _ in range(1500)) + b"\n",
    RANDOM.randbytes(1000) + b"\n",
    b"z" * (MODEL_LIMIT - 1) + b"\n",
]


@pytest.mark.parametrize("text", TEXTS, ids=range(len(TEXTS)))
def test_text_round_trips_and_the_plain_decoder_agrees(text):
    data = encode_text(text)
    lines = text.count(b"\n")
    assert read_text(data, lines, 0) == text
    assert text_model.decode(data, lines) == text


def test_docs_and_package_have_the_same_prime():
    assert text_model.prime() == PRIME


def test_names_like_those_before_take_few_bits():
    few = encode_text(b"".join(b"indoor run %d\n" % i for i in range(10)))
    many = encode_text(b"".join(b"indoor run %d\n" % i for i in range(20)))
    assert len(many) - len(few) < 15


@pytest.mark.parametrize("data", [b"", b"\xff" * 10, b"\x55" * 5000, RANDOM.randbytes(20_000)])
def test_decoding_any_bytes_ends(data):
    with pytest.raises(CorruptArchiveError, match="go on past"):
        read_text(data, 1 << 60, 3)
