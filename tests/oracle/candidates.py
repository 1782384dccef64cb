"""Classes of candidates in exact numbers, by their definition in docs/format.md."""

from fractions import Fraction

OCTAVES = 13
KINDS = 8
BARRED = OCTAVES * KINDS
BOUNDS = [Fraction(bound) for bound in ("0.97", "0.75", "0.25", "-0.25", "-0.75", "-0.97")]


def step_between(start, end):
    return [int(b) - int(a) for a, b in zip(start, end, strict=True)]


def scalar_product(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def octave(step, mean_length):
    """How many of the bounds b, 2 b, 4 b, ... the squared length of a step reaches."""
    reach = min(max(mean_length, 64), 2**27)
    bound = Fraction((reach * 181 // 1024) ** 2, 256)
    limited = [min(abs(x), 2**25) for x in step]
    square = scalar_product(limited, limited)
    return sum(square >= bound * 2**k for k in range(OCTAVES - 1))


def bearing(before, step):
    """How many bounds cos * abs(cos) of a turn is not above; 7 without a turn."""
    if before is None or not any(before) or not any(step):
        return 7
    dot = scalar_product(before, step)
    square = scalar_product(before, before) * scalar_product(step, step)
    return sum(Fraction(dot * abs(dot), square) <= bound for bound in BOUNDS)


def classify(positions, u, before, mean_length, barred=(), gap_ends=None):
    """Class of each node as a candidate for u; after a gap, ``gap_ends`` counts those of nodes."""
    arrival = None if before is None else step_between(positions[before], positions[u])
    classes = []
    for w, position in enumerate(positions):
        step = step_between(positions[u], position)
        if gap_ends is None:
            kind = bearing(arrival, step)
        else:
            kind = sum(gap_ends[w] > few for few in (0, 1, 3))
        classes.append(BARRED if w in {u, *barred} else octave(step, mean_length) * KINDS + kind)
    return classes
