"""Speeds of many features are those that the rules give for each feature alone."""

from unittest import mock

import numpy as np
import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from gpszip.io.networks import features
from gpszip.io.networks.features import RoadFeatures, road_lines
from gpszip.io.networks.rules import expected_speed, parse_speed_limit, road_class_speed
from gpszip.io.networks.wkb import WkbLines

LIMIT = st.sampled_from(["50", "30 mph", "walk", "signals", None])
ROAD_CLASS = st.sampled_from(["residential", "motorway", "track", "nothing", None])


def speeds_of(limits, classes):
    """Speeds of roads that lie side by side, in m/s."""
    count = len(limits)
    points = np.array([[[number, 0.0], [number, 1.0]] for number in range(count)]).reshape(-1, 2)
    lines = WkbLines(points, 2 * np.arange(count + 1), np.arange(count), 0)
    roads = RoadFeatures()
    roads.add(lines, count, {"limit": pa.array(limits), "class": pa.array(classes, pa.string())})
    return road_lines(roads, None, "roads", metric=True).speeds


@given(st.lists(st.tuples(LIMIT, ROAD_CLASS), min_size=1, max_size=30))
def test_the_rule_for_speeds_runs_once_for_each_pair(roads):
    limits, classes = zip(*roads, strict=True)
    pairs = [(parse_speed_limit(limit), road_class_speed(road)) for limit, road in roads]
    with mock.patch.object(features, "expected_speed", side_effect=expected_speed) as rule:
        found = speeds_of(list(limits), list(classes))
    np.testing.assert_array_equal(found, [expected_speed(*pair) for pair in pairs])
    # Written out, all NaN are alike.
    assert rule.call_count == len({str(pair) for pair in pairs})
