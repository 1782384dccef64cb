"""Compress the rounds of a robot, ask where it was, and compare with Algorithm 1 of the thesis.

python examples/patrol.py
"""

import numpy as np

import gpszip
from gpszip.testing import patrol

track = patrol(10_000)
archive = gpszip.compress(track, rmse=0.24)
size = len(archive.to_bytes())
print(f"{len(track):,} points in {size} bytes, on a map of {len(archive.road_map.nodes)} nodes")

times = np.array([60.0, 120.0, 180.0])
for time, position in zip(times, archive.position(track.id, times), strict=True):
    print(f"at {time:5.0f} s: x {position[0]:6.2f} m, y {position[1]:6.2f} m")

mean = gpszip.segment_mean(track, k=40, m=25)
print(f"the (40,25)-segment mean has an RMSE of {np.sqrt(mean.cost / len(track)):.2f} m")
