"""A plain reader of PLT, and a writer."""

from datetime import UTC, datetime, timedelta

HEADER = (
    "Geolife trajectory\r\nWGS 84\r\nAltitude is in Feet\r\nReserved 3\r\n0,2,255,My,0,0\r\n0\r\n"
)
ORIGIN = datetime(1899, 12, 30, tzinfo=UTC)


def point(time, lat, lon, alt=-777):
    days = (time - ORIGIN) / timedelta(days=1)
    return f"{lat:.6f},{lon:.6f},0,{alt},{days:.10f},{time:%Y-%m-%d},{time:%H:%M:%S}\r\n"


def ozi(time, lat, lon, alt=-777):
    days = (time - ORIGIN) / timedelta(days=1)
    return f"  {lat:.6f},  {lon:.6f},0, {alt},{days:.10f}, {time:%d-%b-%y}, {time:%H:%M:%S}\r\n"


def read(text):
    """Seconds since 1970, latitude, longitude and feet of each point."""
    rows = []
    for line in text.splitlines()[6:]:
        lat, lon, _, feet, days, *_ = line.split(",")
        time = ORIGIN + timedelta(days=float(days))
        rows.append((time.timestamp(), float(lat), float(lon), float(feet)))
    return rows
