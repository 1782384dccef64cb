"""Windows of a track, one by one, by sums over many positions."""

import numpy as np


def window_moments(times, positions, noise, begin, window, count=20_001):
    """Mean position, mean square distance from it, and mean square error of one window."""
    # Cells of equal time, each by its middle.
    cell = window / count
    middle = begin + cell * (np.arange(count) + 0.5)
    path = np.stack([np.interp(middle, times, axis) for axis in positions.T], axis=1)
    mean = path.mean(axis=0)
    variance = ((path - mean) ** 2).sum(axis=1).mean()
    return mean, variance, np.interp(middle, times, noise**2).mean()


def still_ranges(times, positions, noise, window, radius):
    """Time ranges covered by windows at fixes whose spread a place explains, and slow steps."""
    covered, buckets = [], set()
    for begin in sorted([*times, *(times - window)]):
        bucket = begin // (window / 60)
        if times[0] <= begin and begin + window <= times[-1] and bucket not in buckets:
            buckets.add(bucket)
            _, variance, error = window_moments(times, positions, noise, begin, window)
            if variance <= (radius / 2) ** 2 + error:
                covered.append((begin, begin + window))
    for i in range(len(times) - 1):
        duration = times[i + 1] - times[i]
        way = np.linalg.norm(positions[i + 1] - positions[i])
        if duration >= window and way / duration <= radius * np.sqrt(3) / window:
            covered.append((times[i], times[i + 1]))

    joined = []
    for begin, end in sorted(covered):
        if joined and begin <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], end)
        else:
            joined.append([begin, end])
    return np.array(joined).reshape(-1, 2)
