"""Tables and distributions of the plain decoder are those of 50-digit arithmetic."""

from hypothesis import given
from hypothesis import strategies as st

from gpszip.codec.plain import distributions, log2
from gpszip.codec.plain.distributions import Durations, Offsets
from gpszip.codec.plain.mixture import Mixture, read_mixture
from gpszip.codec.plain.range_decoder import RangeDecoder
from gpszip.codec.plain.rotation import nearest_direction, rotate_back
from gpszip.codec.plain.work import WorkLimit
from oracle import adaptive as oracle
from oracle.range_coder import Encoder
from oracle.walk_decoder import plain_direction, plain_rotate_back

far = st.integers(-100, 100) | st.integers(-(2**46), 2**46)
OCTAVES = (0, 1, 2, 3, 4, 6, 8, 10, 12)


def test_tables_are_exact():
    logistic, exponential = oracle.tables()
    assert logistic == distributions._LOGISTIC
    assert exponential == distributions._EXPONENTIAL
    assert oracle.fractions() == log2._FRACTIONS


@given(st.integers(1, 2**62))
def test_logarithms_agree(value):
    assert log2.fixed_log2(value) == oracle.log2_of(value)


@given(far, far, st.integers(0, 255))
def test_rotations_and_directions_agree(x, y, turn):
    assert rotate_back(x, y, turn) == plain_rotate_back(x, y, turn)
    assert nearest_direction(x, y) == plain_direction(x, y)


def write_all(values, low, pairs, bins):
    """Bytes of the values, coded by the twin with ever the same distributions."""
    encoder, model = Encoder(), oracle.Mixture([2340] * 28, bins)
    for value in values:
        model.code(encoder, value, low, 2**25, pairs)
    return encoder.finish(), model


def read_all(data, count, low, new, bins):
    """The values again, and the mixture after them."""
    decoder, mixture = RangeDecoder(data), Mixture([2340] * 28, bins)
    values = [
        read_mixture(decoder, mixture, low, 2**25, new(mixture), WorkLimit(10**6))
        for _ in range(count)
    ]
    return values, mixture


@given(
    st.lists(st.integers(-(2**25), 2**25 - 1) | st.integers(-40, 40), min_size=1, max_size=6),
    st.lists(st.tuples(st.integers(-(2**36), 2**36), st.integers(6, 2**36)), min_size=1),
)
def test_offsets_agree(values, pairs):
    pairs = pairs[:28]
    data, model = write_all(values, -(2**25), [(oracle.TWO_SIDED, *pair) for pair in pairs], 0)
    found, mixture = read_all(data, len(values), -(2**25), lambda _: Offsets(pairs, -(2**25)), 0)
    assert (found, mixture.weights) == (values, model.weights)


@given(
    st.lists(st.integers(1, 2**25 - 1) | st.integers(1, 60), min_size=1, max_size=6),
    st.lists(st.tuples(st.integers(-(2**21), 2**22), st.sampled_from([1, 3, 12, 48])), max_size=15),
)
def test_durations_agree(values, guesses):
    kinds = [(oracle.HISTOGRAM, 0, 16), *((oracle.ONE_SIDED, 0, 16 << o) for o in OCTAVES)]
    kinds += [(oracle.BY_RATIO, *pair) for pair in guesses]
    data, model = write_all(values, 1, kinds, 48)
    found, mixture = read_all(
        data, len(values), 1, lambda mixture: Durations(mixture.histogram, guesses, 1), 48
    )
    assert (found, mixture.weights) == (values, model.weights)
    assert mixture.histogram == model.histogram
