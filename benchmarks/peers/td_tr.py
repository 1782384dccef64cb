"""TD-TR: Douglas-Peucker with the synchronised distance (Meratnia and de By, EDBT 2004)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpszip.kernels.jit import jit

from .log import Floats, Integers, Log


def simplify(log: Log, tolerance: float) -> Integers:
    """Keep the ends of all tracks, and what TD-TR keeps between them.

    Returns
    -------
    int64 array
        Indices of the samples kept. Every sample lies within ``tolerance`` metres of the line
        between those kept before and after it, at its own time.
    """
    return np.flatnonzero(_mark_kept(log.clock, log.x, log.y, log.firsts, tolerance))


@jit
def _mark_kept(
    t: Floats, x: Floats, y: Floats, firsts: Integers, tolerance: float
) -> NDArray[np.bool_]:
    """Mark the samples that TD-TR keeps.

    The synchronised distance of sample i from the line between a and b is
    ``|p_i - p_a - (t_i - t_a) / (t_b - t_a) (p_b - p_a)|``. The sample of the largest distance is
    kept where that exceeds the tolerance, and cuts the range in two.
    """
    kept = np.zeros(len(t), np.bool_)
    stack = np.empty((len(t) + 1, 2), np.int64)
    for track in range(len(firsts) - 1):
        # The whole track is the first range.
        stack[0, 0], stack[0, 1] = firsts[track], firsts[track + 1] - 1
        kept[stack[0, 0]] = kept[stack[0, 1]] = True
        size = 1

        while size > 0:
            # The sample farthest from the line of a range.
            size -= 1
            a, b = stack[size, 0], stack[size, 1]
            worst, at = tolerance * tolerance, -1
            duration = max(t[b] - t[a], 1e-12)
            vx, vy = (x[b] - x[a]) / duration, (y[b] - y[a]) / duration
            for i in range(a + 1, b):
                dx = x[i] - x[a] - vx * (t[i] - t[a])
                dy = y[i] - y[a] - vy * (t[i] - t[a])
                if dx * dx + dy * dy > worst:
                    worst, at = dx * dx + dy * dy, i

            # Cut the range there.
            if at >= 0:
                kept[at] = True
                stack[size, 0], stack[size, 1] = a, at
                stack[size + 1, 0], stack[size + 1, 1] = at, b
                size += 2
    return kept
