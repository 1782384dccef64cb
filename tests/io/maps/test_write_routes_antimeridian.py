import io
import json

import numpy as np

from gpszip.io.maps.routes import write_routes
from gpszip.matching.match import match
from gpszip.model import Network, Plane, Track

DATE_LINE = Plane(((-170000000, 1800000000),))


def test_routes_are_cut_at_the_antimeridian():
    line = np.array([[-150.0, 0.0], [150.0, 0.0]])
    both = np.ones(1, np.bool_)
    road = Network(
        nodes=line,
        starts=np.array([0], np.int32),
        ends=np.array([1], np.int32),
        offsets=np.array([0, 2]),
        points=line,
        forward=both,
        backward=both,
        speeds=np.full(1, np.nan),
        plane=DATE_LINE,
    )
    east = np.arange(-140.0, 141.0, 20.0)
    bus = Track(
        "bus",
        5.0 * np.arange(len(east)),
        np.stack([east, np.full(len(east), 2.0)], axis=1),
        plane=DATE_LINE,
    )
    out = io.BytesIO()
    write_routes(match([bus], road, sigma=5.0), [bus], road, out, "geojson")
    (feature,) = json.loads(out.getvalue())["features"]
    assert feature["geometry"]["type"] == "MultiLineString"
    assert [[np.sign(lon) for lon, _ in part] for part in feature["geometry"]["coordinates"]] == [
        [1, 1],
        [-1, -1],
    ]
    assert [
        part[end][0] for part, end in zip(feature["geometry"]["coordinates"], (-1, 0), strict=True)
    ] == [180, -180]
