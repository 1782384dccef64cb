"""The fewest knots of a curve, by trying all lines between samples."""

import numpy as np


def fewest_knots(times, values, bound, step):
    """Number of knots at samples, with multiples of a step as values, within a bound."""
    values = np.asarray(values, dtype=float)
    grid = [
        [k * step for k in range(int(np.ceil((y - bound) / step)), int((y + bound) // step) + 1)]
        for y in values
    ]
    best = [dict.fromkeys(grid[0], 1)] + [{} for _ in values[1:]]
    for j in range(1, len(values)):
        for i in range(j):
            for u, knots in best[i].items():
                for v in grid[j]:
                    line = u + (v - u) * (times[i : j + 1] - times[i]) / (times[j] - times[i])
                    if (np.abs(line - values[i : j + 1]) <= bound).all():
                        best[j][v] = min(best[j].get(v, len(values)), knots + 1)
    return min(best[-1].values())
