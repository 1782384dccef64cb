"""TD-TR and CISED-S as their papers define them, slowly."""

import numpy as np
import shapely


def synchronised_distances(t, p, a, b):
    """Distances of the samples between a and b from the line between these two."""
    share = ((t[a + 1 : b] - t[a]) / (t[b] - t[a]))[:, None]
    return np.linalg.norm(p[a + 1 : b] - (p[a] + share * (p[b] - p[a])), axis=1)


def td_tr(t, p, tolerance):
    """Samples kept: both ends, and where one is too far from their line, those of both parts."""

    def between(a, b):
        distances = synchronised_distances(t, p, a, b)
        if not len(distances) or distances.max() <= tolerance:
            return []
        at = a + 1 + int(distances.argmax())
        return [*between(a, at), at, *between(at, b)]

    return [0, *between(0, len(t) - 1), len(t) - 1] if len(t) > 1 else [0]


def cised(t, p, tolerance, sides, *, narrow):
    """Samples kept: cones are cut one second after the first sample of each line."""
    radius = tolerance / 2 if narrow else tolerance
    angles = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    corners = np.column_stack([np.cos(angles), np.sin(angles)])
    kept = [0]
    while kept[-1] < len(t) - 1:
        start = kept[-1]
        common, end = None, start + 1
        for i in range(start + 1, len(t)):
            center = (p[i] - p[start]) / (t[i] - t[start])
            if not narrow and (common is None or common.covers(shapely.Point(center))):
                end = i
            circle = shapely.Polygon(center + radius / (t[i] - t[start]) * corners)
            common = circle if common is None else common.intersection(circle)
            if common.is_empty:
                break
            if narrow:
                end = i
        kept.append(end)
    return kept
