"""An archive: a road map, the walks of all tracks on it, and the questions that they answer."""

from gpszip.archive.archive import Archive
from gpszip.archive.create import new_archive, with_error_bound, with_sampling, with_sections
from gpszip.archive.open import open_archive

__all__ = [
    "Archive",
    "new_archive",
    "open_archive",
    "with_error_bound",
    "with_sampling",
    "with_sections",
]
