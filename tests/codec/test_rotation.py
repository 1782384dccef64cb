import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calling import from_python
from gpszip.codec import rotation_tables
from gpszip.codec.kernels.rotation import DIRECTIONS, nearest_direction, rotate, rotate_back
from oracle.walk_decoder import TURN_TABLES, plain_direction, plain_rotate_back

# Inner kernels, as Python calls them.
rotate_back = from_python(rotate_back)
rotate = from_python(rotate)
nearest_direction = from_python(nearest_direction)

far = (
    st.integers(-100, 100)
    | st.integers(-(2**46), 2**46)
    | st.sampled_from([2**45, -(2**45), 2**40, 2**40 - 1])
)
turns = st.integers(0, DIRECTIONS - 1)


@given(far, far, turns)
def test_rotation_is_undone_exactly(x, y, turn):
    assert rotate_back(*rotate(x, y, turn), turn) == (x, y)
    assert rotate(*rotate_back(x, y, turn), turn) == (x, y)


@given(far, far, turns)
def test_the_plain_rotation_agrees(x, y, turn):
    assert plain_rotate_back(x, y, turn) == rotate_back(x, y, turn)


def test_rotation_is_undone_for_all_small_vectors_and_turns():
    for turn in range(DIRECTIONS):
        seen = {rotate(x, y, turn) for x in range(-6, 7) for y in range(-6, 7)}
        assert len(seen) == 169


@given(st.integers(-(10**6), 10**6), st.integers(-(10**6), 10**6), turns)
def test_rotation_is_nearly_exact(x, y, turn):
    angle = 2 * math.pi * turn / DIRECTIONS
    along, across = rotate(x, y, turn)
    slack = 2.0 + 2e-4 * math.hypot(x, y)
    assert abs(along - (x * math.cos(angle) + y * math.sin(angle))) < slack
    assert abs(across - (y * math.cos(angle) - x * math.sin(angle))) < slack


@given(st.integers(-(2**44), 2**44), st.integers(-(2**44), 2**44))
def test_directions_are_the_nearest(x, y):
    turn = nearest_direction(x, y)
    assert turn == plain_direction(x, y)
    if max(abs(x), abs(y)) > 100:
        error = math.atan2(y, x) - 2 * math.pi * turn / DIRECTIONS
        error = (error + math.pi) % (2 * math.pi) - math.pi
        assert abs(error) <= math.pi / DIRECTIONS + 0.002


def test_the_null_vector_and_the_axes_have_directions():
    assert [nearest_direction(x, y) for x, y in [(0, 0), (5, 0), (0, 5), (-5, 0), (0, -5)]] == [
        0,
        0,
        64,
        128,
        192,
    ]


def cosine_and_sine(angle):
    """Taylor series at the current precision."""
    cosine, sine, term = Decimal(0), Decimal(0), Decimal(1)
    for n in range(1, 120):
        cosine += term if n % 4 == 1 else (-term if n % 4 == 3 else 0)
        sine += term if n % 4 == 2 else (-term if n % 4 == 0 else 0)
        term = term * angle / n
    return cosine, sine


def exact_tables():
    pi = Decimal("3.14159265358979323846264338327950288419716939937510582097494")
    step = 2 * pi / DIRECTIONS
    one = 1 << 14
    full = [cosine_and_sine(i * step) for i in range(DIRECTIONS)]
    small = [(i - DIRECTIONS // 8) * step for i in range(DIRECTIONS // 4 + 1)]
    halves = [cosine_and_sine(angle / 2) for angle in small]
    return {
        "COS": [one * c for c, _ in full],
        "SIN": [one * s for _, s in full],
        "SIN_SMALL": [one * cosine_and_sine(angle)[1] for angle in small],
        "TAN_HALF": [one * s / c for c, s in halves],
    }


@pytest.mark.parametrize("name", ["COS", "SIN", "SIN_SMALL", "TAN_HALF"])
def test_tables_are_the_same_with_any_library(name):
    with localcontext(prec=50):
        exact = exact_tables()[name]
        table = getattr(rotation_tables, name).tolist()
        assert table == [int(value.to_integral_value()) for value in exact]
        assert table == TURN_TABLES[f"_{name}"]
        # no entry lies where the last digits of a library's answer would decide
        assert min(abs(abs(value - round(value)) - Decimal("0.5")) for value in exact) > Decimal(
            "1e-8"
        )


def test_rotation_keeps_lengths():
    rng = np.random.default_rng(1)
    for x, y in rng.integers(-5000, 5000, (50, 2)).tolist():
        lengths = [math.hypot(*rotate(x, y, turn)) for turn in range(DIRECTIONS)]
        assert max(lengths) - min(lengths) < 4 + 4e-4 * math.hypot(x, y)
