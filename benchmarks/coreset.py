"""Measure what coresets of different sizes are worth, on a generated robot patrol.

    python benchmarks/coreset.py

The first table gives, for each number of blocks, the size of the file, the error of the blocks,
the error of a streamed coreset relative to it, and how far estimates of costs are from the true
costs, with the half-width of the bounds. Each is the worst of 60 functions of three kinds:
polylines near the track, polylines elsewhere, and polylines with 50 spikes at the end of a block.

The second table is figure 8-7 of the thesis. It gives the RMSE, over all samples, of the
(k,m)-segment mean that is learned from the weighted points of the coreset, and of the archive
that is compressed from them.
"""

import io
import resource

import numpy as np

import gpszip
from gpszip import testing
from gpszip.io.coresets import write_coreset
from gpszip.sketches.pieces import PiecewiseLinear, from_segment_mean, polyline
from gpszip.sketches.samples import weighted_samples

#: Numbers of blocks.
SIZES = (300, 600, 1200, 2400, 4800)

#: Segments of the (k,m)-segment mean.
K = 200

#: Distinct segments of the (k,m)-segment mean.
M = 40

#: Knots of the polylines whose costs are estimated.
KNOTS = 300

#: Functions of each kind.
FUNCTIONS = 60


def main() -> None:
    track = testing.patrol()
    print(
        "blocks  file kB  RMSE m  stream/offline   near: error bounds   "
        "elsewhere: error bounds   spikes: error bounds"
    )
    for size in SIZES:
        print_estimates(track, size)
    print(f"\nblocks  points   RMSE of k={K}, m={M} m   CPU s   archive B   RMSE m")
    for size in (*SIZES, None):
        print_learning(track, size)


def print_estimates(track: gpszip.Track, size: int) -> None:
    """Print the row of one size of the first table."""
    coreset = gpszip.coreset(track, size=size)
    stream = gpszip.CoresetStream(size)
    stream.push(track.times, track.positions)
    stream_error = stream.coreset().error / coreset.error

    kinds = (polyline_near_track, polyline_elsewhere, polyline_with_spikes)
    worst = [worst_estimate(coreset, track, kind) for kind in kinds]
    estimates = "   ".join(f"{100 * error:9.3f} % {100 * width:8.3f} %" for error, width in worst)
    print(
        f"{size:6} {file_size(coreset) / 1e3:8.1f} {coreset.rmse:7.3f} "
        f"{stream_error:13.2f}   {estimates}"
    )


def print_learning(track: gpszip.Track, size: int | None) -> None:
    """Print the row of one size of the second table; None learns from all samples."""
    samples = track
    if size is not None:
        samples = weighted_samples(gpszip.coreset(track, size=size), track)[0]

    # The (k,m)-segment mean.
    start = cpu_seconds()
    mean = gpszip.segment_mean(samples, k=K, m=M)
    seconds = cpu_seconds() - start
    mean_rmse = np.sqrt(true_cost(track, from_segment_mean(mean, samples.times)) / len(track))

    # The archive.
    archive = gpszip.compress(track, rmse=0.24, coreset=size)
    errors = archive.position(track.id, track.times) - track.positions
    archive_rmse = np.sqrt((errors**2).sum(axis=1).mean())
    name = "all" if size is None else f"{size}"
    print(
        f"{name:>6} {len(samples):7} {mean_rmse:23.3f} {seconds:7.1f} "
        f"{len(archive.to_bytes()):11} {archive_rmse:8.3f}"
    )


def file_size(coreset: gpszip.Coreset) -> int:
    file = io.BytesIO()
    write_coreset(coreset, file)
    return len(file.getvalue())


def worst_estimate(coreset: gpszip.Coreset, track: gpszip.Track, kind) -> tuple[float, float]:
    """Return the largest relative error of an estimate and the largest half-width of the bounds.

    All bounds are checked.
    """
    rng = np.random.default_rng(1)
    errors, widths = [], []
    for _ in range(FUNCTIONS):
        function = kind(coreset, track, rng)
        truth, cost = true_cost(track, function), coreset.cost(function)
        assert cost.lower <= truth * (1 + 1e-9)
        assert truth * (1 - 1e-9) <= cost.upper
        errors.append(abs(cost.estimate - truth) / truth)
        widths.append((cost.upper - cost.lower) / 2 / truth)
    return max(errors), max(widths)


def polyline_near_track(_, track, rng) -> PiecewiseLinear:
    """Return a polyline through random samples."""
    knots = random_knots(track, rng)
    return polyline(track.times[knots], track.positions[knots])


def polyline_elsewhere(_, track, rng) -> PiecewiseLinear:
    """Return a polyline through random positions within the extent of the track."""
    knots = random_knots(track, rng)
    lowest, highest = track.positions.min(axis=0), track.positions.max(axis=0)
    return polyline(track.times[knots], rng.uniform(lowest, highest, (KNOTS, 2)))


def random_knots(track, rng) -> np.ndarray:
    """Return the rows of random samples, with the first and the last one."""
    knots = np.sort(rng.choice(len(track), KNOTS, replace=False))
    knots[0], knots[-1] = 0, len(track) - 1
    return knots


def polyline_with_spikes(coreset, track, rng) -> PiecewiseLinear:
    """Return a polyline on the track with 50 spikes of 5 m in the last 15 % of a block."""
    begin, end = coreset.edges[rng.integers(len(coreset))]
    spike_times = np.linspace(end - 0.15 * (end - begin), end, 50)
    other_times = np.linspace(track.times[0], track.times[-1], 4 * KNOTS)
    times = np.unique(np.concatenate([other_times, spike_times]))
    axes = [np.interp(times, track.times, axis) for axis in track.positions.T]
    positions = np.stack(axes, axis=1)
    heights = np.where(np.arange(50) % 2, 5.0, -5.0)[:, None]
    positions[np.isin(times, spike_times)] += heights
    return polyline(times, positions)


def true_cost(track: gpszip.Track, function: PiecewiseLinear) -> float:
    """Return the sum of squared distances of all samples to a function."""
    piece = np.searchsorted(function.breaks, track.times, side="right")
    elapsed = (track.times - function.start_times[piece])[:, None]
    positions = function.starts[piece] + function.velocities[piece] * elapsed
    return float(((positions - track.positions) ** 2).sum())


def cpu_seconds() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


if __name__ == "__main__":
    main()
