"""Networks of roads: positions along them."""

import numpy as np
import pytest

from gpszip.model import Network


@pytest.mark.parametrize("height", [False, True])
def test_the_middle_of_a_road_is_halfway_along_it(height: bool) -> None:
    # 10 m east and 30 m north: half of the way is 10 m along the second part. Then 8 m west.
    points = np.array([[0.0, 0, 5], [10, 0, 5], [10, 30, 5], [10, 30, 5], [2, 30, 5]])
    points = points if height else points[:, :2]
    yes = np.ones(2, bool)
    network = Network(
        points[[0, 2, 4]],
        np.array([0, 1], np.int32),
        np.array([1, 2], np.int32),
        np.array([0, 3, 5]),
        points,
        yes,
        yes,
        np.full(2, np.nan),
    )
    middles = [network.middle(0).tolist(), network.middle(1).tolist()]
    assert [middle[:2] for middle in middles] == [[10.0, 10.0], [6.0, 30.0]]
    assert [middle[2:] for middle in middles] == [[5.0] * height] * 2
