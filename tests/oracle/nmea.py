"""A plain reader of NMEA 0183, line by line, and a writer of sentences."""

from datetime import date, datetime, timedelta
from functools import reduce
from operator import xor

DAY = 86_400
POSITIONS = ("GGA", "GNS", "RMC", "GLL")


def sentence(body, start="$"):
    return f"{start}{body}*{reduce(xor, body.encode(), 0):02X}"


def packed(degrees, letters, digits):
    """Degrees as degrees and minutes with five decimals, and the hemisphere."""
    minutes = round(abs(degrees) * 6_000_000)
    whole, rest = divmod(minutes, 6_000_000)
    text = f"{whole:0{digits}}{rest // 100_000:02}.{rest % 100_000:05}"
    return f"{text},{letters[degrees < 0]}"


def position(lat, lon):
    return f"{packed(lat, 'NS', 2)},{packed(lon, 'EW', 3)}"


def clock(time):
    return f"{time:%H%M%S}.{time.microsecond // 10_000:02}"


def rmc(time, lat, lon, talker="GP", status="A", knots="0.273", course="84.4"):
    motion = f"{knots},{course}"
    return sentence(
        f"{talker}RMC,{clock(time)},{status},{position(lat, lon)},{motion},{time:%d%m%y},,,A"
    )


def gga(time, lat, lon, talker="GP", quality=1, satellites=8, hdop="1.16", alt="36.3"):
    return sentence(
        f"{talker}GGA,{clock(time)},{position(lat, lon)},{quality},{satellites:02},{hdop},"
        f"{alt},M,48.5,M,,"
    )


def gll(time, lat, lon, talker="GP", status="A"):
    return sentence(f"{talker}GLL,{position(lat, lon)},{clock(time)},{status},A")


def zda(time, talker="GP"):
    return sentence(f"{talker}ZDA,{clock(time)},{time:%d,%m,%Y},00,00")


def read(lines):
    """Return seconds since 1970, latitude and longitude of each epoch that is valid."""
    # Merge sentences of one time.
    epochs = []
    for line in lines:
        if line.startswith("$") and line == sentence(line[1:-3]):
            _add(epochs, line[1:-3].split(","))

    # Count midnights, and find dates.
    midnights, last = 0, None
    for epoch in epochs:
        midnights += last is not None and epoch["time"] - last < -DAY / 2
        epoch["midnights"], last = midnights, epoch["time"]
    dated = [epoch for epoch in epochs if epoch.get("day") is not None and not epoch["void"]]
    anchor = dated[0]["day"] - dated[0]["midnights"]
    rows = []
    for epoch in epochs:
        day = epoch.get("day")
        if day is not None and not epoch["void"]:
            anchor = day - epoch["midnights"]
        day = anchor + epoch["midnights"] if day is None else day
        if "position" in epoch and not epoch["void"]:
            rows.append((day * DAY + epoch["time"], *epoch["position"]))
    return rows


def _add(epochs, fields):
    kind = fields[0][2:]
    if kind not in (*POSITIONS, "ZDA"):
        return
    time = fields[5 if kind == "GLL" else 1]
    seconds = int(time[:2]) * 3600 + int(time[2:4]) * 60 + float(time[4:])
    if not epochs or epochs[-1]["time"] != seconds:
        epochs.append({"time": seconds, "void": False, "rank": len(POSITIONS)})
    epoch = epochs[-1]

    if kind == "RMC":
        epoch["day"] = (datetime.strptime(fields[9], "%d%m%y").date() - date(1970, 1, 1)).days
    if kind == "ZDA":
        day, month, year = map(int, fields[2:5])
        epoch.setdefault("day", (date(year, month, day) - date(1970, 1, 1)) // timedelta(1))
    if kind in POSITIONS:
        first = {"GGA": 2, "GNS": 2, "RMC": 3, "GLL": 1}[kind]
        epoch["void"] |= fields[{"GGA": 6, "GNS": 6, "RMC": 2, "GLL": 6}[kind]] in ("V", "0", "NN")
        if POSITIONS.index(kind) < epoch["rank"]:
            epoch["rank"] = POSITIONS.index(kind)
            epoch["position"] = (
                _degrees(*fields[first : first + 2]),
                _degrees(*fields[first + 2 : first + 4]),
            )


def _degrees(text, letter):
    whole, _, _ = text.partition(".")
    value = int(whole[:-2]) + float(text[len(whole) - 2 :]) / 60
    return -value if letter in "SW" else value
