"""A robot's rounds: the learned map over the points.

A robot drives through the corridors of a building again and again. Its log becomes a map of the
corridors, and a walk on that map: a few hundred bytes. The archive answers where the robot was at
any time.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import gpszip
from gpszip.testing import patrol

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
track = patrol(40_000)
archive = gpszip.compress(track, rmse=0.24)
size = len(archive.to_bytes())
print(f"{len(track):,} points in {size} bytes, on a map of {len(archive.road_map.nodes)} nodes")

times = np.array([60.0, 120.0, 180.0])
for time, position in zip(times, archive.position(track.id, times), strict=True):
    print(f"at {time:5.0f} s: x {position[0]:6.2f} m, y {position[1]:6.2f} m")

title = f"{len(track):,} points as {size} bytes"
gpszip.plot(archive, folder / "patrol.png", raw=track, title=title, dpi=110, force=True)
