"""The codecs that are compared."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Codec:
    """A codec, and the levels at which it is run, from quick to thorough.

    Parameters
    ----------
    name : str
        What ``process.py`` calls it.
    label : str
        What tables and figures call it.
    levels : tuple of str
        Its levels.
    """

    name: str
    label: str
    levels: tuple[str, ...]


#: Levels of what simplifies first: one split of the error, and a few.
SIMPLIFIER_LEVELS = ("quick", "thorough")

#: The level of what keeps every sample.
SAMPLES = ("samples",)


def list_codecs(efforts: tuple[str, ...]) -> list[Codec]:
    """GPSZip at the given efforts, and all peers."""
    return [
        Codec("gpszip", "GPSZip", efforts),
        Codec("td-tr", "TD-TR", SIMPLIFIER_LEVELS),
        Codec("cised-s", "CISED-S", SIMPLIFIER_LEVELS),
        Codec("cised-wide", "CISED-S, wide", SIMPLIFIER_LEVELS),
        Codec("bottom-up", "Bottom-up", SIMPLIFIER_LEVELS),
        Codec("sz3", "SZ3", SAMPLES),
        Codec("pco", "pcodec", SAMPLES),
        Codec("bzip2", "bzip2", SAMPLES),
        Codec("zstd", "Zstandard", SAMPLES),
    ]
