"""Gaps: the likeliest way while nothing was received.

A vehicle's receiver is off for 50 seconds. The gap is filled over the map that earlier drives have
left in an archive: no road network from elsewhere is needed. Each point that is added has a
confidence. A detour that the vehicle takes meanwhile can't be known.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gpszip
from gpszip.testing import drives

#: Seconds without a position.
GAP = (100.0, 150.0)

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
town = drives(4, vehicles=8, period=4.0, duration=900.0, noise=3.0, seed=4)
*earlier, (times, positions) = town.values()
archive = gpszip.compress(
    [gpszip.Track(f"bus-{number}", *drive) for number, drive in enumerate(earlier)], rmse=6.0
)

# The drive of today, of which a part is missing.
now = times < 260.0
times, positions = times[now], positions[now]
received = (times < GAP[0]) | (times > GAP[1])
track = gpszip.Track("bus", times[received], positions[received])
patching = gpszip.patch(track, archive, gap=30.0)
patch = patching.patches[0]
print(f"{patching.filled} of {len(patching.patches)} gaps filled, {len(patch.times)} points added")

# How far they are from where the vehicle was.
there = np.stack([np.interp(patch.times, times, axis) for axis in positions.T], axis=1)
off = np.linalg.norm(patch.positions - there, axis=1)
print(f"they are {off.mean():.0f} m off on average, {off.max():.0f} m at most")

figure = Figure(figsize=(5.4, 4.6), layout="constrained")
axes = figure.subplots()
streets = archive.clean_map()
for edge in range(len(streets)):
    axes.plot(*streets[edge].T, color="#B8BDC2", linewidth=3, solid_capstyle="round", zorder=1)
axes.plot(
    *positions[~received].T, "o", color="#222222", markersize=3, mfc="none", label="not received"
)
axes.plot(*track.positions.T, "o", color="#E69F00", markersize=4, label="received")
axes.plot(*patch.positions.T, "o", color="#0072B2", markersize=4, label="filled in")
axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3, frameon=False)
axes.set_aspect("equal")
axes.set_axis_off()
figure.savefig(folder / "gaps.png", dpi=110)
