"""Samples of a log as messages of apps and receivers."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import reduce
from types import MappingProxyType
from urllib.parse import quote, urlencode

from gpszip.errors import OptionError

__all__ = [
    "APPS",
    "NMEA",
    "HttpMessage",
    "Sample",
    "app_message",
    "nmea_sentences",
    "ros_message",
    "ros_topic",
    "row_message",
    "signalk_delta",
]

#: Name of the kind of messages that no app sends.
NMEA = "nmea"

#: Decimals of degrees: 0.1 mm.
_DECIMALS = 9

#: Decimals of minutes in NMEA: 0.2 mm.
_MINUTE_DECIMALS = 7

#: Years that two digits can tell.
_NMEA_YEARS = range(1980, 2080)


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample of a track in degrees.

    Parameters
    ----------
    track : str
        Name of the track.
    time : float
        Seconds since 1970.
    latitude, longitude : float
        Degrees.
    """

    track: str
    time: float
    latitude: float
    longitude: float


@dataclass(frozen=True)
class HttpMessage:
    """A request.

    Parameters
    ----------
    path : str
        Path below that of the server, with the query.
    body : bytes, optional
        Body in JSON; none for a query.
    """

    path: str
    body: bytes | None = None


def _owntracks(samples: Sequence[Sample]) -> HttpMessage:
    (sample,) = samples
    message = {
        "_type": "location",
        "tid": sample.track[:2],
        "lat": round(sample.latitude, _DECIMALS),
        "lon": round(sample.longitude, _DECIMALS),
        "tst": _number(sample.time),
    }
    return HttpMessage(f"?{urlencode({'u': sample.track})}", _json(message))


def _overland(samples: Sequence[Sample]) -> HttpMessage:
    features = [
        {
            "type": "Feature",
            "geometry": {
                "type": "Point",
                "coordinates": [
                    round(sample.longitude, _DECIMALS),
                    round(sample.latitude, _DECIMALS),
                ],
            },
            "properties": {"timestamp": _iso(sample.time), "device_id": sample.track},
        }
        for sample in samples
    ]
    return HttpMessage("", _json({"locations": features}))


def _traccar(samples: Sequence[Sample]) -> HttpMessage:
    (sample,) = samples
    coords = {
        "latitude": round(sample.latitude, _DECIMALS),
        "longitude": round(sample.longitude, _DECIMALS),
        "speed": -1,
        "heading": -1,
    }
    location = {"timestamp": _iso(sample.time), "coords": coords}
    return HttpMessage("", _json({"device_id": sample.track, "location": location}))


def _osmand(samples: Sequence[Sample]) -> HttpMessage:
    (sample,) = samples
    return HttpMessage(f"?{urlencode({'id': sample.track, **_fields(sample)})}")


def _gpslogger(samples: Sequence[Sample]) -> HttpMessage:
    (sample,) = samples
    return HttpMessage(f"/{quote(sample.track, safe='')}?{urlencode(_fields(sample))}")


#: Messages of each app by its name.
APPS: Mapping[str, Callable[[Sequence[Sample]], HttpMessage]] = MappingProxyType(
    {
        "owntracks": _owntracks,
        "overland": _overland,
        "traccar": _traccar,
        "osmand": _osmand,
        "gpslogger": _gpslogger,
    }
)

#: Samples of a message at most, for apps that send more than one.
BATCHES = MappingProxyType({"overland": 200})


def app_message(app: str, samples: Sequence[Sample]) -> HttpMessage:
    """Return the request of an app with some samples, one for most apps.

    Examples
    --------
    >>> app_message("osmand", [Sample("ann", 7.5, 48.1, 11.5)]).path
    '?id=ann&lat=48.1&lon=11.5&timestamp=7.5'
    """
    return APPS[app](samples)


def ros_message(sample: Sample) -> bytes:
    """Return what rosbridge publishes: a NavSatFix of the topic ``/TRACK/fix``."""
    seconds, parts = divmod(round(sample.time * 1e9), 10**9)
    message = {
        "header": {"stamp": {"sec": seconds, "nanosec": parts}, "frame_id": "gps"},
        "status": {"status": 0, "service": 1},
        "latitude": round(sample.latitude, _DECIMALS),
        "longitude": round(sample.longitude, _DECIMALS),
        "altitude": None,
        "position_covariance": [0.0] * 9,
        "position_covariance_type": 0,
    }
    return _json({"op": "publish", "topic": ros_topic(sample.track), "msg": message})


def ros_topic(track: str) -> str:
    """Return the topic of a track.

    Examples
    --------
    >>> ros_topic("line 7/a")
    '/line 7-a/fix'
    """
    return f"/{track.replace('/', '-')}/fix"


def signalk_delta(sample: Sample) -> bytes:
    """Return a delta of Signal K with the position of the vessel that has the track's name."""
    value = {
        "latitude": round(sample.latitude, _DECIMALS),
        "longitude": round(sample.longitude, _DECIMALS),
    }
    update = {
        "$source": "replay",
        "timestamp": _iso(sample.time),
        "values": [{"path": "navigation.position", "value": value}],
    }
    vessel = f"vessels.urn:mrn:gpszip:{sample.track.replace(':', '-')}"
    return _json({"context": vessel, "updates": [update]})


def row_message(sample: Sample) -> bytes:
    """Return an object of JSON with the columns of a table."""
    return _json({"id": sample.track, **_fields(sample)})


def nmea_sentences(sample: Sample) -> bytes:
    r"""Return the sentences of a receiver: RMC and GGA.

    Raises
    ------
    OptionError
        If the year is one that NMEA can't tell.

    Examples
    --------
    >>> rmc, gga = nmea_sentences(Sample("boat", 764380801.5, 48.1173, -11.5)).splitlines()
    >>> rmc
    b'$GPRMC,000001.500,A,4807.0380000,N,01130.0000000,W,,,230394,,,A*74'
    """
    when = datetime.fromtimestamp(round(sample.time, 3), UTC)
    if when.year not in _NMEA_YEARS:
        raise OptionError(
            f"track {sample.track!r}: NMEA has no year {when.year}",
            remedy="choose another kind with --as",
        )

    # Degrees and minutes in one number.
    clock = f"{when:%H%M%S}.{when.microsecond // 1000:03}"
    north = f"{_minutes(sample.latitude, 2)},{'S' if sample.latitude < 0 else 'N'}"
    east = f"{_minutes(sample.longitude, 3)},{'W' if sample.longitude < 0 else 'E'}"
    bodies = (
        f"GPRMC,{clock},A,{north},{east},,,{when:%d%m%y},,,A",
        f"GPGGA,{clock},{north},{east},1,08,1.0,,M,,M,,",
    )
    return b"".join(_with_checksum(body) for body in bodies)


def _with_checksum(body: str) -> bytes:
    data = body.encode("ascii")
    return b"$%s*%02X\r\n" % (data, reduce(lambda a, b: a ^ b, data, 0))


def _minutes(degrees: float, digits: int) -> str:
    # Rounded as a whole: 59.99999999 minutes are the next degree.
    scale = 60 * 10**_MINUTE_DECIMALS
    whole, rest = divmod(round(abs(degrees) * scale), scale)
    minutes, decimals = divmod(rest, 10**_MINUTE_DECIMALS)
    return f"{whole:0{digits}}{minutes:02}.{decimals:0{_MINUTE_DECIMALS}}"


def _fields(sample: Sample) -> dict[str, float | int]:
    return {
        "lat": round(sample.latitude, _DECIMALS),
        "lon": round(sample.longitude, _DECIMALS),
        "timestamp": _number(sample.time),
    }


def _number(time: float) -> float | int:
    # Apps send whole seconds; logs may have more.
    rounded = round(time, 6)
    return int(rounded) if rounded.is_integer() else rounded


def _iso(time: float) -> str:
    return datetime.fromtimestamp(round(time, 6), UTC).isoformat().replace("+00:00", "Z")


def _json(value: object) -> bytes:
    return json.dumps(value, separators=(",", ":")).encode("utf-8")
