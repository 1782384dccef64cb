"""A fleet: one map for all vehicles, and the busiest streets.

Six vehicles drive in a town of four by four blocks, with a position every ten seconds. A table in
degrees is read, and one map is learned for all of them. Its edges count how often they were
travelled.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import gpszip
from gpszip.testing import city

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
log = folder / "fleet.csv"
with log.open("w") as file:
    file.write("vehicle,time,lat,lon\n")
    for name, (times, degrees) in city(blocks=4, vehicles=6, period=10.0, duration=900.0).items():
        for t, (lat, lon) in zip(times, degrees, strict=True):
            file.write(f"{name},{t:.0f},{lat:.6f},{lon:.6f}\n")

tracks = gpszip.read(log)
archive = gpszip.compress(tracks, rmse=10.0)
archive.save(folder / "fleet.gpsz", force=True)
print(f"{log.stat().st_size:,} bytes of CSV became {len(archive.to_bytes()):,}")

traversals = archive.road_map.forward + archive.road_map.backward
for edge in np.argsort(-traversals)[:3]:
    ends = archive.road_map.nodes[archive.road_map.edges[edge]]
    print(f"travelled {traversals[edge]} times: {np.linalg.norm(ends[1] - ends[0]):.0f} m")

reopened = gpszip.open(folder / "fleet.gpsz")
print("bus-3 after two minutes:", reopened.position("bus-3", 120.0).round(5))

gpszip.plot(archive, folder / "fleet.png", kind="heat", raw=tracks, dpi=110, force=True)
