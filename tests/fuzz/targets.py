"""The targets of fuzzing: every reader and the container, each with valid files to begin with."""

from __future__ import annotations

import contextlib
import io
import math
import struct
import tempfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from fuzz import mutations
from fuzz.mutations import Mutation
from gpszip.errors import GPSZipError
from gpszip.lossless.trails import Trails

__all__ = ["TARGETS", "Target", "run"]


@dataclass(frozen=True)
class Target:
    """A reader, which must read any bytes or raise a GPSZipError.

    Parameters
    ----------
    take : callable
        Reads a file given as bytes.
    seeds : callable
        Returns valid files.
    kinds : sequence of str
        Kinds of changes that make sense for them.
    apply : callable
        Applies changes to a file; that of a format with checksums corrects them.
    """

    take: Callable[[bytes], object]
    seeds: Callable[[], Sequence[bytes]]
    kinds: Sequence[str] = mutations.TEXT
    apply: Callable[[bytes, Sequence[Mutation]], bytes] = mutations.apply

    def mutate(self, number: int, changes: Sequence[Mutation]) -> bytes:
        """Return a valid file after changes."""
        seeds = self.seeds()
        return self.apply(seeds[number % len(seeds)], changes)


def run(name: str, data: bytes) -> bool:
    """Return whether a target accepts data; only errors raised on purpose are caught."""
    try:
        TARGETS[name].take(data)
    except GPSZipError:
        return False
    return True


def _log(format: str | None, **options: object) -> Callable[[bytes], object]:
    def take(data: bytes) -> object:
        from gpszip.io.logs.read import read_logs

        return read_logs(io.BytesIO(data), format=format, **options)

    return take


def _stored(**options: Any) -> Callable[[bytes], object]:
    """Read a log in batches, as one larger than memory."""

    def take(data: bytes) -> object:
        from gpszip.io.large.store import store_logs

        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            path = Path(folder) / "log"
            path.write_bytes(data)
            with store_logs(str(path), rows=1000, **options) as log:
                return [log.read(track) for track in log.tracks]

    return take


def _network(suffix: str) -> Callable[[bytes], object]:
    def take(data: bytes) -> object:
        from gpszip.io.networks.read import read_network

        with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
            path = Path(folder) / f"roads{suffix}"
            path.write_bytes(data)
            return read_network(path)

    return take


def _coreset(data: bytes) -> object:
    from gpszip.io.coresets import read_coreset

    coreset = read_coreset(io.BytesIO(data))
    return coreset.rmse, coreset.eps(3), coreset.reduced(len(coreset.tracks))


def _segments(data: bytes) -> object:
    from gpszip import Track
    from gpszip.io.segments import read_model
    from gpszip.segmentation.markov import label_track

    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        path = Path(folder) / "model.json"
        path.write_bytes(data)
        model = read_model(str(path))
    track = Track("a", [0.0, 1.0, 2.0], [[0.0] * model.dimension] * 3)
    return label_track(model, track, np.zeros(1, np.int64)).cost


def _times(data: bytes) -> object:
    from gpszip.cli.times import parse_times

    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        path = Path(folder) / "times.txt"
        path.write_bytes(data)
        return parse_times(str(path))


def _times_in_text(data: bytes) -> object:
    from gpszip.cli.times import parse_times

    return parse_times(data.decode("utf-8", "surrogateescape"))


def _archive(data: bytes) -> object:
    from gpszip.archive import open_archive
    from gpszip.container.recover import recover_bytes
    from gpszip.container.verify import verify_bytes

    verify_bytes(data)
    with contextlib.suppress(GPSZipError):
        recover_bytes(data)
    archive = open_archive(data)
    if not archive.timed:
        return archive.shapes(), archive.road_map
    archive.decompress()
    archive.sample(at=[0.0, 10.0])
    if archive.kept_columns is not None:
        archive.samples()
    archive.check_curves()
    return archive.road_map, archive.error_bound, archive.sampling


CSV = (
    "t,x,y\n" + "".join(f"{t},{3 * t},{t % 7}.5\n" for t in range(12)),
    "id;timestamp;Lat;Lon;speed\n"
    + "".join(f"bus;2024-05-04T08:00:{t:02d}Z;48.{t:03d};11.5;{t}\n" for t in range(12)),
    'name,time,longitude,latitude,note\n"a ""b""",1714809600000,11.5,48.1,"x,\ny"\n'
    '"a ""b""",1714809601000,11.6,48.1,z\n',
    "1714809600 48.1 11.5\n1714809601 48.2 11.5\n1714809602 48.3 11.5\n",
    "date\ttime\tN\tE\n04.05.2024\t08:00:00\t48,1\t11,5\n04.05.2024\t08:00:10\t48,2\t11,5\n",
)

GPX = (
    """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="me" xmlns="http://www.topografix.com/GPX/1/1"
 xmlns:e="http://www.garmin.com/xmlschemas/TrackPointExtension/v1">
<wpt lat="48" lon="11"><name>w</name></wpt>
<trk><name>walk</name><trkseg>
<trkpt lat="48.1" lon="11.5"><ele>500</ele><time>2024-05-04T08:00:00Z</time>
<extensions><e:hr>120</e:hr><course>12</course></extensions></trkpt>
<trkpt lat="48.2" lon="11.5"><ele>501</ele><time>2024-05-04T08:00:10.5Z</time></trkpt>
</trkseg><trkseg><trkpt lat="48.3" lon="11.5"><time>2024-05-04T09:00:00+02:00</time></trkpt>
<trkpt lat="48.4" lon="11.6"><time>2024-05-04T09:10:00Z</time></trkpt></trkseg></trk>
<rte><rtept lat="48.1" lon="11.5"/><rtept lat="48.3" lon="11.5"/></rte>
</gpx>
""",
)

KML = (
    """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document><name>day</name>
<Placemark><name>walk</name><gx:MultiTrack><gx:Track><altitudeMode>absolute</altitudeMode>
<when>2024-05-04T08:00:00Z</when><gx:coord>11.5 48.1 500</gx:coord>
<when>2024-05-04T08:00:10.5Z</when><gx:coord>11.6 48.1 501</gx:coord>
<gx:angles>90 0 0</gx:angles><gx:angles>91 0 0</gx:angles>
<ExtendedData><SchemaData><gx:SimpleArrayData name="hr"><gx:value>60</gx:value>
<gx:value>61</gx:value></gx:SimpleArrayData></SchemaData></ExtendedData></gx:Track>
<gx:Track><when>2024-05-04T09:00:00Z</when><gx:coord>11.7 48.1</gx:coord></gx:Track>
</gx:MultiTrack></Placemark>
<Placemark><LineString><coordinates>11.5,48.1,0 11.6,48.2 11.7,48.3,7</coordinates></LineString>
</Placemark></Document></kml>
""",
    """<kml><Folder><name>bus</name>
<Placemark><TimeStamp><when>2024-05-04T08:00:00Z</when></TimeStamp><ExtendedData>
<Data name="hr"><value>3</value></Data></ExtendedData>
<Point><coordinates>11.5,48.1,500</coordinates></Point></Placemark>
<Placemark><TimeSpan><begin>2024-05-04T08:01:00Z</begin></TimeSpan>
<Point><coordinates>11.6,48.1</coordinates></Point></Placemark></Folder></kml>
""",
)

TCX = (
    """<?xml version="1.0" encoding="UTF-8"?>
<TrainingCenterDatabase xmlns="http://www.garmin.com/xmlschemas/TrainingCenterDatabase/v2"
 xmlns:e="http://www.garmin.com/xmlschemas/ActivityExtension/v2">
<Activities><Activity Sport="Running"><Id>2024-05-04T08:00:00Z</Id><Lap><Track>
<Trackpoint><Time>2024-05-04T08:00:00Z</Time><Position><LatitudeDegrees>48.1</LatitudeDegrees>
<LongitudeDegrees>11.5</LongitudeDegrees></Position><AltitudeMeters>500</AltitudeMeters>
<HeartRateBpm><Value>120</Value></HeartRateBpm></Trackpoint>
<Trackpoint><Time>2024-05-04T08:00:10Z</Time></Trackpoint></Track></Lap><Lap><Track>
<Trackpoint><Time>2024-05-04T08:00:20.5Z</Time><Position><LatitudeDegrees>48.2</LatitudeDegrees>
<LongitudeDegrees>11.6</LongitudeDegrees></Position><Extensions><e:TPX><e:Speed>3</e:Speed></e:TPX>
</Extensions></Trackpoint></Track></Lap></Activity></Activities>
<Courses><Course><Name>plan</Name><Track><Trackpoint><Position>
<LatitudeDegrees>48.1</LatitudeDegrees><LongitudeDegrees>11.5</LongitudeDegrees></Position>
</Trackpoint></Track><CoursePoint><Name>left</Name></CoursePoint></Course></Courses>
</TrainingCenterDatabase>
""",
)

GEOJSON = (
    """{"type": "FeatureCollection", "features": [
{"type": "Feature", "properties": {"id": "a", "time": "2024-05-04T08:00:00Z", "speed": 3},
 "geometry": {"type": "Point", "coordinates": [11.5, 48.1]}},
{"type": "Feature", "properties": {"id": "a", "time": "2024-05-04T08:00:10Z", "speed": 4},
 "geometry": {"type": "Point", "coordinates": [11.6, 48.1]}}
]}""",
    """{"type": "FeatureCollection", "features": [
{"type": "Feature", "properties": {"coordTimes":
 ["2024-05-04T08:00:00Z", "2024-05-04T08:00:10Z", "2024-05-04T08:00:20Z"]},
 "geometry": {"type": "LineString", "coordinates":
 [[11.5, 48.1, 500], [11.6, 48.1, 501], [11.7, 48.1, 502]]}}]}""",
    """{"type": "Feature", "properties": {"times": [[0, 10], [20, 30]]},
 "geometry": {"type": "MultiLineString", "coordinates":
 [[[11.5, 48.1], [11.6, 48.1]], [[11.7, 48.1], [11.8, 48.1]]]}}""",
)

NMEA = (
    "".join(
        f"$GPRMC,2359{t}.00,A,4807.0{t},N,01131.0{t},E,022.4,084.4,23032{t % 2},,\n"
        f"$GPGGA,2359{t}.00,4807.0{t},N,01131.0{t},E,1,08,0.9,545.4,M,46.9,M,,\n"
        f"$GNZDA,2359{t}.00,23,03,2021,00,00\n"
        for t in range(50, 60)
    ),
    "$GPRMC,102929.00,A,5327.04024,N,00214.41560,W,0.273,,070321,,,A*62\r\n"
    "$GPVTG,,T,,M,0.273,N,0.506,K,A*26\r\n"
    "$GPGGA,102929.00,5327.04024,N,00214.41560,W,1,08,1.16,36.3,M,48.5,M,,*7E\r\n"
    "$GPGSV,4,4,15,25,05,223,,28,14,049,26,32,10,313,16*4C\r\n"
    "$GPGLL,5327.04024,N,00214.41560,W,102929.00,A,A*7A\r\n",
)

TUM = (
    "# timestamp tx ty tz qx qy qz qw\n"
    + "".join(f"{t / 10} {3 * t} {t % 7}.5 0 0 0 0.6 0.8\n" for t in range(12)),
    "".join(
        f"{t}000000000,{3 * t},{t % 7}.5,0,0,0,0,1\n" for t in range(1_400_000_000, 1_400_000_009)
    ),
)

EUROC = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],"
    "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
    + "".join(f"14036365{t}0000000000,{3 * t},{t % 7}.5,0,1,0,0,0\n" for t in range(10, 22)),
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m]\n0,1,2,3\n50000000,1,2,4\n",
)

KITTI = ("".join(f"1 0 0 {3 * t} 0 1 0 {t % 7}.5 0 0 1 0\n" for t in range(12)),)

OWNTRACKS = (
    "".join(
        f'2024-05-04T08:00:{i:02}Z\t*                 \t{{"_type":"location","tst":{9000 + i},'
        f'"lat":48.{i:03},"lon":11.5,"vel":{i},"topic":"owntracks/me/{i % 2}"}}\n'
        for i in range(12)
    )
    + '2024-05-04T08:00:59Z\t*                 \t{"_type":"lwt","tst":1}\n',
)

IGC = (
    "AXXX\r\nHFDTE050822\r\nI023638FXA3940LAD\r\n"
    + "".join(f"B2359{t}4830{t}5N00013{t}9EA0009200191007{t}\r\n" for t in range(50, 60))
    + "HFDTEDATE:060822,01\r\nB0000014830895N00138319EV0009200191007110\r\n",
)

PLT = (
    "Geolife trajectory\r\nWGS 84\r\nAltitude is in Feet\r\nReserved 3\r\n0,2,255\r\n0\r\n"
    + "".join(
        f"40.00{t},116.31,0,{t},39745.09{t}66,2008-10-24,02:09:{t}\r\n" for t in range(10, 20)
    ),
    "OziExplorer Track Point File Version 2.1\r\nWGS 84\r\nAltitude is in Feet\r\n\r\n0\r\n0\r\n"
    + "".join(f" 40.00{t}, 116.31,1,-777,39745.09{t}66, 24-Oct-08\r\n" for t in range(10, 20)),
)

READSB = (
    '{"icao":"3c6444","timestamp":1714780800.5,"trace":[\n'
    + ",\n".join(
        f'[{t}.5,48.{t},11.{t},{t}00,480.1,{t},{t % 11},-64,null,"adsb_icao",{t}50]'
        for t in range(10, 30)
    )
    + ',\n[40,48.5,11,"ground",null,null,0,null]]}',
)

AIS = (
    "# Timestamp,Type of mobile,MMSI,Latitude,Longitude,SOG,COG,Heading\n"
    + "".join(
        f"03/04/2024 00:00:{t},Class A,21900000{t % 2},55.{t},12.{t},1.{t},{t},{t}\n"
        for t in range(10, 22)
    )
    + "03/04/2024 00:00:30,Class A,219000001,91.0,181.0,102.3,360.0,511\n",
    "MMSI,BaseDateTime,LAT,LON,SOG,COG,Heading\n"
    + "".join(
        f"36600000{t % 2},2024-01-01T00:00:{t},47.{t},-122.{t},0.1,10,511\n" for t in range(10, 22)
    ),
)

SUMO = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<!-- SUMO\n<configuration>\n'
    '<fcd-output.geo value="true"/></configuration> -->\n<fcd-export>\n'
    + "".join(
        f'<timestep time="{t}.00"><vehicle id="a" x="11.{t}" y="48.{t}" angle="9" speed="1.{t}"/>'
        f'<person id="b" x="11.{t}" y="48.2" edge="e"/></timestep>\n'
        for t in range(10, 20)
    )
    + "</fcd-export>\n",
)

CARMEN = (
    "# CARMEN\nPARAM robot_width 0.4\n"
    + "".join(
        f"ODOM 1.{t} 2.{t} 0.1 0 0 0 97605.{t} host 0.{t}\n"
        f"FLASER 3 1.1 1.2 1.3 1.{t} 2.{t} 0.1 1.{t} 2.{t} 0.1 97605.{t} host 0.{t}\n"
        for t in range(10, 20)
    ),
    "".join(
        f"ROBOTLASER1 0 -1.5 3.1 0.1 80 0.1 0 2 1.1 1.2 1 7 "
        f"1.{t} 2 0 1.{t} 2.{t} 0 0 0 0.1 0.1 9 97605.{t} host 0.{t}\n"
        for t in range(10, 20)
    ),
)

MF_JSON = (
    """{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"id": "a"},
"crs": {"type": "Name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}},
"temporalGeometry": {"type": "MovingPoint", "interpolation": "Linear",
 "coordinates": [[11.5, 48.1, 500], [11.6, 48.1, 501]],
 "datetimes": ["2024-05-04T08:00:00Z", "2024-05-04T08:00:10Z"]},
"temporalProperties": [{"datetimes": ["2024-05-04T08:00:00Z", "2024-05-04T08:00:10Z"],
 "speed": {"type": "Measure", "values": [3, 4]}}]}]}""",
    """{"type": "Feature", "properties": {"id": "a", "speed": [3, 4],
 "datetimes": [1714809600000, 1714809610000]},
"geometry": {"type": "LineString", "coordinates": [[11.5, 48.1], [11.6, 48.1]]}}""",
    """{"type": "MovingGeogPoint", "crs": {"type": "Name", "properties": {"name": "EPSG:4326"}},
"sequences": [{"coordinates": [[11.5, 48.1], [11.6, 48.1]], "lower_inc": true,
 "datetimes": ["2024-05-04T08:00:00+00", "2024-05-04T08:00:10+00"]},
{"coordinates": [[11.7, 48.1]], "datetimes": ["2024-05-04T08:00:20+00"]}]}""",
    """{"type": "Feature", "temporalGeometry": {"type": "MovingGeometryCollection", "prisms": [
{"type": "MovingPoint", "coordinates": [11.5, 48.1], "datetimes": "2024-05-04T08:00:00Z"},
{"type": "MovingPolygon", "coordinates": [], "datetimes": []}]}}""",
)

ROADS_GEOJSON = (
    """{"type": "FeatureCollection", "features": [
{"type": "Feature", "properties":
 {"highway": "primary", "oneway": "yes", "maxspeed": "50", "name": "High Street"},
 "geometry": {"type": "LineString", "coordinates":
 [[11.5, 48.1], [11.51, 48.1], [11.52, 48.11]]}},
{"type": "Feature", "properties": {"highway": "footway", "oneway": "no"},
 "geometry": {"type": "MultiLineString", "coordinates":
 [[[11.51, 48.1], [11.51, 48.12]], [[11.5, 48.1], [11.5, 48.12]]]}}]}""",
)

ROADS_GRAPHML = (
    """<?xml version="1.0" encoding="UTF-8"?>
<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
<key id="d0" for="node" attr.name="x" attr.type="double"/>
<key id="d1" for="node" attr.name="y" attr.type="double"/>
<key id="d2" for="edge" attr.name="oneway" attr.type="string"/>
<key id="d3" for="edge" attr.name="geometry" attr.type="string"/>
<key id="d4" for="edge" attr.name="maxspeed" attr.type="string"/><graph edgedefault="directed">
<node id="1"><data key="d0">11.5</data><data key="d1">48.1</data></node>
<node id="2"><data key="d0">11.6</data><data key="d1">48.1</data></node>
<node id="3"><data key="d0">11.6</data><data key="d1">48.2</data></node>
<edge source="1" target="2"><data key="d2">True</data><data key="d4">['30', '50']</data></edge>
<edge source="2" target="3">
<data key="d3">LINESTRING (11.6 48.1, 11.61 48.15, 11.6 48.2)</data></edge>
</graph></graphml>
""",
)

ROADS_CSV = (
    """name,wkt,oneway,maxspeed
High Street,"LINESTRING (11.5 48.1, 11.6 48.1)",yes,50
,"MULTILINESTRING ((11.6 48.1, 11.6 48.2))",no,
""",
    "u,v,u_lon,u_lat,v_lon,v_lat\n0,1,11.5,48.1,11.6,48.1\n1,2,11.6,48.1,11.6,48.2\n",
)

ROADS_OSM = (
    """<?xml version="1.0" encoding="UTF-8"?>
<osm version="0.6">
<node id="1" lat="48.1" lon="11.5"/><node id="2" lat="48.11" lon="11.5"/>
<node id="3" lat="48.12" lon="11.51"/>
<way id="7"><nd ref="1"/><nd ref="2"/><nd ref="3"/>
<tag k="highway" v="residential"/><tag k="oneway" v="yes"/>
<tag k="maxspeed" v="30 mph"/></way>
<way id="8"><nd ref="3"/><nd ref="1"/><tag k="highway" v="service"/></way>
</osm>
""",
    """<?xml version="1.0" encoding="UTF-8"?>
<osm version="0.6" upload="false">
<node id="-1" lat="48.1" lon="11.5"/><node id="-2" lat="48.11" lon="11.5"/>
<way id="-1"><nd ref="-1"/><nd ref="-2"/><tag k="highway" v="road"/>
<tag k="gpszip:speed" v="8.5"/></way>
</osm>
""",
)

TIMES = ("time,note\n0\n10.5,a\n2024-05-04T08:00:00Z\n1714809600\n", "10\n20\n")


def _texts(texts: Sequence[str]) -> Callable[[], Sequence[bytes]]:
    return lambda: [text.encode() for text in texts]


@cache
def _histories() -> Sequence[bytes]:
    from datetime import UTC, datetime, timedelta

    from oracle import google

    start = datetime(2024, 5, 4, tzinfo=UTC)
    rows = [(start + timedelta(minutes=i), 48 + i / 1e3, 11.5, 7 + i % 2) for i in range(6)]
    histories = [
        google.records(rows),
        google.old_records(rows),
        google.android(rows, rows),
        google.ios(rows),
        google.edits(rows),
        google.months(rows),
    ]
    return [google.encode(history) for history in histories]


@cache
def _fits() -> Sequence[bytes]:
    from oracle import fit

    start = 1_700_000_000
    records = [
        fit.record(start + i, 48 + i / 1e4, 11, [(3, fit.UINT8, 100 + i)], [(0, i)])
        for i in range(12)
    ]
    described = fit.developer_field("note")
    ends = fit.session(start, fit.SWIMMING), fit.session(start + 6, fit.RUNNING)
    ride = fit.fit(fit.file_id(), *described, *records, *ends)
    return [ride, ride + fit.fit(fit.file_id(fit.COURSE), *described, *records, endian=">")]


@cache
def _arrays() -> Sequence[bytes]:
    import numpy as np

    t = np.arange(12.0)
    rows = np.zeros(12, [("t", "<i4"), ("lat", ">f8"), ("lon", "<f4"), ("id", "U2")])
    rows["t"], rows["lat"], rows["id"] = t, 48 + t / 1e3, "a"
    files = [io.BytesIO() for _ in range(3)]
    np.savez(files[0], t=t, pos=np.column_stack([t * 3, t * 4]), speed=t)
    np.savez_compressed(files[1], time=t, x=t, y=t)
    np.save(files[2], rows)
    return [file.getvalue() for file in files]


@cache
def _hdf5s() -> Sequence[bytes]:
    import h5py
    import numpy as np

    t = np.arange(12.0)
    files = [io.BytesIO() for _ in range(2)]
    with h5py.File(files[0], "w") as file:
        file["gps/time"], file["gps/lat"], file["gps/lon"], file["imu/a"] = t, t, t, t[:3]
        file["gps/lat"].attrs["scale_factor"] = 0.5
    with h5py.File(files[1], "w") as file:
        file["t"] = np.array([f"2024-05-04T08:00:{i + 10}Z" for i in range(12)], "S")
        file.create_dataset("pos", data=np.column_stack([t, t]), chunks=(4, 2), compression="gzip")
    return [file.getvalue() for file in files]


@cache
def _flights() -> Sequence[bytes]:
    """Logs of PX4, of ArduPilot (binary and text) and of MAVLink."""
    return [*_ulogs(), *_dataflashes(), *_tlogs()]


@cache
def _ulogs() -> Sequence[bytes]:
    from oracle import ulog

    start = ulog.header() + ulog.flags() + ulog.topic("vehicle_gps_position", ulog.GPS)
    start += ulog.topic("vehicle_local_position", ulog.LOCAL)
    start += ulog.subscription(0, "vehicle_gps_position")
    start += ulog.subscription(1, "vehicle_local_position")
    body = ulog.dropout(20)
    for i in range(12):
        time = 5_000_000 + i * 200_000
        at = (480_000_000 + i, 115_000_000, 500_000)
        body += ulog.data(0, ulog.GPS, time, time + 1_700_000_000_000_000, *at, 1.0, 2.0, 3, 9)
        body += ulog.data(1, ulog.LOCAL, time, i, 4, -5, 1, 1, 0, True)
    return [start + body, start.replace(ulog.flags(), ulog.flags(len(start)), 1) + body]


@cache
def _dataflashes() -> Sequence[bytes]:
    from oracle import dataflash

    types, labels = dataflash.NEW
    rows = [
        (i, i % 2, 3, 518_400_000 + i * 200, 2312, 9, 1.2, 48.1 + i / 1e5, 11.5, 512.25, 12.5, 90.0)
        for i in range(12)
    ]
    head = dataflash.start() + dataflash.describe(130, "GPS", types, labels)
    text = f"FMT, 128, 89, FMT, BBnNZ, Type\r\nFMT, 130, 50, GPS, {types}, {labels}\r\n"
    return [
        head + b"".join(dataflash.message(130, types, *row) for row in rows),
        (text + "".join(dataflash.text("GPS", types, *row) for row in rows)).encode(),
    ]


@cache
def _tlogs() -> Sequence[bytes]:
    from oracle import mavlink

    frames = [
        mavlink.frame(1_700_000_000 + i, number, payload, version, signed=signed)
        for i in range(12)
        for number, payload, version, signed in (
            (mavlink.GPS, mavlink.gps(48 + i / 1e5, 11), 1, False),
            (mavlink.GLOBAL, mavlink.position(48 + i / 1e5, 11), 2, i % 2 == 1),
        )
    ]
    return [b"".join(frames), frames[0]]


@cache
def _parquets() -> Sequence[bytes]:
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    t = np.arange(40)
    tables = [
        pa.table(
            {
                "t": t * 1.0,
                "x": t * 3.0,
                "y": t % 7 * 0.5,
                "id": pa.array(["a", "b"] * 20).dictionary_encode(),
            }
        ),
        pa.table(
            {
                "time": pa.array(t * 1000, pa.timestamp("ms", "UTC")),
                "lat": 48 + t / 1e3,
                "lon": 11 + t / 1e3,
                "speed": pa.array(t, pa.int32()),
            }
        ),
    ]
    return [_parquet(pq, table, kind) for table in tables for kind in ("none", "snappy", "zstd")]


@cache
def _geoparquets() -> Sequence[bytes]:
    import numpy as np
    import pyarrow as pa
    import pyarrow.parquet as pq

    from gpszip.io.logs.write import write_tracks
    from gpszip.model import Track
    from oracle.geometries import line, point

    # A file as GPSZip writes it
    written = io.BytesIO()
    times, ele = np.arange(20.0), np.arange(20.0)
    positions = np.column_stack([times, times])
    track = Track("a", times, positions, attributes={"ele": ele})
    write_tracks([track], written, "geoparquet")
    # Points with z, and lines with m
    points = [point((11 + i / 1e3, 48, 5), axes="z") for i in range(8)]
    lines = [line([(11, 48, 0), (12, 49, 9)], axes="m"), None]
    tables = [pa.table({"t": range(len(cells)), "g": cells}) for cells in (points, lines)]
    geo = b'{"primary_column": "g", "columns": {"g": {"encoding": "WKB", "geometry_types": []}}}'
    marked = [table.replace_schema_metadata({b"geo": geo}) for table in tables]
    return [written.getvalue(), *(_parquet(pq, table, "none") for table in marked)]


@cache
def _geodata(format: str) -> Sequence[bytes]:
    import numpy as np

    from gpszip.io.logs.write import write_tracks
    from gpszip.model import Track

    written = io.BytesIO()
    times = np.arange(20.0)
    track = Track("a", times, np.column_stack([times, times]), attributes={"ele": times})
    write_tracks([track], written, format)
    return [written.getvalue()]


def _parquet(pq: object, table: object, compression: str) -> bytes:
    out = io.BytesIO()
    pq.write_table(table, out, compression=compression)  # type: ignore[attr-defined]
    return out.getvalue()


@cache
def _bags() -> Sequence[bytes]:
    """Bags of ROS 1 and ROS 2, and an MCAP file; the start of a bag without the extra ros."""
    if not find_spec("rosbags"):
        return [b"#ROSBAG V2.0\n"]
    from ros_bags import START, write_bag

    def messages(m: Any) -> Any:
        yield "/tf_static", START, m.transforms(m.transform(0, (1, 2, 3), child="gps"))
        for i in range(20):
            ns, p = START + i * 10**8, (i, i % 7, 0)
            moved = m.transform(ns, p, frame="gps", child="robot")
            yield "/tf", ns, m.transforms(moved, m.transform(ns, p))
            yield "/odom", ns, m.odometry(ns, p)

    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        paths = [write_bag(Path(folder) / kind, kind, messages) for kind in ("sqlite", "mcap")]
        files = [
            next(path.glob(f"*.{end}")) for path, end in zip(paths, ("db3", "mcap"), strict=True)
        ]
        files.append(write_bag(Path(folder) / "log", "bag", messages))
        return [file.read_bytes() for file in files]


def _road_parquets() -> Sequence[bytes]:
    """A map in degrees, and one in metres."""
    import numpy as np

    from gpszip.model import Plane, RoadMap

    nodes = np.array([[0.0, 0.0], [300.0, 0.0], [300.0, 400.0]])
    edges, counts = np.array([[0, 1], [1, 2]], np.int32), np.ones(2, np.int64)
    files = []
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        for number, plane in enumerate((None, Plane(((480_000_000, 110_000_000),)))):
            path = Path(folder) / f"{number}.parquet"
            RoadMap(nodes, edges, counts, counts, plane).save(path)
            files.append(path.read_bytes())
    return files


@cache
def _models() -> Sequence[bytes]:
    """What gpszip segments writes: a model in degrees, and one in metres."""
    degrees = [[11.5, 48.1], [11.51, 48.1]]
    models = [
        ("[[48.1, 11.5]]", '["lat", "lon"]', [end[::-1] for end in degrees]),
        ("null", '["x", "y"]', [[0.0, 0.0], [9.5, 1.25]]),
    ]
    return [
        f"""{{"kind": "segment mean", "coordinates": {axes}, "planes": {planes}, "sigma": 0.5,
"segments": [
{{"segment": 0, "start": {ends[0]}, "end": {ends[1]}, "parts": 2, "begins": 1}},
{{"segment": 1, "start": {ends[1]}, "end": {ends[0]}, "parts": 1, "begins": 0}}
],
"transitions": [
{{"from": 0, "to": 1, "count": 1, "probability": 1.0}},
{{"from": 1, "to": 0, "count": 1, "probability": 1.0}}
]}}""".encode()
        for planes, axes, ends in models
    ]


@cache
def _coresets() -> Sequence[bytes]:
    from gpszip import Track, coreset
    from gpszip.io.coresets import write_coreset

    out = io.BytesIO()
    tracks = [
        Track(name, range(60), [[abs(t % 20 - 10), t / 9 + i] for t in range(60)])
        for i, name in enumerate(("a", "b"))
    ]
    write_coreset(coreset(tracks, size=9), out)
    return [out.getvalue()]


@cache
def _prepared() -> Sequence[bytes]:
    """A prepared network in degrees, and one in metres."""
    from gpszip.pipeline.match import prepare_network

    in_degrees = ROADS_GEOJSON[0]
    in_metres = in_degrees.replace("[11.", "[1170.").replace(" 48.", " 4810.")
    in_metres = '{"gpszip": 1, "metres": 1, ' + in_metres[1:]
    files = []
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        for text in (in_degrees, in_metres):
            path, out = Path(folder) / "roads.geojson", io.BytesIO()
            path.write_text(text)
            prepare_network((str(path),)).write(out)
            files.append(out.getvalue())
    return files


def _apply_to_prepared(seed: bytes, changes: Sequence[Mutation]) -> bytes:
    """Change a prepared network, and correct the checksums of its front and its only block."""
    # Half of the changes are to the front, half to the block.
    index = 48 + int.from_bytes(seed[40:48], "little")
    front, body = seed[: index + 64], seed[index + 68 :]
    for change in changes:
        if change.position < 0.5:
            within = Mutation(change.kind, 2 * change.position, change.amount)
            front = mutations.apply(front, [within])
        else:
            within = Mutation(change.kind, 2 * change.position - 1, change.amount)
            body = mutations.apply(body, [within])

    if len(front) == index + 64:
        front = front[: index + 24] + struct.pack("<I", zlib.crc32(body)) + front[index + 28 :]
    return front + struct.pack("<I", zlib.crc32(front)) + body


@cache
def _pbfs() -> Sequence[bytes]:
    """The roads of OSM XML in OSM's binary format; as XML without osmium."""
    try:
        import osmium
    except ImportError:
        return [ROADS_OSM[0].encode()]
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        xml, pbf = Path(folder) / "roads.osm", Path(folder) / "roads.osm.pbf"
        xml.write_text(ROADS_OSM[0])
        with osmium.SimpleWriter(str(pbf)) as writer:
            for item in osmium.FileProcessor(str(xml)):
                writer.add(item)
        return [pbf.read_bytes()]


def _plain_walks(data: bytes) -> object:
    from gpszip.codec.plain.decode import decode_plain
    from gpszip.codec.plain.work import TooMuchWorkError, WorkLimit
    from gpszip.model import QuantisationGrid

    grid = QuantisationGrid((0, 0), 0, 128, 150)
    with contextlib.suppress(TooMuchWorkError):
        return decode_plain(data, 2, 2, grid, WorkLimit(300_000))


@cache
def _payloads() -> Sequence[bytes]:
    from gpszip.archive import open_archive

    archives = [open_archive(archive) for archive in _archives()]
    groups = [group for archive in archives for group in archive.contents.groups]
    return [group.payload for group in groups if group.tracks == 2]


@cache
def _archives() -> Sequence[bytes]:
    from cli.conftest import two_walks
    from gpszip import Track, compress
    from gpszip.model import Plane

    plane = Plane(((480_000_000, 110_000_000),))
    t = [float(i) for i in range(60)]
    track = Track(
        "a",
        t,
        [[abs(i % 20 - 10) * 3.0, i / 9] for i in t],
        attributes={"speed": t, "note": ["x", "yy", ""] * 20},
    )
    archives = [
        two_walks(),
        two_walks(plane),
        two_walks(timed=False),
        compress(track, max_error=0.5),
        compress(track, max_error=0.5, keep=("speed", "note"), layer="bz2"),
        compress(track, max_error=0.5, keep_within={"speed": 0.5}),
        compress(track, max_error=0.5, keep_within={"speed": 0.3048}),
    ]
    files = [archive.to_bytes() for archive in archives]
    return [*files, _with_sections(files[0])]


def _exact_logs(data: bytes) -> None:
    from gpszip.lossless.logs import read_exact_logs

    read_exact_logs(data, _exact_trails()).check()


@cache
def _exact_trails() -> Trails:
    """Walks that predict one of these logs."""
    from gpszip.archive.exact import find_trails
    from gpszip.model import Options, Track
    from gpszip.pipeline.compress import compress

    walks = [Track(name, range(80), [[7.0 * i, 2.0 * i] for i in range(80)]) for name in ("1", "2")]
    return find_trails(compress(walks, Options(rmse=1, effort=1))[0])


@cache
def _exact_bodies() -> list[bytes]:
    """Logs that are kept byte by byte."""
    from gpszip.lossless.logs import write_exact_logs

    rows = [f"{i},{i * i % 97}.50,2024-05-{i % 30 + 1:02}T07:08:09Z,a{i:03}\n" for i in range(80)]
    walks = [f"{name},{i},{7 * i}.25,{2 * i}\n" for name in (1, 2) for i in range(80)]
    logs = [
        {"a.csv": "".join(rows)},
        {"b": "x\n" * 9, "c": "", "d": "7,-0.0\n7,1e-05\n"},
        {"walks.csv": "".join(walks)},
    ]
    bodies = []
    for texts in logs:
        sink = io.BytesIO()
        pairs = [(name, lambda text=text: [text.encode()]) for name, text in texts.items()]
        write_exact_logs(pairs, sink, _exact_trails())
        bodies.append(sink.getvalue())
    return [*bodies, _rows_in_turn(walks), _typed_columns()]


def _rows_in_turn(walks: list[str]) -> bytes:
    """Rows of two tracks in turn, which are kept track by track."""
    from gpszip.lossless.layout import TableLayout
    from gpszip.lossless.logs import write_exact_logs

    sink, header = io.BytesIO(), b"id,t,x,y\n"
    text = header + "".join(sorted(walks, key=lambda row: int(row.split(",")[1]))).encode()
    layout = TableLayout(ord(","), header, has_header=True, width=4, track_column=0)
    write_exact_logs([("a.csv", lambda: [text])], sink, _exact_trails(), {"a.csv": layout})
    return sink.getvalue()


def _typed_columns() -> bytes:
    """Columns with types, as of Parquet."""
    import pyarrow as pa

    from gpszip.lossless.frame_logs import FrameHead, FrameSource
    from gpszip.lossless.logs import write_exact_logs

    rows = range(60)
    columns = {
        "id": [f"{i % 2}" for i in rows],
        "t": pa.array([i * 10**9 for i in rows]).cast(pa.timestamp("ns")),
        "x": [None if i == 9 else i / 4 for i in rows],
        "note": [f"a\nb{i % 7}" for i in rows],
        "pair": [{"a": float(i), "b": None} for i in rows],
        "parts": [[i] * (i % 3) for i in rows],
    }
    batch = pa.record_batch(columns)
    source = FrameSource(FrameHead(batch.schema, "zstd", (60,), 0), lambda _: iter([batch]))
    sink = io.BytesIO()
    log = ("a.parquet", lambda: [bytes(10**5)])
    write_exact_logs([log], sink, _exact_trails(), frames={"a.parquet": source})
    return sink.getvalue()


def _with_sections(small: bytes) -> bytes:
    """Write an archive in the form of large ones."""
    from dataclasses import replace

    from gpszip.container.contents import Section
    from gpszip.container.reader import from_bytes
    from gpszip.container.writer import to_bytes

    contents = from_bytes(small)
    return to_bytes(replace(contents, extras=(Section(200, bytes(70_000)),)))


def _apply_to_table(seed: bytes, changes: Sequence[Mutation]) -> bytes:
    """Change the table in a Parquet file: values, types, columns, rows and metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(seed))
    for change in changes:
        # Some tables can't be made.
        with contextlib.suppress(pa.ArrowException, OverflowError, TypeError, ValueError):
            table = _change_table(table, change)
    return _parquet(pq, table, "none")


def _change_table(table: Any, change: Mutation) -> Any:
    """Make one of nine changes to a column or to the table."""
    import pyarrow as pa

    column, how = divmod(int(change.position * table.num_columns * 9), 9)
    name, values = table.column_names[column], table.column(column).to_pylist()
    row = int(change.amount * len(values))
    odd_values = (None, math.nan, math.inf, -1.0, 1e300, 0.0, 2.0**53, -(2.0**63), 1e-300)
    odd_value = odd_values[int(change.amount * 1000) % len(odd_values)]

    # 0 to 3: other values
    if how < 4 and values:
        values[row] = odd_value
        if how == 0:
            values = [odd_value] * len(values)
        return table.set_column(column, name, pa.array(values, from_pandas=False))

    # 4: another type
    if how == 4:
        kinds = (
            pa.string(),
            pa.int8(),
            pa.float32(),
            pa.bool_(),
            pa.binary(),
            pa.list_(pa.float64()),
            pa.timestamp("ns"),
            pa.date32(),
            pa.null(),
        )
        kind = kinds[int(change.amount * len(kinds))]
        cells = [[1.0]] * len(values) if pa.types.is_list(kind) else [None] * len(values)
        return table.set_column(column, name, pa.array(cells, kind))

    # 5 and 6: no column, or one of another name
    if how == 5:
        return table.remove_column(column) if table.num_columns > 1 else table
    if how == 6:
        names = [*table.column_names]
        new_names = (names[-1], "", "lat", "t", "\0", "x" * 10_000, "time")
        names[column] = new_names[int(change.amount * len(new_names))]
        return table.rename_columns(names)

    # 7: other rows
    if how == 7 and change.amount < 0.7:
        return table.slice(row, int(change.amount * 9))
    if how == 7:
        return pa.concat_tables([table, table.slice(row)])

    # 8: other metadata
    metadata = table.schema.metadata or {b"gpszip.coreset": b"{}"}
    key = next(iter(metadata))
    mutation = Mutation("number for word", change.amount, change.position)
    return table.replace_schema_metadata({key: mutations.apply(metadata[key], [mutation])})


def _apply_to_archive(seed: bytes, changes: Sequence[Mutation]) -> bytes:
    """Change an archive, and correct its checksums."""
    from oracle import archives

    # A small archive has one checksum.
    if len(seed) < 65_536:
        changed = mutations.apply(seed[:-4], changes)
        return changed + struct.pack("<I", zlib.crc32(changed))

    # A large one has a checksum for each section, and one at the end for these.
    from gpszip.container.verify import verify_bytes

    sections = [
        seed[section.offset : section.offset + section.size]
        for section in verify_bytes(seed).sections
    ]
    for change in changes:
        i = min(int(change.position * len(sections)), len(sections) - 1)
        within = Mutation(change.kind, change.position * len(sections) % 1, change.amount)
        body = mutations.apply(sections[i][4:-4], [within])
        sections[i] = b"\xa7SEC" + body + struct.pack("<I", zlib.crc32(body))
    return archives.large([section for section in sections if len(section) > 8], third=seed[2])


def _live_lines(data: bytes) -> object:
    """Read lines as they come to a listener: CSV, JSON lines, NMEA or messages of apps."""
    from gpszip.live.formats.text import TextParser
    from gpszip.live.formats.values import Context
    from gpszip.live.notices import Notices
    from gpszip.live.screening import Screen

    parser, context = TextParser("log"), Context(1.8e9, "fuzz")
    found = [item for line in data.splitlines() for item in parser.push(line, context)]
    screen = Screen(Notices(str))
    return [screen.check(item) for item in found if hasattr(item, "position")]


def _stream(data: bytes) -> object:
    """Read a few lines at a time, as ``compress --stream`` does."""
    from gpszip.io.logs.raw import Request
    from gpszip.live.stream.rows import StreamReader

    reader, lines = StreamReader("log", Request(), clean=True), data.splitlines(keepends=True)
    batches = [reader.read(lines[first : first + 3]) for first in range(0, len(lines), 3)]
    for times, positions in (rows for batch in batches for rows in batch.tracks.values()):
        assert np.isfinite(times).all() and np.isfinite(positions).all()
        assert len(times) == len(positions)
    return batches


def _live_messages() -> list[bytes]:
    """Messages of apps and of gpsd, one on each line."""
    from gpszip.live.replay.messages import Sample, app_message

    samples = [Sample("ann", 1.795e9 + t, 48.1 + t / 1e4, 11.5) for t in range(4)]
    messages = [
        app_message(app, samples[:1] if app != "overland" else samples).body or b""
        for app in ("owntracks", "overland", "traccar")
    ]
    report = b'{"class":"TPV","device":"a","mode":3,"time":"2026-11-18T11:06:40Z","lat":1,"lon":2}'
    return [b"\n".join([*messages, report])]


def _live_servers(data: bytes) -> object:
    """Read lines as messages of rosbridge, of Signal K, and of Kafka."""
    from gpszip.live.formats.ros import frame_of, parse_ros
    from gpszip.live.formats.signalk import SignalKParser
    from gpszip.live.formats.values import Context, MessageError, parse_json
    from gpszip.live.notices import Notices
    from gpszip.live.screening import Screen

    parser, context = SignalKParser("", Notices(str)), Context(1.8e9, "a", "b")
    found = []
    for line in data.splitlines():
        try:
            message = parse_json(line, lambda _name: None)
        except MessageError:
            continue
        found += [*parser.parse(message, context), parse_ros(message, context)]
        if isinstance(message, dict):
            found.append(parse_ros(message.get("msg"), context))
        frame_of(message)
    screen = Screen(Notices(str))
    return [screen.check(item) for item in found if hasattr(item, "position")]


def _live_server_messages() -> list[bytes]:
    """Messages of rosbridge and Signal K, one on each line."""
    from gpszip.live.replay.messages import Sample, ros_message, signalk_delta

    samples = [Sample("ann", 1.795e9 + t, 48.1 + t / 1e4, 11.5) for t in range(3)]
    pose = (
        b'{"header":{"stamp":{"sec":7,"nanosec":5},"frame_id":"map"},"pose":{"pose":{"position":'
        b'{"x":1.0,"y":2.0},"orientation":{"x":0,"y":0,"z":0,"w":1}},"covariance":[0.1]},'
        b'"twist":{"twist":{"linear":{"x":3,"y":4}}}}'
    )
    delta = (
        b'{"context":"vessels.self","updates":[{"source":{"label":"a"},"values":[{"path":'
        b'"navigation.speedOverGround","value":5}]}]}'
    )
    return [b"\n".join([*map(ros_message, samples), *map(signalk_delta, samples), pose, delta])]


def _mavlink(data: bytes) -> object:
    """Read the bytes of a link of MAVLink."""
    from gpszip.live.formats.mavlink import MavlinkParser
    from gpszip.live.notices import Notices
    from gpszip.live.sources.mavlink import Packets

    return [
        Packets(MavlinkParser("a", Notices(str), local=local)).push(data, 1.8e9)
        for local in (False, True)
    ]


def _mavlink_links() -> list[bytes]:
    from importlib.util import find_spec

    if find_spec("pymavlink") is None:
        return [b""]
    from pymavlink.dialects.v20 import common

    link = common.MAVLink(None, 1, 1)
    messages = [
        link.system_time_encode(1_795_000_000_000_000, 5_000),
        link.global_position_int_encode(6_000, 481_000_000, 115_000_000, 0, 0, 1, 2, 3, 4),
        link.local_position_ned_encode(7_000, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
    ]
    return [b"".join(message.pack(link) for message in messages)]


def _segment(data: bytes) -> object:
    """Read a segment of a journal."""
    from gpszip.live.journal import read_segment

    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        path = Path(folder) / "1.log"
        path.write_bytes(data)
        return list(read_segment(path))


def _journal_segments() -> list[bytes]:
    from gpszip.live.fix import Fix
    from gpszip.live.journal import encode_record

    fixes = [Fix("ann", "http", 1.795e9 + t, 1.795e9, (48.1, 11.5)) for t in range(4)]
    return [b"gpszip journal 1\n" + b"".join(map(encode_record, fixes))]


TARGETS = {
    "csv": Target(_log("csv"), _texts(CSV)),
    "csv, kept and cleaned": Target(
        _log("csv", keep=("speed",), clean=True, sort=True), _texts(CSV[1:2])
    ),
    "gpx": Target(_log("gpx", keep=("ele",), split=True), _texts(GPX)),
    "kml": Target(_log("kml", keep=("ele",), heading=True, split=True), _texts(KML)),
    "tcx": Target(_log("tcx", keep=("ele",), split=True), _texts(TCX)),
    "geojson": Target(_log("geojson", sort=True), _texts(GEOJSON)),
    "mf-json": Target(_log(None, sort=True), _texts(MF_JSON)),
    "mf-json, kept": Target(_log("geojson", sort=True, keep=("speed",)), _texts(MF_JSON)),
    "parquet": Target(_log("parquet"), _parquets, mutations.BINARY),
    "parquet, table": Target(_log("parquet"), _parquets, mutations.BINARY, _apply_to_table),
    "tum": Target(_log("tum", heading=True, keep=("qw",), sort=True), _texts(TUM)),
    "euroc": Target(_log("euroc", heading=True, keep=("p_RS_R_x",), sort=True), _texts(EUROC)),
    "kitti": Target(_log("kitti", heading=True, rate=10.0), _texts(KITTI)),
    "ros topic": Target(_log("ros", topics="/odom", heading=True), _bags, mutations.BINARY),
    "ros frame": Target(_log("ros", frame="map:robot", keep=("qw",)), _bags, mutations.BINARY),
    "tum, stored": Target(_stored(format="tum", sort=True), _texts(TUM)),
    "euroc, stored": Target(_stored(format="euroc", sort=True), _texts(EUROC)),
    "kitti, stored": Target(_stored(format="kitti", rate=10.0), _texts(KITTI)),
    "csv, stored": Target(_stored(format="csv", clean=True, sort=True), _texts(CSV)),
    "xml, stored": Target(_stored(split=True), _texts(GPX + KML + TCX)),
    "parquet, stored": Target(_stored(format="parquet"), _parquets, mutations.BINARY),
    "geoparquet": Target(_log("parquet"), _geoparquets, mutations.BINARY),
    "geoparquet, table": Target(
        _log("parquet", skip_bad=True), _geoparquets, mutations.BINARY, _apply_to_table
    ),
    "geoparquet, stored": Target(_stored(format="parquet"), _geoparquets, mutations.BINARY),
    "gpkg": Target(_log("gpkg", sort=True), partial(_geodata, "gpkg"), mutations.BINARY),
    "flatgeobuf": Target(
        _log("flatgeobuf", sort=True), partial(_geodata, "flatgeobuf"), mutations.BINARY
    ),
    "google": Target(_log("google", skip_bad=True, sort=True, keep=("accuracy",)), _histories),
    "google, stored": Target(_stored(format="google-paths", split=True), _histories),
    "fit": Target(_log("fit", skip_bad=True, sort=True, keep=("hr",)), _fits, mutations.BINARY),
    "nmea": Target(_log("nmea", keep=("alt", "speed"), sort=True), _texts(NMEA)),
    "nmea, stored": Target(_stored(format="nmea", split=True), _texts(NMEA)),
    "live lines": Target(_live_lines, _texts(CSV[:1])),
    "live nmea": Target(_live_lines, _texts(NMEA)),
    "live messages": Target(_live_lines, _live_messages),
    "stream": Target(_stream, _texts(CSV + NMEA + TUM + CARMEN)),
    "live servers": Target(_live_servers, _live_server_messages),
    "live mavlink": Target(_mavlink, _mavlink_links, mutations.BINARY),
    "journal": Target(_segment, _journal_segments),
    "owntracks": Target(_log("owntracks", keep=("speed",), sort=True), _texts(OWNTRACKS)),
    "igc": Target(_log("igc", keep=("alt", "fxa"), sort=True), _texts(IGC)),
    "plt": Target(_log("plt", keep=("alt",), sort=True), _texts(PLT)),
    "readsb": Target(_log("readsb", keep=("alt", "speed"), sort=True), _texts(READSB)),
    "ais": Target(_log("ais", keep=("Heading", "SOG"), sort=True), _texts(AIS)),
    "sumo": Target(_log("sumo", keep=("speed", "edge"), sort=True), _texts(SUMO)),
    "carmen": Target(_log("carmen", keep=("heading",), sort=True), _texts(CARMEN)),
    "npz": Target(_log("npz", sort=True), _arrays, mutations.BINARY),
    "hdf5": Target(_log("hdf5", sort=True), _hdf5s, mutations.BINARY),
    "ulog": Target(_log("ulog", skip_bad=True, sort=True), _ulogs, mutations.BINARY),
    "dataflash": Target(_log("dataflash", keep=("alt",), sort=True), _dataflashes),
    "tlog": Target(_log("tlog", keep=("speed",), sort=True), _tlogs, mutations.BINARY),
    "any log": Target(
        _log(None, skip_bad=True),
        lambda: [
            *_texts(CSV + GPX + KML + TCX + GEOJSON + NMEA + TUM + EUROC)(),
            *_texts(OWNTRACKS + IGC + PLT + READSB + AIS + SUMO + CARMEN)(),
            *_histories(),
            *_fits(),
            *_parquets(),
            *_arrays(),
            *_flights(),
        ],
    ),
    "roads geojson": Target(_network(".geojson"), _texts(ROADS_GEOJSON)),
    "roads graphml": Target(_network(".graphml"), _texts(ROADS_GRAPHML)),
    "roads csv": Target(_network(".csv"), _texts(ROADS_CSV)),
    "roads parquet": Target(_network(".parquet"), _road_parquets, mutations.BINARY),
    "roads osm": Target(_network(".osm"), _texts(ROADS_OSM)),
    "roads pbf": Target(_network(".osm.pbf"), _pbfs, mutations.BINARY),
    "roads prepared": Target(_network(".gpsz"), _prepared, mutations.BINARY),
    "roads prepared, sealed": Target(
        _network(".gpsz"), _prepared, mutations.BINARY, _apply_to_prepared
    ),
    "coreset": Target(_coreset, _coresets, mutations.BINARY),
    "coreset, table": Target(_coreset, _coresets, mutations.BINARY, _apply_to_table),
    "segments": Target(_segments, _models),
    "times": Target(_times, _texts(TIMES)),
    "times in text": Target(_times_in_text, _texts(("10,20.5,2024-05-04T08:00:00Z",))),
    "walks, plain": Target(_plain_walks, _payloads, mutations.BINARY),
    "exact logs": Target(_exact_logs, _exact_bodies, mutations.BINARY),
    "archive": Target(_archive, _archives, mutations.BINARY),
    "archive, sealed": Target(_archive, _archives, mutations.BINARY, _apply_to_archive),
}
