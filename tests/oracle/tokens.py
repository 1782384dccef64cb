"""Plain reader of the numbers in text, by regular expressions, written from docs/format.md."""

import re
from datetime import UTC, datetime

DATE = re.compile(rb"(\d{4})([-/])(\d\d)\2(\d\d)([T ])(\d\d):(\d\d):(\d\d)")
CLOCK = re.compile(rb"(\d\d):(\d\d):(\d\d)")
NUMBER = re.compile(rb"\d{1,17}")
FRACTION = re.compile(rb"\.(\d+)")


def whole_part(text, i):
    """Value, digits that it counts for, digits before the point, and end."""
    date = DATE.match(text, i)
    if date and (date[2], date[5]) != (b"/", b"T"):
        parts = [int(part) for k, part in enumerate(date.groups(), 1) if k not in (2, 5)]
        try:
            moment = datetime(*parts, tzinfo=UTC)
        except ValueError:
            moment = None
        if moment and moment.year >= 1970:
            return int(moment.timestamp()), 11, 0, date.end()
    clock = CLOCK.match(text, i)
    if clock:
        hours, minutes, seconds = map(int, clock.groups())
        if hours < 24 and minutes < 60 and seconds < 60:
            return (hours * 60 + minutes) * 60 + seconds, 11, 0, clock.end()
    number = NUMBER.match(text, i)
    return int(number[0]), len(number[0]), len(number[0]), number.end()


def token_at(text, i):
    """Value, decimals, width and end of the token at a byte, or None."""
    negative = text[i : i + 1] == b"-" and not text[max(i - 1, 0) : i].isdigit()
    first = i + negative
    if not text[first : first + 1].isdigit():
        return None
    if negative:
        number = NUMBER.match(text, first)
        value, digits, width, end = int(number[0]), len(number[0]), len(number[0]), number.end()
    else:
        value, digits, width, end = whole_part(text, first)
    decimals = 0
    fraction = FRACTION.match(text, end)
    if fraction and digits < 17:
        kept = fraction[1][: 17 - digits]
        value, decimals, end = int(b"%d%s" % (value, kept)), len(kept), end + 1 + len(kept)
    if negative and value == 0:
        width += 128
    return (-value if negative else value), decimals, width, end


def split_plainly(text):
    """Values, decimals and widths of all tokens of text with short lines."""
    found, i, in_record = [], 0, 0
    while i < len(text):
        token = token_at(text, i) if in_record < 64 else None
        if token:
            found.append(token)
            i, in_record = token[3], in_record + 1
            continue
        if text[i : i + 1] == b"\n":
            in_record = 0
        i += 1
    return tuple([token[k] for token in found] for k in range(3))
