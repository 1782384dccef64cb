import numpy as np
import pytest

from gpszip.codec.prior import Past
from gpszip.codec.walks import decode, encode
from gpszip.mapping.budgets import Shares
from gpszip.mapping.initial_map import list_parts, sample_errors
from gpszip.mapping.kernels.local_search_moves import offer_changes
from gpszip.mapping.kernels.local_search_nodes import _error_at
from gpszip.mapping.kernels.local_search_state import KNOTS, SQUARE, replace_knots
from gpszip.mapping.local_search import _bench, _knots_on, best_outcomes, polish
from gpszip.mapping.plan import Plan
from gpszip.mapping.rounds import Outcome
from gpszip.mapping.rounds import fit as learn
from gpszip.mapping.time_grid import lay_slots
from gpszip.model import Frame, LatticeWalk, LatticeWalks, Track
from gpszip.model.frame import quantum, quantum_index
from gpszip.testing import patrol
from gpszip.testing.city import drives
from gpszip.walks.error import fit
from gpszip.walks.quantised import node_positions, walks_of

RMSE = 0.5
WORK = 60_000


def frame_for(rmse, seconds):
    return Frame((0, 0), 0, quantum_index(1.2 * rmse), quantum_index(seconds))


def lattice(dimension=2):
    flat = frame_for(RMSE, 1.6)
    return Frame((0,) * dimension, 0, flat.space, flat.time)


def raised(track, dimension):
    """The track in another dimension, by leaving out or adding an axis."""
    if dimension == 2:
        return track
    height = np.sin(track.times / 40)[:, None] * 6
    positions = track.positions[:, :1] if dimension == 1 else np.concatenate([track.positions, height], axis=1)
    return Track(track.id, track.times, positions)


@pytest.fixture(scope="module")
def day():
    whole = patrol(32000, seed=3)
    return Track("0", whole.times[::16], whole.positions[::16])


def setting(kind, day):
    """Tracks, gaps and lattice of one kind of log."""
    dimension = {"1-D": 1, "3-D": 3}.get(kind, 2)
    day = raised(day, dimension)
    tracks = [day]
    if kind == "tracks":
        tracks = [Track(str(i), day.times[a : a + 600], day.positions[a : a + 600]) for i, a in enumerate((0, 700, 1400))]
    gaps = [np.zeros(len(track) - 1, bool) for track in tracks]
    if kind == "gaps":
        times = day.times.copy()
        times[800:] += 300
        times[1500:] += 900
        tracks = [Track("0", times, day.positions)]
        gaps[0][[799, 1499]] = True
    return tracks, gaps, lattice(dimension)


def measured(tracks, walks, frame):
    return fit(tracks, walks_of(walks, frame, [track.id for track in tracks]), node_positions(walks, frame))


@pytest.mark.parametrize("kind", ["plain", "gaps", "tracks", "1-D", "3-D"])
def test_polished_walks_are_smaller_within_the_bound_and_what_they_say(kind, day):
    tracks, gaps, frame = setting(kind, day)
    slots, unit = lay_slots(tracks, gaps, frame), quantum(frame.space)
    first = learn(slots, len(tracks), Plan(target=0.9995 * RMSE / unit, rounds=6))
    polished = polish(slots, first, target=RMSE / unit, work=WORK)
    data = encode(polished.walks)
    read = decode(data, len(frame.origin), len(tracks))
    found = measured(tracks, read, frame)
    assert len(data) == polished.size < first.size
    assert found.rmse == pytest.approx(polished.error * unit)
    assert found.rmse <= RMSE
    assert found.uncovered == 0
    assert [walk.gaps.sum() for walk in read.walks] == [gap.sum() for gap in gaps]


def test_polishing_twice_gives_the_same_bytes(day):
    tracks, gaps, frame = setting("plain", day)
    slots, target = lay_slots(tracks, gaps, frame), RMSE / quantum(frame.space)
    first = learn(slots, 1, Plan(target=target, rounds=6))
    one, two = (polish(slots, first, target=target, work=WORK) for _ in range(2))
    assert encode(one.walks) == encode(two.walks)


def test_a_maximum_is_kept(day):
    tracks, gaps, frame = setting("plain", day)
    slots, unit = lay_slots(tracks, gaps, frame), quantum(frame.space)
    first = learn(slots, 1, Plan(target=RMSE / unit, rounds=6))
    most = measured(tracks, first.walks, frame).max_error
    polished = polish(slots, first, maximum=most / unit, work=WORK)
    assert polished.size < first.size
    assert measured(tracks, decode(encode(polished.walks), 2, 1), frame).max_error <= most * (1 + 1e-9)


def test_on_a_known_map_its_nodes_stay(day):
    frame = lattice()
    early, late = ([Track(name, day.times[part], day.positions[part])] for name, part in (("a", slice(1000)), ("b", slice(1000, None))))
    none = [np.zeros(999, bool)]
    target = RMSE / quantum(frame.space)
    past = Past(learn(lay_slots(early, none, frame), 1, Plan(target=target, rounds=4)).walks)
    slots = lay_slots(late, none, frame)
    first = learn(slots, 1, Plan(target=target, rounds=4), known=past)
    polished = polish(slots, first, target=target, known=past, work=WORK)
    data = encode(polished.walks, past)
    read = decode(data, 2, 1, past)
    assert len(data) == polished.size < first.size
    assert read.nodes[: past.nodes].tolist() == past.walks.nodes.tolist()
    assert measured(late, read, frame).rmse <= RMSE


def test_what_can_not_be_polished_comes_back_as_it_is(day):
    tracks, gaps, frame = setting("plain", day)
    slots, target = lay_slots(tracks, gaps, frame), RMSE / quantum(frame.space)
    first = learn(slots, 1, Plan(target=target, rounds=6))
    missing = Outcome(first.walks, first.size, first.error, 2)
    beside = Outcome(LatticeWalks(first.walks.nodes, (LatticeWalk(*trimmed(first.walks.walks[0])),)), first.size, first.error)
    assert polish(slots, missing, target=target) is missing
    assert polish(slots, beside, target=target) is beside
    assert polish(slots, first, target=target, work=0) is first
    assert polish(slots, first, target=first.error / 2, work=WORK) is first


def trimmed(walk):
    return walk.nodes[1:], walk.cells[1:], walk.gaps[1:]


def test_the_smallest_outcomes_are_polished_each_once():
    walk = LatticeWalk(np.zeros(80, np.int32), np.arange(80), np.zeros(79, bool))
    outcomes = [Outcome(LatticeWalks(np.zeros((1, 2), np.int64), (walk,)), size, 1.0) for size in (9, 7, 7, 8, 10)]
    assert [one.size for one in best_outcomes(outcomes, 6)] == [7, 8, 9, 10]
    assert [one.size for one in best_outcomes(outcomes, 1)] == [7]
    assert best_outcomes([], 5) == []


@pytest.mark.parametrize("kind", ["plain", "gaps", "3-D"])
def test_added_errors_are_those_of_the_samples(kind, day):
    tracks, gaps, frame = setting(kind, day)
    slots = lay_slots(tracks, gaps, frame)
    walks = learn(slots, 1, Plan(target=RMSE / quantum(frame.space), rounds=6)).walks
    bench = _bench(slots, _knots_on(slots, walks), walks, None, WORK)
    chain, offers = bench.chain, bench.offers
    offers.terms[0] = 20.0
    seen = set()
    for j in range(0, int(chain.counts[KNOTS]), 3):
        offer_changes(bench.samples, chain, bench.ways, offers, 0, j, 0.1)
        for row in range(int(offers.filled[0])):
            other = type(chain)(*(array.copy() for array in chain))
            old, count = exact(slots, chain), int(offers.count[row])
            assert replace_knots(
                bench.samples, other, 0, offers.first[row], offers.after[row], offers.count[row], offers.slots[row], offers.nodes[row]
            )
            assert exact(slots, other) - old == pytest.approx(offers.error[row], rel=2e-2, abs=0.5)  # the sums count in whole ticks
            assert other.totals[SQUARE] - chain.totals[SQUARE] == pytest.approx(offers.error[row], rel=1e-6, abs=1e-5)
            seen.add((int(offers.after[row] - offers.first[row]), count))
    # moved or given another node; left out; two made one; another put between
    assert {(1, 1), (3, 2), (2, 1), (0, 1)} <= seen


def test_the_error_of_a_moved_node_is_that_of_the_samples(day):
    tracks, gaps, frame = setting("gaps", day)
    slots = lay_slots(tracks, gaps, frame)
    walks = learn(slots, 1, Plan(target=RMSE / quantum(frame.space), rounds=6)).walks
    chain = (bench := _bench(slots, _knots_on(slots, walks), walks, None, WORK)).chain
    used = int(chain.counts[KNOTS])
    for node in range(0, len(walks.nodes), 3):
        knots = np.flatnonzero(chain.node[:used] == node)
        other = type(chain)(*(array.copy() for array in chain))
        other.places[node] += (1, -2)
        added = _error_at(bench.samples, chain, node, other.places[node], knots, len(knots))
        assert exact(slots, other) - exact(slots, chain) == pytest.approx(added, rel=1e-2, abs=0.5)


def exact(slots, chain):
    """Squared error of a chain from the samples themselves, without any sums."""
    used = int(chain.counts[KNOTS])
    total = 0.0
    for a, b in zip(range(used - 1), range(1, used), strict=True):
        if chain.joined[b]:
            p, q = chain.slot[a], chain.slot[b]
            inside = slice(slots.ends[p], slots.ends[q])
            share = (slots.times[inside] - slots.cells[p]) / (slots.cells[q] - slots.cells[p])
            start, end = chain.places[chain.node[a]], chain.places[chain.node[b]]
            total += ((start + share[:, None] * (end - start) - slots.spots[inside]) ** 2).sum()
    return total


def test_what_is_left_of_the_error_allowed_is_made_use_of():
    tracks = [Track(name, *drive) for name, drive in drives(blocks=4, vehicles=6, period=15.0, seed=2).items()]
    frame = Frame((0, 0), 0, quantum_index(9.6), quantum_index(2.2))
    slots, unit = lay_slots(tracks, [np.zeros(len(track) - 1, bool) for track in tracks], frame), quantum(frame.space)
    first = learn(slots, len(tracks), Plan(target=7.2 / unit, rounds=12))
    polished = polish(slots, first, target=8.0 / unit, work=WORK)
    assert polished.size < first.size
    assert 0.985 * 8.0 < polished.error * unit <= 8.0


def share_of(slots, walks, groups):
    """Root mean square error of each group, in quanta, sample by sample."""
    at = _knots_on(slots, walks)
    errors, _ = sample_errors(slots, list_parts(slots, at, len(walks.nodes)), walks.nodes.astype(float))
    return np.sqrt(np.bincount(groups, weights=errors**2) / np.bincount(groups))


def test_each_group_keeps_to_an_error_of_its_own(day):
    tracks, gaps, frame = setting("tracks", day)
    slots, unit = lay_slots(tracks, gaps, frame), quantum(frame.space)
    groups = np.repeat([0, 0, 1], [len(track) for track in tracks])
    first = learn(slots, len(tracks), Plan(target=0.9995 * RMSE / unit, rounds=6))
    allowed = share_of(slots, first.walks, groups) * [0.9, 1.3]
    polished = polish(slots, first, shares=Shares(groups, allowed), work=WORK)
    found = share_of(slots, polished.walks, groups)
    assert (found <= allowed).all()
    assert found[1] > allowed[1] / 1.3
    again = polish(slots, polished, shares=Shares(groups, allowed), work=WORK)
    assert again.size <= polished.size < 1.1 * first.size


def test_walks_are_given_back_where_no_share_can_be_kept(day):
    tracks, gaps, frame = setting("tracks", day)
    slots = lay_slots(tracks, gaps, frame)
    first = learn(slots, len(tracks), Plan(target=RMSE / quantum(frame.space), rounds=6))
    groups = np.repeat([0, 1, 1], [len(track) for track in tracks])
    assert polish(slots, first, shares=Shares(groups, np.array([1e-3, 1.0])), work=WORK // 10) is first
