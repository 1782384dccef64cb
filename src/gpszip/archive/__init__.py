"""An archive: a road map, the walks of all tracks on it, and the questions that they answer."""

from gpszip.archive.archive import Archive
from gpszip.archive.create import new_archive, with_error_bound, with_sampling, with_sections
from gpszip.archive.open import ArchiveSource, open_archive
from gpszip.archive.track_view import TrackView

__all__ = [
    "Archive",
    "ArchiveSource",
    "TrackView",
    "new_archive",
    "open_archive",
    "with_error_bound",
    "with_sampling",
    "with_sections",
]
