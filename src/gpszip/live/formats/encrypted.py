"""Encrypted messages of OwnTracks: a secret box of libsodium around one object of JSON.

Format: OwnTracks booklet, docs/features/encrypt.md. The key has 32 bytes, filled up with zeros.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gpszip.errors import InputError, MissingExtraError
from gpszip.live.formats.values import MessageError, parse_json

__all__ = ["OwnTracksKeys"]

#: Bytes of a key.
_KEY_BYTES = 32

#: Keys that are tried for a message, at most; each takes some microseconds.
_MAX_KEYS = 1_000

#: Bytes of a file of keys that are read.
_MAX_FILE_BYTES = 1 << 20


class OwnTracksKeys:
    """Opens encrypted messages with one of several keys, as each phone may have its own.

    Parameters
    ----------
    keys : sequence of str
        Keys as they stand in the apps.
    where : str
        Where they come from, for messages.

    Raises
    ------
    MissingExtraError
        If PyNaCl is not installed.
    InputError
        If there is no key, or one that is too long.
    """

    def __init__(self, keys: Sequence[str], where: str) -> None:
        try:
            from nacl.secret import SecretBox
        except ImportError:
            raise MissingExtraError("encrypted", "encryption of OwnTracks") from None
        if not keys or len(keys) > _MAX_KEYS:
            raise InputError(
                f"holds {len(keys):,} keys; at least one is needed, and at most {_MAX_KEYS:,}",
                path=where,
                remedy="write each key into a line of its own",
            )
        self._boxes = [SecretBox(_padded(key, where, n)) for n, key in enumerate(keys, 1)]

    @classmethod
    def from_file(cls, path: str) -> OwnTracksKeys:
        """Read a file with a key in each line."""
        try:
            with Path(path).open("rb") as file:
                text = file.read(_MAX_FILE_BYTES).decode("utf-8-sig")
        except OSError as error:
            raise InputError(f"can't be read: {error.strerror}", path=path) from error
        except UnicodeDecodeError:
            raise InputError("is no text", path=path) from None
        return cls([line for line in text.splitlines() if line], path)

    def open(self, data: Any) -> Any:
        """Return the object of JSON in a message.

        Raises
        ------
        MessageError
            If no key opens it, or it holds no JSON.
        """
        try:
            sealed = base64.b64decode(data if isinstance(data, str) else "", validate=True)
        except (binascii.Error, ValueError):
            raise MessageError("encrypted messages that can't be read left out") from None
        return parse_json(self._unseal(sealed))

    def _unseal(self, sealed: bytes) -> bytes:
        from nacl.exceptions import CryptoError

        for box in self._boxes:
            # Too few bytes for a message are a ValueError.
            with contextlib.suppress(CryptoError, ValueError):
                return box.decrypt(sealed)
        raise MessageError("encrypted messages that no key opens left out")


def _padded(key: str, where: str, line: int) -> bytes:
    # A key must not be shown.
    data = key.encode()
    if len(data) > _KEY_BYTES:
        raise InputError(
            f"a key has {len(data)} bytes",
            path=where,
            location=f"key {line}",
            remedy=f"keys of OwnTracks have at most {_KEY_BYTES}",
        )
    return data.ljust(_KEY_BYTES, b"\0")
