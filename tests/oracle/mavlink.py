"""A writer of telemetry logs of MAVLink."""

import struct

EXTRA = {24: 24, 33: 104, 0: 50}
GPS, GLOBAL, HEARTBEAT = 24, 33, 0


def checksum(data):
    """CRC-16/MCRF4XX, bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x8408 if crc & 1 else 0)
    return crc


def gps(lat, lon, alt=500, fix=3, speed=1234, course=9000, satellites=9):
    at = (round(lat * 1e7), round(lon * 1e7), round(alt * 1000))
    return struct.pack("<Q3i4H2B", 5, *at, 100, 100, speed, course, fix, satellites)


def position(lat, lon, alt=500, north=300, east=400, heading=9000):
    at = (round(lat * 1e7), round(lon * 1e7), round(alt * 1000), 10)
    return struct.pack("<I4i3hH", 5, *at, north, east, 0, heading)


def frame(time, number, payload, version=2, system=1, signed=False):
    """A frame after its time in seconds."""
    if version == 2:
        payload = payload.rstrip(b"\0") or b"\0"
        head = bytes([len(payload), signed, 0, 7, system, 1]) + number.to_bytes(3, "little")
    else:
        head = bytes([len(payload), 7, system, 1, number])
    body = head + payload
    crc = checksum(body + bytes([EXTRA[number]]))
    mark = bytes([0xFD if version == 2 else 0xFE])
    record = round(time * 1e6).to_bytes(8, "big") + mark + body + crc.to_bytes(2, "little")
    return record + bytes(13) * signed
