"""A writer of DataFlash logs, binary and as text, and the plain time of GPS."""

import struct
from datetime import UTC, datetime, timedelta

TYPES = {"Q": "Q", "I": "I", "H": "H", "B": "B", "L": "i", "e": "i", "E": "I", "c": "h", "f": "f"}
SCALED = {"L": 1e7, "e": 100, "E": 100, "c": 100}

#: Of today, and of 2013: the time of GPS has other names, and a second receiver its own message.
NEW = ("QBBIHBcLLeEf", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs")
OLD = ("BIHBcLLeeEe", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs")


def describe(kind, name, types, labels):
    size = 3 + struct.calcsize("<" + "".join(TYPES.get(letter, "16s") for letter in types))
    fields = struct.pack("<BB4s16s64s", kind, size, name.encode(), types.encode(), labels.encode())
    return b"\xa3\x95\x80" + fields


def start():
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", 128, 89, b"FMT", b"BBnNZ", b"Type,Length")


def message(kind, types, *values):
    numbers = [
        round(value * SCALED[letter]) if letter in SCALED else value
        for letter, value in zip(types, values, strict=True)
    ]
    code = "<" + "".join(TYPES[letter] for letter in types)
    return b"\xa3\x95" + bytes([kind]) + struct.pack(code, *numbers)


def text(name, types, *values):
    shown = [
        f"{value:.7f}" if letter == "L" else f"{value}"
        for letter, value in zip(types, values, strict=True)
    ]
    return f"{name}, {', '.join(shown)}\r\n"


def gps_time(utc):
    """Milliseconds of the week and the week of GPS time; for times since 2017."""
    since = utc - datetime(1980, 1, 6, tzinfo=UTC) + timedelta(seconds=18)
    week, rest = divmod(since, timedelta(weeks=1))
    return rest // timedelta(milliseconds=1), week
