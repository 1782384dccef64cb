import json

import numpy as np
import pytest

import gpszip
from gpszip.pipeline.match import read_network
from gpszip.testing import fleet, patrol
from gpszip.view.live import build_live_page, build_live_scene
from gpszip.view.page import build_page
from gpszip.view.scene import log_scene


@pytest.fixture(scope="module")
def archive():
    return gpszip.compress(fleet(3, points=250).tracks, rmse=8.0, effort=1)


def test_edges_of_the_map_have_the_numbers_that_events_name(archive, tmp_path):
    clean = archive.clean_map()
    network = read_network(archive, plane=archive.grid.plane).network
    assert np.array_equal(clean.offsets, network.offsets)
    assert np.allclose(clean.points[:, :2], network.points[:, :2], atol=1e-3)

    # These lines are in the scene, and no walk is.
    archive.save(tmp_path / "a<b>.gpsz")
    scene = json.loads(build_live_scene(tmp_path / "a<b>.gpsz"))
    (shown,) = scene["archives"]
    assert (scene["title"], scene["geographic"]) == ("a<b>.gpsz", False)
    assert shown["clean"]["offsets"]["count"] == len(clean.offsets) > 10
    assert shown["knots"]["node"]["count"] == 0


def test_pages_have_their_own_seals():
    live, whole = build_live_page(), build_page(log_scene([patrol(10)], title="log"))
    assert ("connect-src 'self'" in live, "connect-src 'none'" in live) == (True, False)
    assert ("connect-src 'self'" in whole, "connect-src 'none'" in whole) == (False, True)
    assert "EventSource" in live
    assert "EventSource" not in whole
