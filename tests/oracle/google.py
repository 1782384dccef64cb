"""Location histories as Google exports them, and a plain reader of them."""

import json
from datetime import timedelta


def iso(time):
    return time.isoformat(timespec="milliseconds")


def e7(degrees):
    return round(degrees * 1e7)


def records(rows, **more):
    """Rows of time, latitude, longitude and device."""
    return {
        "locations": [
            {
                "latitudeE7": e7(lat),
                "longitudeE7": e7(lon),
                "accuracy": 20 + i,
                "altitude": 500,
                "velocity": 3,
                "heading": 90,
                "activity": [{"timestamp": iso(time), "activity": [{"type": "STILL"}]}],
                "source": "WIFI",
                **({"deviceTag": device} if device else {}),
                "timestamp": iso(time),
            }
            for i, (time, lat, lon, device) in enumerate(rows)
        ],
        **more,
    }


def old_records(rows):
    """As exported until 2021: times in milliseconds, as texts."""
    return {
        "locations": [
            {
                "timestampMs": str(round(time.timestamp() * 1000)),
                "latitudeE7": e7(lat),
                "longitudeE7": e7(lon),
            }
            for time, lat, lon, _ in rows
        ]
    }


def signals(rows):
    return [
        {
            "position": {
                "LatLng": f"{lat:.7f}°, {lon:.7f}°",
                "accuracyMeters": 13,
                "altitudeMeters": 420.5,
                "source": "GPS",
                "timestamp": iso(time),
                "speedMetersPerSecond": 1.5,
            }
        }
        for time, lat, lon, _ in rows
    ] + [{"wifiScan": {"deliveryTime": "x", "devicesRecords": []}}, {"activityRecord": {}}]


def segments(rows):
    """Paths of Android, two points each, with a visit between."""
    out = []
    for i in range(0, len(rows), 2):
        path = rows[i : i + 2]
        ends = {"startTime": iso(path[0][0]), "endTime": iso(path[-1][0])}
        steps = [
            {"point": f"{lat:.7f}°, {lon:.7f}°", "time": iso(time)} for time, lat, lon, _ in path
        ]
        place = {"topCandidate": {"placeLocation": {"latLng": "0°, 0°"}}}
        out += [
            {**ends, "timelinePath": steps},
            {**ends, "startTimeTimezoneUtcOffsetMinutes": 120, "visit": place},
        ]
    return out


def android(rows, raw=()):
    return {
        "semanticSegments": segments(rows),
        "rawSignals": signals(raw),
        "userLocationProfile": {},
    }


def ios(rows):
    """A list of paths, whose times are whole minutes from the start of the path."""
    start = rows[0][0].replace(second=0, microsecond=0)
    steps = [
        {
            "point": f"geo:{lat:.6f},{lon:.6f}",
            "durationMinutesOffsetFromStartTime": str((time - start) // timedelta(minutes=1)),
        }
        for time, lat, lon, _ in rows
    ]
    ends = {"endTime": iso(rows[-1][0]), "startTime": iso(start)}
    return [
        {**ends, "visit": {"topCandidate": {"placeLocation": "geo:1,2"}}},
        {**ends, "timelinePath": steps},
        {**ends, "activity": {"start": "geo:1,2", "end": "geo:3,4"}},
    ]


def edits(rows):
    return {
        "timelineEdits": [
            {
                "deviceId": str(device),
                "rawSignal": {
                    "signal": {
                        "position": {
                            "point": {"latE7": e7(lat), "lngE7": e7(lon)},
                            "accuracyMm": 13_000,
                            "timestamp": iso(time),
                        }
                    },
                    "additionalTimestamp": iso(time),
                },
            }
            for time, lat, lon, device in rows
        ]
        + [{"deviceId": "1", "placeAggregates": {}}]
    }


def months(rows):
    """An activity through all points."""
    first, *between, last = rows
    steps = [
        {"latE7": e7(lat), "lngE7": e7(lon), "accuracyMeters": 10, "timestamp": iso(time)}
        for time, lat, lon, _ in between
    ]
    start, end = (
        {"latitudeE7": e7(lat), "longitudeE7": e7(lon)} for _, lat, lon, _ in (first, last)
    )
    return {
        "timelineObjects": [
            {
                "activitySegment": {
                    "startLocation": start,
                    "endLocation": end,
                    "duration": {"startTimestamp": iso(first[0]), "endTimestamp": iso(last[0])},
                    "simplifiedRawPath": {"points": steps},
                    "waypointPath": {"waypoints": [start, end]},
                }
            },
            {"placeVisit": {"location": start, "duration": {}}},
        ]
    }


def expected(rows, decimals=7, minutes=False):
    """Seconds and degrees of rows, as far as a form holds them."""
    return [
        (
            (time.replace(second=0, microsecond=0) if minutes else time).timestamp(),
            round(lat, decimals),
            round(lon, decimals),
        )
        for time, lat, lon, _ in rows
    ]


def encode(history, encoding="utf-8"):
    return json.dumps(history, ensure_ascii=False, indent=1).encode(encoding)
