"""A writer of ULog."""

import struct

TYPES = {"uint64_t": "Q", "int32_t": "i", "uint8_t": "B", "float": "f", "double": "d", "bool": "?"}

GPS = (
    "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;"
    "float[2] spare;float vel_m_s;float cog_rad;uint8_t fix_type;uint8_t satellites_used;"
    "uint8_t[2] _padding0;"
)
NEW_GPS = (
    "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;"
    "double altitude_msl_m;float vel_m_s;float cog_rad;uint8_t fix_type;uint8_t satellites_used;"
)
GLOBAL = "uint64_t timestamp;double lat;double lon;float alt;"
LOCAL = "uint64_t timestamp;float x;float y;float z;float vx;float vy;float heading;bool xy_valid;"


def message(kind, body):
    return struct.pack("<H", len(body)) + kind.encode() + body


def header():
    return b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 100)


def flags(*appended):
    offsets = [*appended, 0, 0, 0][:3]
    return message(
        "B", bytes(8) + bytes([bool(appended)]) + bytes(7) + struct.pack("<3Q", *offsets)
    )


def topic(name, fields):
    return message("F", f"{name}:{fields}".encode())


def subscription(number, name, source=0):
    return message("A", struct.pack("<BH", source, number) + name.encode())


def data(number, fields, *values):
    """A message; arrays are zeros, and padding at the end is left out."""
    body, left = struct.pack("<H", number), list(values)
    for item in fields.rstrip(";").split(";"):
        kind, name = item.split(" ")
        kind, _, length = kind.partition("[")
        if name.startswith("_padding"):
            continue
        code = "<" + TYPES[kind]
        count = int(length.rstrip("]")) if length else 0
        body += bytes(count * struct.calcsize(code)) if count else struct.pack(code, left.pop(0))
    assert not left
    return message("D", body)


def dropout(milliseconds):
    return message("O", struct.pack("<H", milliseconds))
