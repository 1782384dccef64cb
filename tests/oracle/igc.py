"""A plain reader of IGC, line by line, and a writer of its lines."""

from datetime import UTC, datetime, timedelta


def minutes(degrees, digits, sides):
    """Degrees and thousandths of minutes, and the hemisphere."""
    whole, rest = divmod(round(abs(degrees) * 60_000), 60_000)
    return f"{whole:0{digits}}{rest:05}{sides[degrees < 0]}"


def fix(time, lat, lon, validity="A", pressure="00280", alt="00421", more=""):
    at = minutes(lat, 2, "NS") + minutes(lon, 3, "EW")
    return f"B{time:%H%M%S}{at}{validity}{pressure}{alt}{more}"


def date(time):
    return f"HFDTE{time:%d%m%y}"


def read(lines):
    """Seconds since 1970, latitude and longitude of each valid fix."""
    day, last, rows = None, None, []
    for line in lines:
        if line.startswith("HFDTE"):
            day, last = datetime.strptime(line[5:11], "%d%m%y").replace(tzinfo=UTC), None
        if not line.startswith("B"):
            continue
        clock = timedelta(hours=int(line[1:3]), minutes=int(line[3:5]), seconds=int(line[5:7]))
        if last is not None and last - clock > timedelta(hours=12):
            day += timedelta(days=1)
        last = clock
        lat = int(line[7:9]) + int(line[9:14]) / 60_000
        lon = int(line[15:18]) + int(line[18:23]) / 60_000
        if line[24] == "A":
            lat, lon = lat * (1 - 2 * (line[14] == "S")), lon * (1 - 2 * (line[23] == "W"))
            rows.append(((day + clock).timestamp(), lat, lon))
    return rows
