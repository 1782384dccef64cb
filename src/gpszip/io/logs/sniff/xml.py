"""Recognise logs in XML by their root element.

All formats are asked about each file, so this module imports nothing heavy.
"""

from __future__ import annotations

from gpszip.io.logs.xml.text import root_element

__all__ = ["sniff_gpx", "sniff_kml", "sniff_sumo", "sniff_tcx"]

#: Elements that may be the root of a KML file, in lower case.
_KML_ROOTS = frozenset({"kml", "document", "folder", "placemark"})


def sniff_gpx(head: bytes) -> bool:
    """Whether a file that starts like this is GPX.

    Examples
    --------
    >>> sniff_gpx(b'<?xml version="1.0"?> <gpx version="1.1">'), sniff_gpx(b"<kml>")
    (True, False)
    """
    return (root_element(head) or "").lower() == "gpx"


def sniff_kml(head: bytes) -> bool:
    """Whether a file that starts like this is KML.

    Examples
    --------
    >>> sniff_kml(b'<?xml version="1.0"?> <kml>'), sniff_kml(b"<gpx>")
    (True, False)
    """
    return (root_element(head) or "").lower() in _KML_ROOTS


def sniff_tcx(head: bytes) -> bool:
    """Whether a file that starts like this is TCX.

    Examples
    --------
    >>> sniff_tcx(b'  <?xml version="1.0"?> <TrainingCenterDatabase>'), sniff_tcx(b"<gpx>")
    (True, False)
    """
    return (root_element(head) or "").lower() == "trainingcenterdatabase"


def sniff_sumo(head: bytes) -> bool:
    """Whether a file that starts like this is floating car data of SUMO.

    Examples
    --------
    >>> sniff_sumo(b"<fcd-export><timestep time='0'>"), sniff_sumo(b"<gpx>")
    (True, False)
    """
    return root_element(head) == "fcd-export"
