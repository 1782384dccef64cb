"""Compress a robot's rounds, ask where it was, and follow the thesis's Algorithm 1 on the same track.

python examples/patrol.py
"""

import numpy as np

import gpszip
from gpszip.testing import patrol

track = patrol(10_000)
archive = gpszip.compress(track, rmse=0.24)
size = len(archive.to_bytes())
print(f"{len(track):,} points in {size} bytes, on a map of {len(archive.road_map.nodes)} nodes")

when = np.array([60.0, 120.0, 180.0])
for instant, place in zip(when, archive.position(track.id, when), strict=True):
    print(f"at {instant:5.0f} s: x {place[0]:6.2f} m, y {place[1]:6.2f} m")

mean = gpszip.segment_mean(track, k=40, m=25)
print(f"the (40,25)-segment mean is off by {np.sqrt(mean.cost / len(track)):.2f} m RMSE")
