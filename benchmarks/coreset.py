"""What a coreset of so many blocks is worth, on a generated robot patrol.

The first table: its file, the error of its own blocks, a stream's against it, and how far its prices are from the truth, with the
half-width of the bounds, each the worst of 60 functions: polylines near the track, polylines elsewhere, and 50 spikes at a block's
end. The second is the thesis's figure 8-7: the RMSE, over all samples, of the (k,m)-segment mean that was learnt on the coreset's
weighted points, and of the archive that is compressed from them.
"""

import io
import resource

import numpy as np

import gpszip
from gpszip import testing
from gpszip.io.coresets import write_coreset
from gpszip.sketches.pieces import PiecewiseLinear, from_segment_mean, polyline
from gpszip.sketches.samples import weighted_samples

SIZES = (300, 600, 1200, 2400, 4800)
K, M, PARTS = 200, 40, 300


def main() -> None:
    track = testing.patrol()
    print(
        "blocks  file kB  RMSE m  stream/offline   near: error bounds   elsewhere: error bounds   spikes: error bounds"
    )
    for size in SIZES:
        small = gpszip.coreset(track, size=size)
        stream = gpszip.CoresetStream(size)
        stream.push(track.times, track.positions)
        prices = [worst(small, track, kind) for kind in (near, elsewhere, spikes)]
        told = "   ".join(f"{100 * error:9.3f} % {100 * width:8.3f} %" for error, width in prices)
        print(
            f"{size:6} {file_size(small) / 1e3:8.1f} {small.rmse:7.3f} {stream.coreset().error / small.error:13.2f}   {told}"
        )
    print(f"\nblocks  points   RMSE of k={K}, m={M} m   CPU s   archive B   RMSE m")
    for size in (*SIZES, None):
        learn(track, size)


def learn(track: gpszip.Track, size: int | None) -> None:
    few = track if size is None else weighted_samples(gpszip.coreset(track, size=size), track)[0]
    start = cpu()
    mean = gpszip.segment_mean(few, k=K, m=M)
    spent = cpu() - start
    rmse = np.sqrt(cost(track, from_segment_mean(mean, few.times)) / len(track))
    archive = gpszip.compress(track, rmse=0.24, coreset=size)
    found = archive.position(track.id, track.times)
    off = np.sqrt(((found - track.positions) ** 2).sum(axis=1).mean())
    name = "all" if size is None else f"{size}"
    print(
        f"{name:>6} {len(few):7} {rmse:23.3f} {spent:7.1f} {len(archive.to_bytes()):11} {off:8.3f}"
    )


def file_size(small: gpszip.Coreset) -> int:
    file = io.BytesIO()
    write_coreset(small, file)
    return len(file.getvalue())


def worst(small, track, make) -> tuple[float, float]:
    """Largest relative error of the estimate, and half-width of the bounds, of 60 functions; the bounds are checked."""
    rng = np.random.default_rng(1)
    errors, widths = [], []
    for _ in range(60):
        f = make(small, track, rng)
        truth, price = cost(track, f), small.cost(f)
        assert price.lower <= truth * (1 + 1e-9) and truth * (1 - 1e-9) <= price.upper
        errors.append(abs(price.estimate - truth) / truth)
        widths.append((price.upper - price.lower) / 2 / truth)
    return max(errors), max(widths)


def near(_, track, rng) -> PiecewiseLinear:
    knots = np.sort(rng.choice(len(track), PARTS, replace=False))
    knots[0], knots[-1] = 0, len(track) - 1
    return polyline(track.times[knots], track.positions[knots])


def elsewhere(_, track, rng) -> PiecewiseLinear:
    knots = np.sort(rng.choice(len(track), PARTS, replace=False))
    knots[0], knots[-1] = 0, len(track) - 1
    return polyline(
        track.times[knots],
        rng.uniform(track.positions.min(axis=0), track.positions.max(axis=0), (PARTS, 2)),
    )


def spikes(small, track, rng) -> PiecewiseLinear:
    a, b = small.edges[rng.integers(len(small))]
    inside = np.linspace(b - 0.15 * (b - a), b, 50)
    around = np.linspace(track.times[0], track.times[-1], 4 * PARTS)
    times = np.unique(np.concatenate([around, inside]))
    places = np.stack([np.interp(times, track.times, axis) for axis in track.positions.T], axis=1)
    places[np.isin(times, inside)] += np.where(np.arange(50) % 2, 5.0, -5.0)[:, None]
    return polyline(times, places)


def cost(track, f: PiecewiseLinear) -> float:
    j = np.searchsorted(f.breaks, track.times, side="right")
    there = f.starts[j] + f.velocities[j] * (track.times - f.start_times[j])[:, None]
    return float(((there - track.positions) ** 2).sum())


def cpu() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
