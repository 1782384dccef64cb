"""The table of log formats, and the choice of a format for a file.

To read a file, all formats are asked in order whether they recognise its first bytes. Only if
none does is the file refused, with advice for kinds of files that people often try. Formats of
other packages come first, as they know special files, and CSV comes last, as nearly any text may
be CSV.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from gpszip.errors import InputError, NoPositionsError, OptionError, OutputError, UnknownFormatError
from gpszip.io.deferred import deferred
from gpszip.io.logs.log_format import LogBatches, LogFormat
from gpszip.io.logs.xml.text import root_element
from gpszip.io.plugins import Guard, load_plugins

if TYPE_CHECKING:
    from gpszip.io.logs.raw import RawLog, Request
    from gpszip.io.storage.source import Source

__all__ = [
    "CSV",
    "LOG_FORMATS",
    "format_for_reading",
    "format_for_writing",
    "format_named",
    "is_bundle",
    "log_formats",
]

#: Group of entry points by which other packages add formats.
_PLUGIN_GROUP = "gpszip.formats"

PARQUET = LogFormat(
    name="parquet",
    suffixes=(".parquet", ".pq"),
    description="columns as in CSV; a folder of files, too",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_parquet"),
    read=deferred("gpszip.io.logs.parquet", "read_parquet"),
    read_batches=deferred("gpszip.io.logs.parquet", "read_parquet_batches"),
    write=deferred("gpszip.io.logs.parquet", "write_parquet"),
    is_binary=True,
)

# Parquet is read as GeoParquet wherever it has geometries; the name decides what is written.
GEOPARQUET = replace(
    PARQUET,
    name="geoparquet",
    suffixes=(".geoparquet",),
    description="rows with points and times, or lines as shapes; in degrees, or by its CRS",
    write=deferred("gpszip.io.logs.vector.geoparquet", "write_geoparquet"),
)

GPKG = LogFormat(
    name="gpkg",
    suffixes=(".gpkg",),
    description="GeoPackage: a layer of points with times, or of lines, with times as their m",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_gpkg"),
    read=deferred("gpszip.io.logs.vector.gdal", "read_vector"),
    read_batches=deferred("gpszip.io.logs.vector.gdal", "read_vector_batches"),
    write=deferred("gpszip.io.logs.vector.gdal", "write_gpkg"),
    is_binary=True,
    extra="gis",
)

FLATGEOBUF = replace(
    GPKG,
    name="flatgeobuf",
    suffixes=(".fgb",),
    description="points with times, or lines, with times as their m",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_flatgeobuf"),
    write=deferred("gpszip.io.logs.vector.gdal", "write_flatgeobuf"),
)

GPX = LogFormat(
    name="gpx",
    suffixes=(".gpx",),
    description="tracks and routes; extensions with --keep",
    sniff=deferred("gpszip.io.logs.sniff.xml", "sniff_gpx"),
    read=deferred("gpszip.io.logs.gpx.read", "read_gpx"),
    read_batches=deferred("gpszip.io.logs.gpx.read", "read_gpx_batches"),
    write=deferred("gpszip.io.logs.gpx.write", "write_gpx"),
    describe_losses=deferred("gpszip.io.logs.gpx.write", "describe_gpx_losses"),
    time_decimals=3,
    heights=True,
)

KML = LogFormat(
    name="kml",
    suffixes=(".kml",),
    description="tracks, points with times, and lines as shapes; data with --keep",
    sniff=deferred("gpszip.io.logs.sniff.xml", "sniff_kml"),
    read=deferred("gpszip.io.logs.kml.read", "read_kml"),
    read_batches=deferred("gpszip.io.logs.kml.read", "read_kml_batches"),
    write=deferred("gpszip.io.logs.kml.write", "write_kml"),
    describe_losses=deferred("gpszip.io.logs.kml.write", "describe_kml_losses"),
    time_decimals=3,
    heights=True,
)

# A zip archive is unpacked before its format is found, so that KMZ is read as KML.
KMZ = replace(
    KML,
    name="kmz",
    suffixes=(".kmz",),
    description="KML in a zip archive",
    write=deferred("gpszip.io.logs.kml.write", "write_kmz"),
    is_binary=True,
)

TCX = LogFormat(
    name="tcx",
    suffixes=(".tcx",),
    description="activities and courses; heart rate and others with --keep",
    sniff=deferred("gpszip.io.logs.sniff.xml", "sniff_tcx"),
    read=deferred("gpszip.io.logs.tcx.read", "read_tcx"),
    read_batches=deferred("gpszip.io.logs.tcx.read", "read_tcx_batches"),
    heights=True,
)

GEOJSON = LogFormat(
    name="geojson",
    suffixes=(".geojson", ".json"),
    description=(
        "LineStrings with coordTimes or times, or as shapes; Points with a time; "
        "one on each line, too"
    ),
    sniff=deferred("gpszip.io.logs.sniff.json", "sniff_geojson"),
    read=deferred("gpszip.io.logs.geojson.read", "read_geojson"),
    write=deferred("gpszip.io.logs.geojson.write", "write_geojson"),
)

GEOJSONL = replace(
    GEOJSON,
    name="geojsonl",
    suffixes=(".geojsonl", ".geojsons"),
    description="GeoJSON with a feature on each line, or after each record separator (RFC 8142)",
    write=deferred("gpszip.io.logs.geojson.write", "write_geojsonl"),
)

# Files of GeoJSON may hold moving features, so one reader takes both.
MF_JSON = replace(
    GEOJSON,
    name="mf-json",
    suffixes=(".mfjson",),
    description="moving features (OGC): trajectories, prisms, and MovingPoints of MobilityDB",
    write=deferred("gpszip.io.logs.geojson.write_moving", "write_mf_json"),
)

GOOGLE = LogFormat(
    name="google",
    suffixes=(),
    description="location histories: Records, Timeline of Android and iOS, by month; JSON",
    sniff=deferred("gpszip.io.logs.sniff.json", "sniff_google"),
    read=deferred("gpszip.io.logs.google.read", "read_google"),
    read_batches=deferred("gpszip.io.logs.google.read", "read_google_batches"),
)

GOOGLE_PATHS = LogFormat(
    name="google-paths",
    suffixes=(),
    description="paths of location histories that have positions, too; only with --format",
    sniff=deferred("gpszip.io.logs.sniff.json", "sniff_google_paths"),
    read=deferred("gpszip.io.logs.google.read", "read_google_paths"),
    read_batches=deferred("gpszip.io.logs.google.read", "read_google_paths_batches"),
)

FIT = LogFormat(
    name="fit",
    suffixes=(".fit",),
    description="activities and courses of watches and bicycle computers; fields with --keep",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_fit"),
    read=deferred("gpszip.io.logs.fit.read", "read_fit"),
    is_binary=True,
    extra="fit",
    heights=True,
)

NMEA = LogFormat(
    name="nmea",
    suffixes=(".nmea", ".nma"),
    description="NMEA 0183: RMC, GGA, GLL, GNS, ZDA and VTG of any receiver",
    sniff=deferred("gpszip.io.logs.sniff.text", "sniff_nmea"),
    read=deferred("gpszip.io.logs.nmea.read", "read_nmea"),
    read_batches=deferred("gpszip.io.logs.nmea.read", "read_nmea_batches"),
)

TUM = LogFormat(
    name="tum",
    suffixes=(".tum",),
    description="time, x, y, z and a quaternion in each line",
    sniff=deferred("gpszip.io.logs.trajectories.layouts", "sniff_tum"),
    read=deferred("gpszip.io.logs.trajectories.read", "read_tum"),
    read_batches=deferred("gpszip.io.logs.trajectories.read", "read_tum_batches"),
    write=deferred("gpszip.io.logs.trajectories.write", "write_tum"),
    describe_losses=deferred("gpszip.io.logs.trajectories.write", "describe_tum_losses"),
)

EUROC = LogFormat(
    name="euroc",
    suffixes=(),
    description="EuRoC's data.csv of positions, or the folder of a sequence",
    sniff=deferred("gpszip.io.logs.trajectories.layouts", "sniff_euroc"),
    read=deferred("gpszip.io.logs.trajectories.read", "read_euroc"),
    read_batches=deferred("gpszip.io.logs.trajectories.read", "read_euroc_batches"),
)

KITTI = LogFormat(
    name="kitti",
    suffixes=(),
    description="12 numbers of a matrix in each line; --times FILE or --rate 10",
    sniff=deferred("gpszip.io.logs.trajectories.layouts", "sniff_kitti"),
    read=deferred("gpszip.io.logs.trajectories.read", "read_kitti"),
    read_batches=deferred("gpszip.io.logs.trajectories.read", "read_kitti_batches"),
    takes=("times_file", "rate"),
)

ROS = LogFormat(
    name="ros",
    suffixes=(".bag", ".mcap", ".db3"),
    description="positions of a topic (--topic) or a frame (--frame); folders of ROS 2, too",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_ros"),
    read=deferred("gpszip.io.logs.ros.read", "read_ros"),
    read_batches=deferred("gpszip.io.logs.ros.read", "read_ros_batches"),
    is_binary=True,
    extra="ros",
    takes=("topics", "frame"),
)

OWNTRACKS = LogFormat(
    name="owntracks",
    suffixes=(".rec",),
    description="locations of OwnTracks Recorder, by the time of the phone",
    sniff=deferred("gpszip.io.logs.sniff.text", "sniff_owntracks"),
    read=deferred("gpszip.io.logs.owntracks", "read_owntracks"),
    read_batches=deferred("gpszip.io.logs.owntracks", "read_owntracks_batches"),
)

IGC = LogFormat(
    name="igc",
    suffixes=(".igc",),
    description="flights of gliders and paragliders; extensions with --keep",
    sniff=deferred("gpszip.io.logs.sniff.text", "sniff_igc"),
    read=deferred("gpszip.io.logs.igc", "read_igc"),
    read_batches=deferred("gpszip.io.logs.igc", "read_igc_batches"),
)

PLT = LogFormat(
    name="plt",
    suffixes=(".plt",),
    description="tracks of GeoLife and OziExplorer",
    sniff=deferred("gpszip.io.logs.sniff.text", "sniff_plt"),
    read=deferred("gpszip.io.logs.plt", "read_plt"),
    read_batches=deferred("gpszip.io.logs.plt", "read_plt_batches"),
)

READSB = LogFormat(
    name="readsb",
    suffixes=(),
    description="traces of aircraft of readsb and tar1090; JSON",
    sniff=deferred("gpszip.io.logs.sniff.json", "sniff_readsb"),
    read=deferred("gpszip.io.logs.readsb", "read_readsb"),
    read_batches=deferred("gpszip.io.logs.readsb", "read_readsb_batches"),
)

AIS = LogFormat(
    name="ais",
    suffixes=(),
    description="positions of ships, Danish and American CSV; each MMSI is a track",
    sniff=deferred("gpszip.io.logs.sniff.text", "sniff_ais"),
    read=deferred("gpszip.io.logs.ais", "read_ais"),
    read_batches=deferred("gpszip.io.logs.ais", "read_ais_batches"),
)

SUMO = LogFormat(
    name="sumo",
    suffixes=(),
    description="floating car data of SUMO: vehicles and persons; XML",
    sniff=deferred("gpszip.io.logs.sniff.xml", "sniff_sumo"),
    read=deferred("gpszip.io.logs.sumo", "read_sumo"),
    read_batches=deferred("gpszip.io.logs.sumo", "read_sumo_batches"),
)

CARMEN = LogFormat(
    name="carmen",
    suffixes=(".carmen", ".clf"),
    description="poses of robots: FLASER, ROBOTLASER1 or ODOM",
    sniff=deferred("gpszip.io.logs.sniff.text", "sniff_carmen"),
    read=deferred("gpszip.io.logs.carmen", "read_carmen"),
    read_batches=deferred("gpszip.io.logs.carmen", "read_carmen_batches"),
)

NPZ = LogFormat(
    name="npz",
    suffixes=(".npz", ".npy"),
    description="arrays of NumPy by name, as columns of CSV; --columns",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_npz"),
    read=deferred("gpszip.io.logs.npz", "read_npz"),
    is_binary=True,
)

HDF5 = LogFormat(
    name="hdf5",
    suffixes=(".h5", ".hdf5", ".hdf"),
    description="datasets of one group, as columns of CSV; --columns with paths",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_hdf5"),
    read=deferred("gpszip.io.logs.hdf5", "read_hdf5"),
    read_batches=deferred("gpszip.io.logs.hdf5", "read_hdf5_batches"),
    is_binary=True,
    extra="hdf5",
)

ULOG = LogFormat(
    name="ulog",
    suffixes=(".ulg",),
    description="flights of PX4: GPS, or else estimated positions",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_ulog"),
    read=deferred("gpszip.io.logs.ulog", "read_ulog"),
    is_binary=True,
)

DATAFLASH = LogFormat(
    name="dataflash",
    suffixes=(".bin", ".log"),
    description="flights of ArduPilot, binary or text; each receiver is a track",
    sniff=deferred("gpszip.io.logs.sniff.text", "sniff_dataflash"),
    read=deferred("gpszip.io.logs.dataflash", "read_dataflash"),
    read_batches=deferred("gpszip.io.logs.dataflash", "read_dataflash_batches"),
    is_binary=True,
)

TLOG = LogFormat(
    name="tlog",
    suffixes=(".tlog",),
    description="telemetry of MAVLink: GPS, or else estimated positions",
    sniff=deferred("gpszip.io.logs.sniff.binary", "sniff_tlog"),
    read=deferred("gpszip.io.logs.tlog", "read_tlog"),
    is_binary=True,
)

CSV = LogFormat(
    name="csv",
    suffixes=(".csv", ".tsv", ".txt", ".tab"),
    description="a header with t and x,y[,z] or lat,lon, in any order; track_id",
    sniff=deferred("gpszip.io.logs.csv", "sniff_csv"),
    read=deferred("gpszip.io.logs.csv", "read_csv"),
    read_batches=deferred("gpszip.io.logs.csv_batches", "read_csv_batches"),
    write=deferred("gpszip.io.logs.csv", "write_csv"),
    is_fallback=True,
)

#: The formats of GPSZip, in the order in which they are asked.
LOG_FORMATS: tuple[LogFormat, ...] = (
    PARQUET,
    GEOPARQUET,
    GPKG,
    FLATGEOBUF,
    GPX,
    KML,
    KMZ,
    TCX,
    GOOGLE,
    GOOGLE_PATHS,
    READSB,
    GEOJSON,
    GEOJSONL,
    MF_JSON,
    FIT,
    OWNTRACKS,
    IGC,
    PLT,
    ULOG,
    DATAFLASH,
    TLOG,
    NMEA,
    ROS,
    EUROC,
    TUM,
    KITTI,
    NPZ,
    HDF5,
    SUMO,
    CARMEN,
    AIS,
    CSV,
)

#: Advice for files that no format reads, by their first bytes.
_OTHER_FILES = (
    (b"PK\x03\x04", "is a zip archive inside another file; unpack the outer one first"),
    (b"BZh", "is packed with bzip2; unpack it first: bzip2 -d"),
    (b"\xfd7zXZ", "is packed with xz; unpack it first: xz -d"),
    (b"\x28\xb5\x2f\xfd", "is packed with zstd; unpack it first: zstd -d"),
    (b"SQLite format 3", "is a database; export the log from it as CSV"),
)

#: Advice for XML that no format reads, by the name of its root element in lower case.
_OTHER_XML = {
    "osm": "it is OpenStreetMap's, which has roads, not logs; 'gpszip network' reads it",
    "healthdata": "it is Apple's health data; its routes are in workout-routes beside it, as GPX",
    "graphml": "it is GraphML, which has roads, not logs; 'gpszip network' reads it",
    "html": "it is a web page, perhaps of an error or a login; fetch the file again",
}


def log_formats() -> tuple[LogFormat, ...]:
    """Return all formats in the order in which they are asked: of other packages, then built in.

    Raises
    ------
    InputError
        If a format of another package can't be loaded.

    Examples
    --------
    >>> log_formats()[-1].name
    'csv'
    """
    return (*load_plugins(_PLUGIN_GROUP, LogFormat, _guarded), *LOG_FORMATS)


def _guarded(plugin: LogFormat, guard: Guard) -> LogFormat:
    """Return a format of another package with guarded functions."""
    # This module must import nothing heavy, as --help reads its table.
    from gpszip.io.logs.raw import RawLog

    # Functions that read.
    guarded = replace(
        plugin,
        sniff=guard.wrap(plugin.sniff, InputError),
        read=guard.wrap(plugin.read, InputError, RawLog),
    )
    if plugin.read_batches is not None:
        guarded = replace(guarded, read_batches=_guarded_batches(plugin.read_batches, guard))

    # Functions that write.
    if plugin.write is not None:
        guarded = replace(guarded, write=guard.wrap(plugin.write, OutputError))
    if plugin.describe_losses is not None:
        describe_losses = guard.wrap(plugin.describe_losses, OutputError)
        guarded = replace(guarded, describe_losses=describe_losses)
    return guarded


def _guarded_batches(
    read_batches: Callable[[Source, Request], LogBatches | None], guard: Guard
) -> Callable[[Source, Request], LogBatches | None]:
    """Guard the opening of batches, and the batches, which are read later."""
    from gpszip.io.logs.raw import RawLog

    # Batches are read after the file was opened, so they need a guard of their own.
    def iterate(opened: LogBatches, where: str) -> Iterator[RawLog]:
        with guard.named_faults(InputError, where):
            for batch in opened.batches:
                guard.expect(RawLog, batch)
                yield batch

    # Open a file.
    def read(source: Source, request: Request) -> LogBatches | None:
        with guard.named_faults(InputError, source.name):
            opened = read_batches(source, request)
            if opened is None:
                return None
            guard.expect(LogBatches, opened)
        return replace(
            opened,
            batches=iterate(opened, source.name),
            count_rows=opened.count_rows and guard.wrap(opened.count_rows, InputError, int),
        )

    return read


def format_named(name: str) -> LogFormat:
    """Return the format with this name or suffix.

    Built-in formats are found even if a format of another package can't be loaded.

    Raises
    ------
    OptionError
        If there is none.

    Examples
    --------
    >>> format_named("csv").suffixes[0]
    '.csv'
    """
    # A suffix is a name, too, with or without its point: `tsv` means CSV.
    name_or_suffix = name.lower()
    suffix = f".{name_or_suffix.lstrip('.')}"
    for format_ in _built_in_first():
        if format_.name == name_or_suffix or suffix in format_.suffixes:
            return format_
    known = ", ".join(format_.name for format_ in log_formats())
    raise OptionError(f"no format {name!r}", remedy=f"there are {known}")


def _built_in_first() -> Iterator[LogFormat]:
    """Yield the built-in formats, then all formats; plugins are loaded only when needed."""
    yield from LOG_FORMATS
    yield from log_formats()


def format_for_reading(source: Source) -> LogFormat:
    """Find the format of a file by its content, whatever its name.

    1. Ask all formats in order, except those that accept nearly any text.
    2. Refuse the file if it is of a kind that is known to hold no log, or none that is read.
    3. Ask the formats that accept nearly any text.

    Raises
    ------
    InputError
        If the file is empty, or a format of another package can't be loaded or fails.
    UnknownFormatError
        If no format recognises it.
    """
    # Refuse an empty file before any format is asked.
    head = source.head()
    if not head.strip():
        raise NoPositionsError("empty file", path=source.name, remedy="name one that holds a log")

    # 1. Formats that know their files.
    formats = log_formats()
    for format_ in formats:
        if not format_.is_fallback and format_.sniff(head):
            return format_

    # 2. Files of other kinds.
    if reason := _explain_other_kind(source.name, head):
        raise UnknownFormatError(reason, path=source.name)

    # 3. Text. A text in a zip archive is a log only if it is named as one: it may be a page or a
    #    licence that comes with the logs.
    for format_ in formats:
        if format_.is_fallback and format_.sniff(head):
            name = source.name.lower().removesuffix(".gz")
            if source.collection and not name.endswith(format_.suffixes):
                raise UnknownFormatError(
                    "is text, but not named as a table",
                    path=source.name,
                    remedy=f"if it is a log, name it {format_.suffixes[0]}",
                )
            return format_
    raise UnknownFormatError(
        "neither text nor a format that is known",
        path=source.name,
        remedy="'gpszip formats' lists what can be read",
    )


def is_bundle(archive: Source) -> bool:
    """Whether a zip archive holds logs, rather than being one: no format recognises it as it is.

    Parameters
    ----------
    archive : Source
        The archive, for :func:`gpszip.io.storage.source.expand` to decide whether to unpack it.
    """
    # Fallbacks accept nearly any text, so their answer shows nothing; other formats may have files
    # that are zip archives themselves.
    head = archive.head()
    return not any(format_.sniff(head) for format_ in log_formats() if not format_.is_fallback)


def _explain_other_kind(name: str, head: bytes) -> str:
    """Say what a file is that no format recognises, and what to do; empty if it may be text."""
    # Recognise binary files by their first bytes, and archives of GPSZip by their suffix.
    for start, reason in _OTHER_FILES:
        if head.startswith(start):
            return reason
    if name.lower().endswith(".gpsz"):
        return "is an archive, not a log; 'gpszip decompress' turns it into one"

    # Tell XML by its root element, which shows the format to convert from.
    root = root_element(head)
    if root is None:
        return ""
    if not root:
        return (
            "is XML, but no element comes within its first 256 KiB; "
            "if it is GPX, say so with --format gpx"
        )
    advice = _OTHER_XML.get(root.lower(), "'gpszip formats' lists what can be read")
    return f"is XML, but of no format that is read: its root element is {root[:40]!r}; {advice}"


def format_for_writing(name: str, format: str | None = None) -> LogFormat:
    """Find the format to write: by its name, else by the file's suffix; CSV for a stream.

    Parameters
    ----------
    name : str
        Name of the file; ``-`` for a stream.
    format : str, optional
        Name of the format.

    Raises
    ------
    OutputError
        If no format has the suffix, or the format is only read.

    Examples
    --------
    >>> format_for_writing("walk.GPX").name, format_for_writing("-").name
    ('gpx', 'csv')
    """
    # A stated format overrides the suffix. Formats of other packages come after the built-in ones.
    if format is not None:
        chosen = format_named(format)
        if chosen.write is None:
            raise OutputError(
                f"{chosen.name} is only read",
                path=name,
                remedy=f"write {_list_suffixes(_can_write)}",
            )
        return chosen
    if name == "-":
        return CSV
    for format_ in _built_in_first():
        if name.lower().endswith(format_.suffixes) and format_.write is not None:
            return format_
    raise OutputError(
        "can't tell the format from this name",
        path=name,
        remedy=f"end it with one of {_list_suffixes(_can_write)}",
    )


def _can_write(format_: LogFormat) -> bool:
    return format_.write is not None


def _list_suffixes(is_listed: Callable[[LogFormat], bool]) -> str:
    return ", ".join(format_.suffixes[0] for format_ in log_formats() if is_listed(format_))
