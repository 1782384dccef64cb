"""Segment means: one segment for all parts that follow it.

Algorithm 1 of the thesis cuts a track into k parts, and lets each follow one of m directed
segments at constant speed. Parts that go the same way share a segment. The picture shows a small
town's drive for three pairs of k and m: the more parts and segments, the smaller the error.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gpszip
from gpszip.testing import drives

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
times, positions = drives(2, vehicles=1, duration=400.0, noise=5.0, seed=4)["bus-0"]
track = gpszip.Track("bus", times, positions)

figure = Figure(figsize=(8.0, 3.1), layout="constrained")
for axes, (k, m) in zip(figure.subplots(1, 3), [(10, 8), (20, 14), (32, 20)], strict=True):
    mean = gpszip.segment_mean(track, k=k, m=m)
    rmse = np.sqrt(mean.cost / len(track))
    print(f"k={k}, m={m}: RMSE {rmse:.1f} m after {len(mean.costs) - 1} iterations")

    axes.plot(*positions.T, ".", color="#E69F00", markersize=1.5)
    for start, end in zip(mean.starts, mean.ends, strict=True):
        axes.annotate(
            "", end, start, arrowprops={"arrowstyle": "->", "color": "#0072B2", "lw": 1.6}
        )
    axes.set_title(f"{k} parts on {m} segments\nRMSE {rmse:.1f} m", fontsize=9)
    axes.set_aspect("equal")
    axes.set_axis_off()
figure.savefig(folder / "segment_mean.png", dpi=110)
