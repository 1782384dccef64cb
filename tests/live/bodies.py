"""Bodies as apps send them, of one position each."""

#: Seconds since 1970, the position, and the speed in m/s of all bodies.
TIME, LAT, LON, SPEED = 1_795_000_000, 48.137154, 11.576124, 5.0
ISO = "2026-11-18T11:06:40"


def owntracks(**more):
    return {
        "_type": "location",
        "lat": LAT,
        "lon": LON,
        "tst": TIME,
        "vel": 18,
        "acc": 12,
        "alt": 519,
        "batt": 80,
        "bs": 1,
        "cog": 270,
        "conn": "m",
        "created_at": TIME + 2,
        "m": 1,
        "t": "u",
        "tid": "an",
        "topic": "owntracks/ann/phone",
        "vac": 3,
        **more,
    }


def overland(count=1, **properties):
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [LON, LAT]},
            "properties": {
                "timestamp": f"{ISO}Z" if number == 0 else f"2026-11-18T11:07:{number:02}Z",
                "altitude": 519,
                "speed": SPEED,
                "course": 270,
                "horizontal_accuracy": 12,
                "vertical_accuracy": 3,
                "motion": ["driving"],
                "battery_state": "unplugged",
                "battery_level": 0.8,
                "wifi": "",
                "device_id": "ann",
                **properties,
            },
        }
        for number in range(count)
    ]
    return {"locations": features, "current": features[-1], "trip": {}}


def traccar(**more):
    return {
        "location": {
            "timestamp": f"{ISO}.000Z",
            "coords": {
                "latitude": LAT,
                "longitude": LON,
                "accuracy": 12,
                "speed": SPEED,
                "heading": 270,
                "altitude": 519,
            },
            "is_moving": True,
            "odometer": 7.0,
            "event": "motionchange",
            "battery": {"level": 0.8, "is_charging": False},
            "activity": {"type": "in_vehicle"},
            "extras": {},
            "uuid": "x",
        },
        "device_id": "ann",
        **more,
    }


OSMAND = f"id=ann&lat={LAT}&lon={LON}&timestamp={TIME}&speed=5.0&bearing=270&accuracy=12&batt=80"

GPSLOGGER = (
    f"aid=ann&lat={LAT}&lon={LON}&time={ISO}.000Z&timestamp={TIME}&spd=5.0&dir=270&acc=12"
    "&alt=519&batt=80&prov=gps&sat=9&desc="
)

#: The file of a day as GPSLogger posts it.
GPSLOGGER_FILE = (
    "time,lat,lon,elevation,accuracy,bearing,speed,satellites,provider\n"
    f"{ISO}.000Z,{LAT},{LON},519,12,270,5.0,9,gps\n"
)
