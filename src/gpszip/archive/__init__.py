"""An archive: a road map, the walks of all tracks on it, and the questions that they answer."""

from gpszip.archive.archive import Archive
from gpszip.archive.create import keeping, new_archive, promising, sampled
from gpszip.archive.open import open_archive

__all__ = ["Archive", "keeping", "new_archive", "open_archive", "promising", "sampled"]
