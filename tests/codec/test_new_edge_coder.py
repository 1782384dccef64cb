import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calling import from_python
from gpszip.codec.kernels import new_edge_coder
from gpszip.codec.kernels.walk_model import STEP_LENGTH, new_model
from gpszip.codec.kernels.walk_priors import AMONG_NEW_EDGES, BEYOND_GAPS
from gpszip.codec.plain import choices
from oracle import candidates

# Inner kernels, as Python calls them.
classify_nodes = from_python(new_edge_coder._classify)
count_classes = from_python(new_edge_coder.count_classes)

near = st.integers(-3, 3)
far = st.integers(-(2**60), 2**60) | st.sampled_from([2**25, 2**25 - 1, 2**26, -(2**60)])
mean_lengths = st.integers(0, 5000) | st.sampled_from([63, 64, 65, 2**27 - 1, 2**27, 2**36])


def model_of(positions, mean_length, neighbours=(), gap_ends=()):
    """A model of nodes at these positions; node 0 has edges to its neighbours."""
    model = new_model(max(len(positions), len(neighbours)), len(positions[0]))
    model.places[: len(positions)] = positions
    model.scalars[STEP_LENGTH] = mean_length
    model.gap_ends[: len(gap_ends)] = gap_ends
    for edge, node in enumerate(neighbours):
        model.end_node[2 * edge] = node
        model.next_half_edge[2 * edge] = model.first_half_edge[0]
        model.first_half_edge[0] = 2 * edge
    return model


def classify(positions, before, mean_length, neighbours=(), first=0):
    """Classes of all nodes from ``first`` on as candidates for a new edge from node 0."""
    model = model_of(positions, mean_length, neighbours)
    before = -1 if before is None else before
    count = len(positions) - first
    return classify_nodes(model, 0, before, int(AMONG_NEW_EDGES), first, count).tolist()


@st.composite
def maps(draw):
    """Positions of nodes in one to four dimensions, next to each other or far apart."""
    dimension = draw(st.integers(1, 4))
    coordinate = draw(st.sampled_from([near, near | far]))
    position = st.lists(coordinate, min_size=dimension, max_size=dimension)
    return draw(st.lists(position, min_size=1, max_size=12))


@given(positions=maps(), mean_length=mean_lengths, data=st.data())
def test_classes_are_those_of_exact_numbers(positions, mean_length, data):
    nodes = st.integers(0, len(positions) - 1)
    before = data.draw(st.none() | nodes)
    neighbours = data.draw(st.lists(nodes, max_size=3, unique=True))
    expected = candidates.classify(positions, 0, before, mean_length, neighbours)
    assert classify(positions, before, mean_length, neighbours) == expected
    first = data.draw(nodes)
    assert classify(positions, before, mean_length, neighbours, first) == expected[first:]


@given(positions=maps(), mean_length=mean_lengths, data=st.data())
def test_classes_beyond_gaps_tell_how_many_gaps_ended_there(positions, mean_length, data):
    gap_ends = data.draw(
        st.lists(st.integers(0, 6), min_size=len(positions), max_size=len(positions))
    )
    # Node 0 may jump to its neighbours, too.
    model = model_of(positions, mean_length, [len(positions) - 1], gap_ends)
    found = classify_nodes(model, 0, -1, int(BEYOND_GAPS), 0, len(positions))
    expected = candidates.classify(positions, 0, None, mean_length, gap_ends=gap_ends)
    assert found.tolist() == expected


@given(positions=maps(), mean_length=mean_lengths)
def test_the_plain_decoder_finds_the_same_octaves_and_bearings(positions, mean_length):
    # The walk came to node 0 from the last node.
    places = np.array(positions, np.int64)
    differences, step = (places - places[0]).astype(float), (places[0] - places[-1]).astype(float)
    octaves = choices._octaves(differences, max(mean_length, 64))
    bearings = choices._bearings(differences, step)
    found = classify(positions, len(positions) - 1, mean_length)
    assert (octaves * candidates.KINDS + bearings).tolist()[1:] == found[1:]


#: A mean length, in sixteenths of a space step, whose bounds are 100**2, 2 * 100**2, 4 * 100**2.
BOUND_OF_HUNDRED = 9052


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_a_distance_on_a_bound_reaches_it(dimension):
    def octaves(axes, less):
        """Octaves of steps of 100, 200, 400, ... along some axes, a little less along the first."""
        steps = np.zeros((7, dimension), np.int64)
        steps[1:, :axes] = 100 * 2 ** np.arange(6)[:, np.newaxis]
        steps[1:, 0] -= less
        return [kind // 8 for kind in classify(steps.tolist(), None, BOUND_OF_HUNDRED)[1:]]

    assert octaves(1, less=0) == [1, 3, 5, 7, 9, 11]
    assert octaves(1, less=1) == [0, 2, 4, 6, 8, 10]
    if dimension > 1:
        assert octaves(2, less=0) == [2, 4, 6, 8, 10, 12]
        assert octaves(2, less=1) == [1, 3, 5, 7, 9, 11]


def test_a_turn_on_a_bound_is_not_above_it():
    # Three axes have turns whose cos**2 is 1/4 and 3/4.
    origin, before = [0, 0, 0], [-1, -1, 0]
    turns = [[1, 0, 1], [2, 1, 1], [-1, 0, 1], [-2, -1, 1], [1, 1, 0], [-1, -1, 0]]
    found = classify([origin, before, *turns], 1, 0)[2:]
    assert [kind % 8 for kind in found] == [3, 2, 4, 5, 0, 6]


@given(st.lists(st.integers(0, candidates.BARRED), max_size=50))
def test_each_class_is_counted(classes):
    counts = count_classes(np.array(classes, np.uint8))
    np.testing.assert_array_equal(
        counts, np.bincount(np.array(classes, np.int64), minlength=candidates.BARRED + 1)
    )
