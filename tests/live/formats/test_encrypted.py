"""Encrypted messages of OwnTracks, sealed as the apps seal them."""

import base64
import json
from importlib.util import find_spec

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.errors import InputError
from gpszip.live import Fix
from gpszip.live.formats.apps import App, parse_message
from gpszip.live.formats.encrypted import OwnTracksKeys
from gpszip.live.formats.values import Context, MessageError
from live import bodies

pytestmark = pytest.mark.skipif(find_spec("nacl") is None, reason="needs gpszip[encrypted]")


def seal(message, key="s3cret"):
    from nacl.secret import SecretBox

    data = message if isinstance(message, bytes) else json.dumps(message).encode()
    sealed = SecretBox(key.encode().ljust(32, b"\0")).encrypt(data)
    return {"_type": "encrypted", "data": base64.b64encode(sealed).decode()}


def parse(message, *keys, agent=""):
    unseal = OwnTracksKeys(keys, "keys").open if keys else None
    context = Context(bodies.TIME + 3.0, "owntracks", agent, unseal=unseal)
    return parse_message(App.OWNTRACKS, message, context)[0]


def test_an_encrypted_message_gives_the_same_fix():
    open_fix = parse(bodies.owntracks())
    assert parse(seal(bodies.owntracks()), "other", "s3cret") == open_fix
    # The name comes from outside, or else from the sealed message.
    assert parse(seal(bodies.owntracks()), "s3cret", agent="bob").agent == "bob"
    long = "x" * 32
    assert isinstance(parse(seal(bodies.owntracks(), long), long), Fix)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (seal(bodies.owntracks()), "no key opens"),
        ({"_type": "encrypted"}, "no key opens"),
        ({"_type": "encrypted", "data": 7}, "no key opens"),
        ({"_type": "encrypted", "data": "QQ=="}, "no key opens"),
        ({"_type": "encrypted", "data": "?"}, "can't be read"),
        (seal(b"{", "right"), "no JSON"),
        (seal(b"[" * 99, "right"), "too many levels"),
        (seal(b"[1]", "right"), "other than locations"),
        (seal(seal(bodies.owntracks(), "right"), "right"), "other than locations"),
        (seal({"_type": "lwt"}, "right"), "other than locations"),
    ],
)
def test_what_cannot_be_opened_is_left_out(message, reason):
    assert reason in parse(message, "right").reason


def test_without_a_key_messages_are_counted():
    assert "encrypted" in parse(seal(bodies.owntracks())).reason


def test_keys_of_a_file(tmp_path):
    path = tmp_path / "keys"
    path.write_bytes("\ufeffone\r\n\r\nschlüssel\n".encode())
    keys = OwnTracksKeys.from_file(str(path))
    assert keys.open(seal([1], "schlüssel")["data"]) == [1]
    for content, message in [(b"", "0 keys"), (b"k\n" + b"x" * 33, "key 2"), (b"\xff", "no text")]:
        path.write_bytes(content)
        with pytest.raises(InputError, match=message) as error:
            OwnTracksKeys.from_file(str(path))
        assert "xxx" not in str(error.value)
    with pytest.raises(InputError, match="can't be read"):
        OwnTracksKeys.from_file(str(tmp_path))


@given(st.text(max_size=200))
def test_no_text_raises_anything_else(text):
    with pytest.raises(MessageError):
        OwnTracksKeys(["k"], "keys").open(text)
