"""Map matching: the roads that a vehicle took.

A vehicle drives on known roads with a position every five seconds and a noise of 12 m. A hidden
Markov model finds the route of highest probability: short lines lead from each point to its
position on the road. A point may lie nearer to another road than to the one that was taken.
"""

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import gpszip
from gpszip.io.networks.read import read_network
from gpszip.testing import drives

BLOCKS, BLOCK = 4, 120.0

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
times, positions = drives(BLOCKS, vehicles=1, period=5.0, duration=300.0, noise=12.0, seed=3)[
    "bus-0"
]
track = gpszip.Track("bus", times, positions)

# Roads of a town, in metres from its center: lines from crossing to crossing.
streets = BLOCK * (np.arange(BLOCKS + 1) - BLOCKS / 2)
lines = [[[x, y], [x + BLOCK, y]] for x in streets[:-1] for y in streets]
lines += [[[x, y], [x, y + BLOCK]] for x in streets for y in streets[:-1]]
roads = {
    "type": "FeatureCollection",
    "gpszip": {"coordinates": "metres"},
    "features": [
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "LineString", "coordinates": line},
        }
        for line in lines
    ],
}
(folder / "roads.geojson").write_text(json.dumps(roads))

network = read_network(folder / "roads.geojson")
match = gpszip.match(track, network)[0]
there = match.snapped_positions(network)
print(f"{match.share:.0%} of {len(track)} points are on roads")
length, off = match.pieces[0].length, np.nanmean(match.distance)
print(f"the route has {length:,.0f} m; points are {off:.0f} m off")

figure = Figure(figsize=(5.4, 5.4), layout="constrained")
axes = figure.subplots()
for line in lines:
    axes.plot(*np.array(line).T, color="#B8BDC2", linewidth=3, solid_capstyle="round", zorder=1)
axes.plot(*np.stack([positions, there], axis=1).transpose(2, 1, 0), color="#222222", linewidth=0.6)
axes.plot(*positions.T, "o", color="#E69F00", markersize=4, label="points")
axes.plot(*there.T, "o", color="#0072B2", markersize=4, label="on the roads")
axes.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2, frameon=False)
axes.set_aspect("equal")
axes.set_axis_off()
figure.savefig(folder / "matching.png", dpi=110)
