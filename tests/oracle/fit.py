"""A writer of FIT files, from the description of the protocol."""

import struct

#: Seconds from 1970 to 1989-12-31.
EPOCH = 631_065_600

#: Base types: the number in definitions, and the letter of struct.
UINT8, ENUM, SINT32, UINT16, UINT32, STRING = (
    (0x02, "B"),
    (0x00, "B"),
    (0x85, "i"),
    (0x84, "H"),
    (0x86, "I"),
    (0x07, "s"),
)

FILE_ID, SESSION, LAP, RECORD, MONITORING = 0, 18, 19, 20, 55
FIELD_DESCRIPTION, DEVELOPER_DATA_ID = 206, 207

#: Kinds of files and sports by their numbers.
ACTIVITY, COURSE, MONITORING_B = 4, 6, 32
RUNNING, CYCLING, TRANSITION, SWIMMING = 1, 2, 3, 5


def semicircles(degrees):
    return round(degrees * 2**31 / 180)


def file_id(kind=ACTIVITY):
    return FILE_ID, [(0, ENUM, kind)]


def session(start, sport):
    return SESSION, [(2, UINT32, start - EPOCH), (5, ENUM, sport)]


def record(time, lat=None, lon=None, more=(), developer=()):
    fields = [] if time is None else [(253, UINT32, time - EPOCH)]
    if lat is not None:
        fields += [(0, SINT32, semicircles(lat)), (1, SINT32, semicircles(lon))]
    return RECORD, [*fields, *more], developer


def developer_field(name):
    """Messages that describe field 0 of developer 0, an integer of 16 bits."""
    return [
        (DEVELOPER_DATA_ID, [(3, UINT8, 0)]),
        (
            FIELD_DESCRIPTION,
            [(0, UINT8, 0), (1, UINT8, 0), (2, UINT8, UINT16[0]), (3, STRING, name.encode())],
        ),
    ]


def compressed(message, offset):
    """A message whose time is in its header: the lowest five bits of the seconds."""
    return (*message, offset)


def fit(*messages, endian="<", size=None, crc=None):
    """Return a file of messages, each with a definition before it unless that is the last one."""
    body, last = b"", None
    for kind, fields, developer, offset in map(_complete, messages):
        definition = _definition(kind, fields, developer, endian)
        if definition != last:
            body += bytes([0x40 | (0x20 if developer else 0)]) + definition
            last = definition
        body += bytes([0x80 | offset if offset is not None else 0])
        for _, (_, letter), value in (*fields, *((n, UINT16, v) for n, v in developer)):
            body += value if letter == "s" else struct.pack(endian + letter, value)
    header = struct.pack("<2BHI4s", 14, 0x20, 2132, len(body) if size is None else size, b".FIT")
    header += struct.pack("<H", checksum(header))
    whole = header + body
    return whole + struct.pack("<H", checksum(whole) if crc is None else crc)


def _complete(message):
    kind, fields, *rest = message
    developer, offset = (*rest, *((), None)[len(rest) :])
    return kind, fields, developer, offset


def _definition(kind, fields, developer, endian):
    out = struct.pack(endian + "BBHB", 0, endian == ">", kind, len(fields))
    for number, (base, letter), value in fields:
        out += bytes([number, len(value) if letter == "s" else struct.calcsize(letter), base])
    if developer:
        out += bytes([len(developer)])
        out += b"".join(bytes([number, 2, 0]) for number, _ in developer)
    return out


def checksum(data):
    """CRC-16 with the polynomial 0x8005, lowest bit first."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc
