"""An archive: a road map, the walks of all tracks on it, and the questions that they answer."""

from gpszip.archive.archive import Archive
from gpszip.archive.making import new_archive, promising, sampled
from gpszip.archive.opening import open_archive

__all__ = ["Archive", "new_archive", "open_archive", "promising", "sampled"]
