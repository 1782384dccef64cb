"""The file format of archives: sections, checksums and an index around the encoded walks."""

from gpszip.container.contents import Contents, Group, Section, single_group_contents
from gpszip.container.reader import from_bytes, load
from gpszip.container.writer import save, to_bytes

__all__ = [
    "Contents",
    "Group",
    "Section",
    "from_bytes",
    "load",
    "save",
    "single_group_contents",
    "to_bytes",
]
