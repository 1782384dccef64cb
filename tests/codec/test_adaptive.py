import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calling import from_python
from gpszip.codec.integer_contexts import INTEGER_CONTEXTS
from gpszip.codec.kernels import adaptive, log2
from gpszip.codec.kernels.adaptive import (
    CENTERS,
    KINDS,
    MIXTURE_ROWS,
    SCALES,
    code_bit,
    code_choice,
    code_mixture,
    code_signed,
    code_unsigned,
)
from gpszip.codec.kernels.log2 import fixed_log2
from gpszip.codec.kernels.range_coder import finish, new_decoder, new_encoder
from gpszip.kernels.jit import jit
from oracle import adaptive as plain
from oracle.range_coder import Decoder, Encoder
from random_tests import examples

# Inner kernels, as Python calls them.
fixed_log2 = from_python(fixed_log2)

PLAIN_KINDS = (plain.TWO_SIDED, plain.ONE_SIDED, plain.HISTOGRAM)
LARGEST = 2**47


@jit
def _code_bits(coder, counts, contexts, bits):
    for i in range(len(bits)):
        bits[i] = code_bit(coder, counts, contexts[i], bits[i])


@jit
def _code_unsigned(coder, counts, values):
    for i in range(len(values)):
        values[i] = code_unsigned(coder, counts, 0, values[i])


@jit
def _code_signed(coder, counts, values):
    for i in range(len(values)):
        values[i] = code_signed(coder, counts, INTEGER_CONTEXTS, values[i])


@jit
def _code_choices(coder, weights, choices):
    for i in range(len(choices)):
        choices[i] = code_choice(coder, weights[i], weights.shape[1], choices[i])


@jit
def _code_mixtures(coder, values, low, high, kinds, centers, scales, count, weights, histogram):
    mixture = np.zeros((MIXTURE_ROWS, count), np.int64)
    for i in range(len(values)):
        mixture[KINDS], mixture[CENTERS], mixture[SCALES] = kinds, centers[i], scales[i]
        values[i] = code_mixture(coder, values[i], low, high, mixture, count, weights, histogram)


def round_trip(code, values, *state):
    """Encode values with copies of the state, check that they are decoded, and return the bytes."""
    values = np.array(values, np.int64)
    coder, states = new_encoder(64 + 40 * len(values)), [np.array(s) for s in state]
    code(coder, *states, values.copy())
    data = finish(coder)
    back, again = np.zeros_like(values), [np.array(s) for s in state]
    code(new_decoder(data), *again, back)
    np.testing.assert_array_equal(back, values)
    for one, other in zip(states, again, strict=True):
        np.testing.assert_array_equal(one, other)
    return data


@given(
    st.lists(st.tuples(st.integers(0, 2), st.integers(0, 1)), max_size=300),
    st.integers(1, 3000),
    st.integers(1, 3000),
)
def test_bits_round_trip(pairs, zeros, ones):
    contexts, bits = np.array([c for c, _ in pairs], np.int64), [b for _, b in pairs]
    counts = np.full((3, 2), (zeros, ones), np.int32)
    data = round_trip(
        lambda coder, counts, bits: _code_bits(coder, counts, contexts, bits), bits, counts
    )
    models, coder = [plain.Bit(zeros, ones) for _ in range(3)], Decoder(data)
    assert [models[c].read(coder) for c, _ in pairs] == bits


def test_repeated_bits_become_cheap_and_others_stay_possible():
    bits = [1] * 20_000 + [0]
    data = round_trip(
        lambda coder, counts, bits: _code_bits(coder, counts, np.zeros(len(bits), np.int64), bits),
        bits,
        np.full((1, 2), 10, np.int32),
    )
    assert len(data) < 0.01 * 20_000 / 8 + 8


sizes = (
    st.integers(0, 20)
    | st.integers(0, LARGEST)
    | st.sampled_from([2**k + d for k in range(1, 48) for d in (-2, -1, 0)])
)


@given(st.lists(sizes, max_size=60))
def test_unsigned_integers_round_trip(values):
    data = round_trip(_code_unsigned, values, np.full((2 * INTEGER_CONTEXTS, 2), 10, np.int32))
    model, coder = plain.Unsigned(), Decoder(data)
    assert [model.read(coder) for _ in values] == values


@given(st.lists(st.integers(-20, 20) | st.integers(-(LARGEST // 2), LARGEST // 2 - 1), max_size=60))
def test_signed_integers_round_trip(values):
    data = round_trip(_code_signed, values, np.full((2 * INTEGER_CONTEXTS, 2), 10, np.int32))
    model, coder = plain.Signed(), Decoder(data)
    assert [model.read(coder) for _ in values] == values


@given(st.data(), st.integers(1, 12), st.integers(1, 30))
def test_choices_round_trip(data, count, rows):
    weight = st.integers(1, 50) | st.integers(1, 2**41 // 12)
    weights = np.array(
        data.draw(
            st.lists(st.lists(weight, min_size=count, max_size=count), min_size=rows, max_size=rows)
        ),
        np.int64,
    )
    choices = data.draw(st.lists(st.integers(0, count - 1), min_size=rows, max_size=rows))
    payload = round_trip(lambda coder, choices: _code_choices(coder, weights, choices), choices)
    coder = Decoder(payload)
    assert [plain.read_choice(coder, row) for row in weights.tolist()] == choices


@st.composite
def mixtures(draw):
    """Parameters far beyond what walks ask for: range, distributions, and values to code."""
    low = draw(st.sampled_from([1, 0, -(2**25), -3]))
    high = draw(st.sampled_from([low + 1, low + 2, low + 100, 2**25]))
    count = draw(st.integers(1, 28))
    rows = draw(st.integers(1, 12))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    kinds = rng.integers(0, 3 if draw(st.booleans()) else 2, count)
    reach = draw(st.sampled_from([2**8, 2**20, 2**30, 2**36]))
    centers = rng.integers(-reach, reach + 1, (rows, count))
    scales = np.maximum(np.exp2(rng.uniform(0, 36, (rows, count))).astype(np.int64), 6)
    values = draw(
        st.lists(
            st.sampled_from([low, high - 1, low + (high - low) // 2]) | st.integers(low, high - 1),
            min_size=rows,
            max_size=rows,
        )
    )
    return low, high, kinds, centers, scales, values


def new_state(weight=2340, bins=48):
    return np.append(np.full(28, weight), 0).astype(np.int64), np.full(bins, 2, np.int64)


@given(mixtures())
@examples(40)
def test_mixtures_of_extreme_parameters_round_trip_and_agree_with_plain_ones(case):
    low, high, kinds, centers, scales, values = case
    weights, histogram = new_state()

    def code(coder, weights, histogram, values):
        _code_mixtures(
            coder, values, low, high, kinds, centers, scales, len(kinds), weights, histogram
        )

    data = round_trip(code, values, weights, histogram)
    model, coder = plain.Mixture([2340] * 28), Decoder(data)
    names = [PLAIN_KINDS[kind] for kind in kinds]
    for c, s, value in zip(centers.tolist(), scales.tolist(), values, strict=True):
        assert model.read(coder, low, high, list(zip(names, c, s, strict=True))) == value
    code(new_encoder(10_000), weights, histogram, np.array(values))
    assert model.weights == weights[:-1].tolist()
    assert model.histogram == histogram.tolist()


@given(mixtures(), st.integers(0, 2**32))
@examples(80)
def test_every_value_of_a_mixture_has_an_interval_of_its_own(case, seed):
    low, high, kinds, centers, scales, values = case
    model = plain.Mixture([2340] * 28)
    model.weights = np.random.default_rng(seed).integers(16, 4000, 28).tolist()
    distributions = [
        (PLAIN_KINDS[k], c, s)
        for k, c, s in zip(kinds, centers[0].tolist(), scales[0].tolist(), strict=True)
    ]
    near = [v for value in values for v in range(value - 3, value + 4)] + [
        c // 16 + d for c in centers[0].tolist() for d in (-1, 0, 1)
    ]
    for value in near:
        if low <= value < high:
            assert model.cumulative(value + 1, low, high, distributions) > model.cumulative(
                value, low, high, distributions
            )
    assert model.cumulative(low, low, high, distributions) >= 0
    assert (
        model.cumulative(high, low, high, distributions)
        == (sum(model.weights[: len(kinds)]) << plain.PROBABILITY_BITS) + high - low
    )


def test_a_mixture_learns_which_distribution_is_right():
    rng = np.random.default_rng(5)
    values = np.clip(np.round(rng.logistic(300, 4, 3000)), 1, 999).astype(np.int64)
    centers = np.tile(np.array([100, 300, 900]) * 16, (len(values), 1))
    weights, histogram = new_state()

    def code(coder, weights, histogram, values):
        _code_mixtures(
            coder,
            values,
            1,
            1000,
            np.zeros(3, np.int64),
            centers,
            np.full_like(centers, 64),
            3,
            weights,
            histogram,
        )

    data = round_trip(code, values, weights, histogram)
    chance = 1 / (1 + np.exp(-(np.arange(1000) + 0.5 - 300) / 4))
    entropy = -np.log2(np.diff(chance)[values - 1]).sum() / 8
    assert len(data) < 1.01 * entropy + 8


def test_weights_stay_bounded_while_one_distribution_is_always_right():
    values = np.full(30_000, 7)
    centers = np.tile(16 * (7 + 50 * np.arange(28)), (len(values), 1))
    weights, histogram = new_state()
    _code_mixtures(
        new_encoder(10_000),
        values,
        1,
        2**25,
        np.zeros(28, np.int64),
        centers,
        np.full_like(centers, 6),
        28,
        weights,
        histogram,
    )
    # with a span of 2**26 the total is at most 2**41
    assert weights[:-1].sum() <= 2**17 - 4
    assert weights[:-1].min() >= 16


@pytest.mark.parametrize(
    ("table", "exact"),
    [(adaptive._LOGISTIC, plain.exact_logistic), (adaptive._EXPONENTIAL, plain.exact_exponential)],
)
def test_tables_are_the_same_with_any_library(table, exact):
    values = exact()
    assert len(values) == len(table)
    for entry, value in zip(table[1:-1].tolist(), values[1:-1], strict=True):
        assert entry == int(value.to_integral_value())
        # a library would have to err by 1e-6 of 2**24, a hundred units in the last place, to differ
        assert abs(abs(value - entry) - Decimal("0.5")) > Decimal("1e-6")
    assert (table[0], table[-1]) == (0, 2**24)
    assert (np.diff(table) >= 0).all()


def test_the_plain_mixture_writes_the_same_bytes():
    rng = np.random.default_rng(8)
    kinds, centers, scales = np.array([2, 0, 1, 0]), np.full((200, 4), 90), np.full((200, 4), 40)
    values = rng.geometric(0.2, 200)
    weights, histogram = new_state()
    coder = new_encoder(2000)
    _code_mixtures(coder, values, 1, 2**25, kinds, centers, scales, 4, weights, histogram)
    twin, model = Encoder(), plain.Mixture([2340] * 28)
    for value in values.tolist():
        model.code(twin, value, 1, 2**25, [(PLAIN_KINDS[k], 90, 40) for k in kinds])
    assert finish(coder) == twin.finish()


@given(
    st.lists(st.integers(1, 2**25 - 1), min_size=1, max_size=12),
    st.lists(
        st.tuples(st.integers(-(2**21), 2**22), st.sampled_from([1, 3, 12, 48])),
        min_size=1,
        max_size=25,
    ),
)
def test_distributions_by_ratio_agree_with_plain_ones(values, pairs):
    weights, histogram = new_state()
    shape = (len(values), len(pairs))
    kinds = np.full(len(pairs), adaptive.BY_RATIO)
    centers = np.broadcast_to([c for c, _ in pairs], shape).copy()
    scales = np.broadcast_to([s for _, s in pairs], shape).copy()

    def code(coder, weights, histogram, values):
        _code_mixtures(
            coder, values, 1, 2**25, kinds, centers, scales, len(kinds), weights, histogram
        )

    data = round_trip(code, values, weights, histogram)
    model, coder = plain.Mixture([2340] * 28), Decoder(data)
    assert [
        model.read(coder, 1, 2**25, [(plain.BY_RATIO, *pair) for pair in pairs]) for _ in values
    ] == values


@given(st.integers(1, 2**62 - 1))
def test_logarithms_agree_with_plain_ones_and_never_fall(value):
    here, above = fixed_log2(value), fixed_log2(value + 1)
    assert here == plain.log2_of(value)
    assert here <= above
    # half a unit is the table rounded, one the line between its entries rounded down
    assert abs(here - 65536 * math.log2(value)) < 1.6


@pytest.mark.parametrize("power", range(62))
def test_logarithms_of_powers_are_exact(power):
    assert fixed_log2(2**power) == power << 16


def test_logarithms_are_the_same_with_any_library():
    for entry, value in zip(log2._FRACTIONS.tolist(), plain.exact_fractions(), strict=True):
        assert entry == int(value.to_integral_value())
        assert abs(abs(value - entry) - Decimal("0.5")) > Decimal("1e-9")
