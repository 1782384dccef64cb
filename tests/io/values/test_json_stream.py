import codecs
import io
import json
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.io.values.json_stream import Document, Element, read_json

VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)


class Slow(io.BytesIO):
    """A stream that gives few bytes at a time."""

    def __init__(self, data, piece):
        super().__init__(data)
        self.piece = piece

    def read(self, size=-1):
        return super().read(min(size, self.piece) if size >= 0 else self.piece)


def parts(data, piece=1 << 20):
    return [*read_json(Slow(data if isinstance(data, bytes) else data.encode(), piece), "log")]


@given(
    features=st.lists(VALUES, max_size=4),
    others=st.dictionaries(
        st.text(max_size=5).filter(lambda name: name != "features"), VALUES, max_size=3
    ),
    piece=st.integers(1, 60),
    ascii=st.booleans(),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-be", "utf-32"]),
)
def test_values_are_those_of_json_wherever_chunks_end(features, others, piece, ascii, encoding):
    text = json.dumps({**others, "features": features, "last": 12.5e-7}, ensure_ascii=ascii)
    data = text.encode("utf-16-le" if encoding == "utf-16-be" else encoding, "replace")
    expected = json.loads(data.decode("utf-16-le" if encoding == "utf-16-be" else encoding))
    read = parts(data, max(piece, 4))  # the first four bytes show the encoding
    assert [part.value for part in read[:-1]] == expected["features"]
    assert read[-1] == Document({**expected, "features": []})


@pytest.mark.parametrize("between", ["\n", "\r\n\r\n", " ", "", "\n\x1e"])
def test_objects_and_lists_may_follow_each_other(between):
    text = between.join(['{"a": 1}', "[2, {}]", '{"features": [3]}'])
    assert parts(text) == [
        Document({"a": 1}),
        Element(2),
        Element({}),
        Element(3, "features"),
        Document({"features": []}),
    ]
    assert parts("\x1e" + text + "\n") == parts(text)


@pytest.mark.parametrize("number", ["-12", "1.5e-10", "7E+5", "0.25", "-0", "9" * 40])
def test_a_number_in_two_chunks_is_one_number(number):
    for cut in range(4, 30):
        assert parts('{"number":' + number + "}", cut) == [Document({"number": json.loads(number)})]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("NaN", "NaN"),
        ("-Infinity", "-Infinity"),
        ("9" * 100_000, "9" * 100_000),
        ("1e999", float("inf")),
        (r'"\ud83d\ude00"', "\U0001f600"),
        (r'"a\ud83d"', r"a\ud83d"),
        (r'{"\uDe00": ["\\ud800"]}', {r"\ude00": [r"\ud800"]}),
        ('{"a": 1, "a": 2}', {"a": 2}),
    ],
)
def test_unusual_json_is_read(text, value):
    assert parts(f"[[{text}, 1]]") == [Element([value, 1])]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ('{"a"', "it ends where ':' is expected, at character 5"),
        ('{"a" 1}', "':' is expected, not '1', at character 6"),
        ('{"a": 1', "it ends where ',' is expected"),
        ('{"features": [1, 2', "it ends where ',' is expected"),
        ('{"features": [1, 2]]', "',' is expected, not ']'"),
        ('{"features": [1], "features": [2]}', "there is another list of features"),
        ('{"features": [1], "features": 0, "features": []}', "there is another list of features"),
        ("{5: 1}", "a name in quotes is expected"),
        ('{"a": tru', "it is cut short: Expecting value at character 7"),
        ('{"a": "b\n"}', "Invalid control character at character 9"),
        ('[{"a": [1,]}]', "Expecting value at character 11"),
        ("[1,]", "Expecting value at character 4"),
        ("{} x", "an object or a list is expected at character 4"),
        ('{"a": "' + "x" * 100, "it is cut short: Unterminated string starting at character 7"),
        ("[" * 1_000_000, "it is nested too deeply at character 2"),
        ('{"a":' * 1_000_000, "it is nested too deeply at character 6"),
        (
            "{" + ",".join(f'"{i}":{i}' for i in range(10_001)) + "}",
            "an object with more than 10,000 members",
        ),
        (b'{"a": "\xe4"}', "no UTF-8 after character 7; bring it to UTF-8: iconv"),
        ('{"a": 1}'.encode("utf-16")[:-1], "no UTF-16"),
    ],
)
def test_damage_is_named_with_its_place(data, says):
    with pytest.raises(InputError) as caught:
        parts(data)
    assert str(caught.value).startswith("log: damaged JSON file: ")
    assert says in str(caught.value)


def test_a_value_that_would_take_too_much_memory_is_refused():
    with pytest.raises(
        InputError,
        match=r"log: the value at character 2 is too large: .* write it as several features",
    ):
        parts("[[" + "0," * 8_100_000 + "0]]", 8 << 20)


def test_memory_is_bounded_by_a_feature_and_not_by_the_file():
    """A file of 40 MB, made while it is read."""
    tracemalloc = pytest.importorskip("tracemalloc")
    feature = b'{"type": "Feature", "properties": {"note": "' + b"x" * 40_000 + b'"}}'
    pieces = iter([b'{"features": [', *[(feature + b",") * 25] * 40, feature + b"]}"])

    class Made:
        def read(self, _size):
            return next(pieces, b"")

    tracemalloc.start()
    try:
        count = sum(1 for _ in read_json(Made(), "log"))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert count == 40 * 25 + 2
    assert peak < 6 << 20


def test_the_encoding_is_found_with_or_without_a_mark():
    for mark in (b"", codecs.BOM_UTF16_BE):
        assert parts(mark + '{"ä": 1}'.encode("utf-16-be")) == [Document({"ä": 1})]
    assert sys.get_int_max_str_digits() == 4300


def test_the_last_member_of_a_name_counts_before_a_list_of_features():
    text = '{"features": null, "features": [1, 2]}'
    assert list(read_json(io.BytesIO(text.encode()), "log")) == [
        Element(1, "features"),
        Element(2, "features"),
        Document({"features": []}),
    ]


def test_lists_of_other_names_are_streamed_if_asked_for():
    text = '{"a": [1], "features": [2], "b": 3, "c": [4, 5]}'
    assert list(read_json(io.BytesIO(text.encode()), "log", ("a", "b", "c"))) == [
        Element(1, "a"),
        Element(4, "c"),
        Element(5, "c"),
        Document({"a": [], "features": [2], "b": 3, "c": []}),
    ]
    with pytest.raises(InputError, match="there is another list of a"):
        list(read_json(io.BytesIO(b'{"a": [1], "a": [2]}'), "log", ("a",)))
