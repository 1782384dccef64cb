"""A memo of solved segment means, in memory and optionally in a folder.

Source: the thesis, section 6.4, 'Memoizer'.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gpszip.errors import InputError
from gpszip.model import SegmentMean, Track

__all__ = ["Memo", "memo_key"]

#: Arrays of a file, by the names of the fields of SegmentMean.
_FIELDS = ("boundaries", "labels", "starts", "ends", "cost", "costs", "heads")

#: Bytes of a key; twice as many hexadecimal digits.
_KEY_BYTES = 16


def memo_key(track: Track, options: Mapping[str, object]) -> str:
    """Return a hash of a track's samples and the options with which it is solved.

    The track's name does not count.
    """
    text = json.dumps(dict(options), sort_keys=True, default=str)
    digest = hashlib.blake2b(text.encode(), digest_size=_KEY_BYTES)
    # The shape as well: the same bytes may be 4 points of 3 axes or 6 of 2.
    for array in (track.times, track.positions, track.weights):
        digest.update(b"-" if array is None else str(array.shape).encode() + array.tobytes())
    return digest.hexdigest()


class Memo:
    """Solved segment means by track, options, k and m.

    Parameters
    ----------
    folder : path, optional
        Where solutions persist, each in a file ``.npz``; created if missing. Several processes
        may share it.
    """

    def __init__(self, folder: str | os.PathLike[str] | None = None) -> None:
        self._solved: dict[tuple[str, int, int], SegmentMean] = {}
        self._folder = None if folder is None else Path(folder)

    def get(self, key: str, k: int, m: int) -> SegmentMean | None:
        """Return the solution under a key of :func:`memo_key`, or None.

        Raises
        ------
        InputError
            If its file is damaged.
        """
        if (key, k, m) not in self._solved and self._folder is not None:
            path = self._path(self._folder, key, k, m)
            if path.exists():
                self._solved[key, k, m] = _read(path, k, m)
        return self._solved.get((key, k, m))

    def put(self, key: str, mean: SegmentMean) -> None:
        """Store a solution, on disk too if there is a folder."""
        self._solved[key, mean.k, mean.m] = mean
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            _write(self._path(self._folder, key, mean.k, mean.m), mean)

    @staticmethod
    def _path(folder: Path, key: str, k: int, m: int) -> Path:
        return folder / f"{key}-k{k}-m{m}.npz"


def _write(path: Path, mean: SegmentMean) -> None:
    """Write a temporary file and rename it, so that no reader ever sees half a file."""
    # In the same folder, since a rename works within one file system only.
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            arrays: dict[str, Any] = {field: np.asarray(getattr(mean, field)) for field in _FIELDS}
            np.savez(file, **arrays)
            file.flush()
            os.fsync(file.fileno())
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _read(path: Path, k: int, m: int) -> SegmentMean:
    """Read a solution; raise InputError if the file is damaged or misnamed."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            values = [file[field] for field in _FIELDS]
        boundaries, labels, starts, ends, cost, costs, heads = values
        mean = SegmentMean(
            boundaries, labels, starts, ends, float(cost), tuple(costs.tolist()), heads
        )
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"damaged memo of a segment mean ({error})",
            path=path,
            remedy="delete it to solve it again",
        ) from error

    if (len(boundaries), len(labels), len(starts), starts.shape) != (k + 1, k, m, ends.shape):
        raise InputError(
            "holds another segment mean than its name says",
            path=path,
            remedy="delete it to solve it again",
        )
    return mean
