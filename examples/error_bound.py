"""Error bounds: the RMSE and the maximum, measured at every point.

The error of a point is its distance from the archive's position at the point's own time. A bound
on the RMSE lets a few points be far off; a maximum holds for each of them, and takes more bytes.
Both are measured on the bytes that are written.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gpszip
from gpszip.testing import patrol

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
track = patrol(6_000, seed=2)

figure = Figure(figsize=(8.0, 3.6), layout="constrained")
rows = figure.subplots(2, 1, sharex=True, sharey=True)
bounds = [("rmse", 0.24, "RMSE"), ("max_error", 0.35, "maximum")]
for axes, (bound, metres, name) in zip(rows, bounds, strict=True):
    archive = gpszip.compress(track, **{bound: metres})
    there = archive.position(track.id, track.times)
    errors = np.linalg.norm(there - track.positions, axis=1)
    rmse, largest, size = np.sqrt(np.mean(errors**2)), errors.max(), len(archive.to_bytes())
    print(f"{name} at most {metres} m: {size} bytes, RMSE {rmse:.3f} m, maximum {largest:.3f} m")

    axes.plot(track.times / 60, errors, color="#0072B2", linewidth=0.5)
    axes.axhline(metres, color="#D55E00", linewidth=1.2)
    axes.set_title(f"{name} at most {metres} m: {size} bytes", fontsize=9, loc="left")
    axes.set_ylabel("error in m")
rows[-1].set_xlabel("minutes")
rows[-1].set_xlim(0, track.times[-1] / 60)
figure.savefig(folder / "error_bound.png", dpi=110)
