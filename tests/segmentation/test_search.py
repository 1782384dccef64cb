from __future__ import annotations

import numpy as np
import pytest

from gpszip.errors import BoundError, InputError, OptionError
from gpszip.model import Track
from gpszip.run import Threads
from gpszip.segmentation import search
from gpszip.segmentation.bound import segment_mean_within, shortest_mean_within
from gpszip.segmentation.em import Problem, segment_mean
from gpszip.segmentation.evaluate import distances, rmse
from gpszip.segmentation.memo import Memo, memo_key
from gpszip.segmentation.search import find_elbow, find_parameters


def rounds(laps=8, noise=0.3):
    corners = np.array([[0, 0], [60, 0], [60, 40], [0, 40]], dtype=float)
    u = np.linspace(0, 1, 12)[:, None]
    positions = np.concatenate(
        [corners[j] * (1 - u) + corners[(j + 1) % 4] * u for j in range(4)] * laps
    )
    positions = positions + np.random.default_rng(0).normal(0, noise, positions.shape)
    return Track("rounds", np.arange(len(positions)), positions)


@pytest.fixture
def solved(monkeypatch):
    """The (k, m) that were solved, in order."""
    pairs = []

    def counted(problem, pair):
        pairs.append(pair)
        return problem.solve(*pair)

    monkeypatch.setattr(search, "_mean_of_pair", counted)
    return pairs


@pytest.mark.parametrize("low", [1, 2, 5])
@pytest.mark.parametrize("width", [*range(12), 40, 101])
@pytest.mark.parametrize("bend", [0.1, 0.5, 0.9])
def test_the_elbow_of_a_bent_curve_is_found_in_few_evaluations(low, width, bend):
    high = low + width
    knee = low + round(bend * width)
    curve = {
        x: max(
            1000.0 - 990 * (x - low) / max(knee - low, 1), 10 - 9 * (x - knee) / max(high - knee, 1)
        )
        for x in range(low, high + 1)
    }
    calls = []

    def costs_of(numbers):
        calls.extend(numbers)
        return [curve[x] for x in numbers]

    depth = {x: -curve[x] - (curve[low] - curve[high]) * (x - low) / max(width, 1) for x in curve}
    elbow = find_elbow(low, high, costs_of)
    assert depth[elbow] == pytest.approx(max(depth.values()))
    assert len(calls) <= 2 + 2 * np.log(max(width, 2)) / np.log(1.5) + 3


def test_the_elbow_returns_the_best_evaluated_when_noise_makes_two_peaks():
    costs = {1: 10, 2: 9, 3: 2, 4: 8, 5: 7, 6: 6, 7: 4, 8: 2.5, 9: 2, 10: 1}
    evaluated = []

    def costs_of(numbers):
        evaluated.extend(numbers)
        return [costs[x] for x in numbers]

    elbow = find_elbow(1, 10, costs_of)
    assert elbow == min(evaluated, key=lambda x: costs[x] + x)


def test_a_flat_curve_gives_its_lower_end():
    assert find_elbow(3, 50, lambda numbers: [1.0] * len(numbers)) == 3


def test_laps_of_a_square_have_four_segments(solved):
    found = find_parameters(rounds(), (30, 60), (1, 30))
    assert found.m == 4
    assert (found.k, found.m) == (found.mean.k, found.mean.m)
    assert len(solved) == len(set(solved)) == len(found.evaluated)
    assert {(k, m) for k, m, _ in found.evaluated} == set(solved)
    assert all(k >= m for k, m in solved)
    (searched,) = (cost for k, m, cost in found.evaluated if (k, m) == (found.k, found.m))
    full = segment_mean(rounds(), found.k, found.m)
    assert full.cost == found.mean.cost <= searched <= 1.01 * full.cost


def test_the_result_is_the_same_for_any_number_of_workers():
    track = rounds(4)
    serial, threaded = (
        find_parameters(track, (2, 30), (1, 6)),
        find_parameters(track, (2, 30), (1, 6), executor=Threads(3)),
    )
    assert serial.evaluated == threaded.evaluated
    assert serial.mean.costs == threaded.mean.costs


def test_a_memo_in_a_folder_saves_solving_again(solved, tmp_path):
    track = rounds(4)
    first = find_parameters(track, (2, 20), (1, 5), memo=Memo(tmp_path))
    runs = len(solved)
    second = find_parameters(track, (2, 20), (1, 5), memo=Memo(tmp_path))
    assert len(solved) == runs
    assert second.evaluated == first.evaluated
    assert second.mean.boundaries.tolist() == first.mean.boundaries.tolist()
    assert second.mean.starts.tobytes() == first.mean.starts.tobytes()
    find_parameters(track, (2, 20), (1, 5), memo=Memo(tmp_path), expectation="linear")
    assert len(solved) > runs


def test_the_key_depends_on_data_and_options():
    track = rounds(1)
    changed = Track("rounds", track.times, track.positions + 1e-9)
    weighted = Track("rounds", track.times, track.positions, weights=np.ones(len(track)))
    names = {
        memo_key(track, {}),
        memo_key(changed, {}),
        memo_key(weighted, {}),
        memo_key(track, {"min_samples": 2}),
    }
    assert len(names) == 4
    assert memo_key(track, {"a": 1, "b": 2}) == memo_key(
        Track("other", track.times, track.positions), {"b": 2, "a": 1}
    )


def test_a_damaged_or_misnamed_memo_is_refused(tmp_path):
    track = rounds(1)
    memo, mean = Memo(tmp_path), segment_mean(track, 4, 2)
    memo.put("key", mean)
    (path,) = tmp_path.iterdir()
    intact = path.read_bytes()
    for content in (
        b"",
        b"no memo",
        intact[: len(intact) // 2],
        intact[:300] + bytes([intact[300] ^ 255]) + intact[301:],
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match="delete it"):
            Memo(tmp_path).get("key", 4, 2)
    path.write_bytes(intact)
    path.rename(tmp_path / "key-k5-m2.npz")
    with pytest.raises(InputError, match="another segment mean"):
        Memo(tmp_path).get("key", 5, 2)
    assert Memo(tmp_path).get("key", 4, 2) is None


def test_a_failed_write_leaves_no_file(tmp_path, monkeypatch):
    def full(*_):
        raise OSError("disk full")

    monkeypatch.setattr("gpszip.segmentation.memo.os.fsync", full)
    with pytest.raises(OSError, match="disk full"):
        Memo(tmp_path).put("key", segment_mean(rounds(1), 4, 2))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("k_range", "m_range"),
    [((5, 4), (1, 2)), ((0, 4), (1, 2)), ((1, 4), (1, 5)), ((1, 999), (1, 5))],
)
def test_ranges_that_do_not_fit_are_refused(k_range, m_range):
    with pytest.raises(OptionError):
        find_parameters(rounds(1), k_range, m_range)


@pytest.mark.parametrize("m", [None, 4, 0.5])
def test_an_rmse_bound_is_met_with_few_intervals(m):
    track = rounds(5)
    mean = segment_mean_within(track, rmse=0.5, m=m)
    assert rmse(mean, track) <= 0.5
    assert mean.k <= 24
    assert mean.m == {None: mean.k, 4: 4, 0.5: round(0.5 * mean.k)}[m]


def test_a_maximum_bound_is_met():
    track = rounds(5)
    mean = segment_mean_within(track, max_error=1.5)
    assert distances(mean, track).max() <= 1.5
    assert mean.k <= 30


def test_a_loose_bound_gives_one_interval():
    assert segment_mean_within(rounds(2), rmse=1e4).k == 1


def test_an_unreachable_bound_is_an_error():
    with pytest.raises(BoundError, match=r"an RMSE of .* m; allow more segments \(m\)"):
        segment_mean_within(rounds(1), rmse=0.01, m=2)


def test_a_search_for_k_ends_where_more_intervals_help_no_more(monkeypatch):
    tried = []
    solve = Problem.solve

    def count(problem, k, m, **options):
        tried.append(k)
        return solve(problem, k, m, **options)

    monkeypatch.setattr(Problem, "solve", count)
    track = rounds(4)
    with pytest.raises(BoundError) as failed:
        segment_mean_within(track, rmse=0.01, m=2)
    monkeypatch.undo()
    # It names the best one, and went a few times beyond it.
    best = min(tried, key=lambda k: rmse(segment_mean(track, k, 2), track))
    assert f"{best} have an RMSE of" in str(failed.value)
    assert 4 * best <= max(tried) < 5 * best < len(track)


@pytest.mark.parametrize(
    "options",
    [{}, {"rmse": 0.0}, {"max_error": -1.0}, {"rmse": 1.0, "m": 0}, {"rmse": 1.0, "m": 1.5}],
)
def test_bounds_out_of_range_are_refused(options):
    with pytest.raises(OptionError):
        segment_mean_within(rounds(1), **options)


def test_the_share_that_is_done_grows_to_all_of_it():
    shares = []
    find_parameters(rounds(2), (2, 20), (1, 5), report=shares.append)
    assert shares == sorted(shares)
    assert 0 < shares[0] < 0.5 < shares[-1] <= 1


@pytest.mark.parametrize("k", [20, 28])
def test_with_k_given_the_least_m_meets_the_bound(k):
    track = rounds(5)
    mean = segment_mean_within(track, rmse=0.5, k=k)
    assert mean.k == k
    assert rmse(mean, track) <= 0.5
    # fewer segments don't meet it; bisection sees some of them only
    assert rmse(segment_mean(track, k, mean.m - 1), track) > 0.5


def test_k_too_few_for_the_bound_is_an_error():
    track = rounds(2)
    with pytest.raises(BoundError, match=r"with 3 of their own .* allow (\d+) intervals") as failed:
        segment_mean_within(track, rmse=0.1, k=3)
    # As many as it names do.
    enough = int(str(failed.value).split("allow ")[1].split()[0])
    assert segment_mean_within(track, rmse=0.1, k=enough).k == enough
    with pytest.raises(BoundError, match="2 intervals of 1 segments"):
        segment_mean_within(rounds(2), rmse=0.1, k=2, m=1)


def test_a_short_description_has_shared_segments():
    track, shares = rounds(5), []
    mean = shortest_mean_within(track, rmse=0.6, report=shares.append)
    free = segment_mean_within(track, rmse=0.6)
    assert rmse(mean, track) <= 0.6
    # both ends of each segment in two coordinates, and label and time of each interval
    assert 4 * mean.m + 2 * mean.k < 4 * free.m + 2 * free.k
    assert mean.m < 8
    assert shares == sorted(shares)


def test_a_search_that_stops_early_finds_what_a_full_one_finds(monkeypatch):
    track = rounds(6)
    early = find_parameters(track, (2, 48), (1, 24))
    monkeypatch.setattr(search, "_TOLERANCE", 0.0)
    monkeypatch.setattr(search, "_LEAST_GAIN", 0.0)
    full = find_parameters(track, (2, 48), (1, 24))
    assert (early.k, early.m, early.mean.cost) == (full.k, full.m, full.mean.cost)


def test_searches_for_several_m_ask_together():
    asked = []

    def costs_of(pairs):
        asked.append(pairs)
        return [1000 / k + k + m for k, m in pairs]

    found = search._run_together(
        [search._elbow_steps(1, 20), search._elbow_steps(3, 40)], [1, 3], costs_of
    )
    alone = [
        find_elbow(low, high, lambda ks, m=m: [1000 / k + k + m for k in ks])
        for low, high, m in ((1, 20, 1), (3, 40, 3))
    ]
    assert found == alone
    assert {m for _, m in asked[0]} == {1, 3}


@pytest.mark.parametrize(("ks", "ms"), [((1, 1), (1, 1)), ((4, 30), (4, 4)), ((9, 9), (2, 9))])
def test_ranges_may_be_a_single_number(ks, ms):
    found = find_parameters(rounds(2), ks, ms)
    assert ks[0] <= found.k <= ks[1]
    assert ms[0] <= found.m <= ms[1]
