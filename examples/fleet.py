"""Learn one map from a fleet's log in degrees, save it, and find the busiest streets.

python examples/fleet.py [FOLDER]
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

archive = gpszip.compress(gpszip.read(log), rmse=10.0)
archive.save(folder / "fleet.gpsz", force=True)
print(f"{log.stat().st_size:,} bytes of CSV became {len(archive.to_bytes()):,}")

travels = archive.road_map.forward + archive.road_map.backward
for edge in np.argsort(-travels)[:3]:
    ends = archive.road_map.nodes[archive.road_map.edges[edge]]
    print(f"travelled {travels[edge]} times: {np.linalg.norm(ends[1] - ends[0]):.0f} m")

reopened = gpszip.open(folder / "fleet.gpsz")
print("bus-3 after two minutes:", reopened.position("bus-3", 120.0).round(5))
