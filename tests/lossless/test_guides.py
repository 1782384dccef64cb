"""Tables of which walks predict the numbers."""

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpszip.container.layout import Cursor
from gpszip.errors import CorruptArchiveError
from gpszip.lossless import guides, write_logs
from gpszip.lossless.columns import MAX_VALUE, _choose, _encode_with
from gpszip.lossless.grids import Grid
from gpszip.lossless.guide_search import GuideFinder
from gpszip.lossless.guides import (
    NAME_ROLE,
    Knots,
    Role,
    TableGuide,
    decode_guide,
    encode_guide,
)
from gpszip.lossless.logs import read_exact_logs, write_exact_logs
from gpszip.lossless.setting import EXACT, FEW, MANY, NEAR, Guide
from gpszip.lossless.tables import decode_table, encode_table
from gpszip.lossless.text import decode_block, encode_block
from gpszip.lossless.trails import NO_TRAILS, Trail
from oracle import exact_logs
from oracle.lossless import ColumnDecoder, KnotsGuide, RowsGuide
from random_tests import examples


class Trails:
    """Walks of three vehicles on a grid of streets: a knot each half minute, a stop and a gap."""

    names = ("bus-12, line 3", "tram_7", "bus-13, line 3")
    axes = 2
    time_step = 2.0

    def trail(self, number):
        random = np.random.default_rng(number)
        times = 1000.0 * number + np.cumsum(random.integers(20, 40, 12))
        steps = random.choice([-200.0, 0.0, 200.0], (12, 2))
        steps[5] = 0
        is_gap = np.arange(12) == 8
        is_end = np.isin(np.arange(12), [0, 7, 8, 11])
        is_stay = np.arange(12) == 5
        return Trail(times, np.cumsum(steps, axis=0), is_end, is_stay, is_gap)


TRAILS = Trails()


def drive(number, seed=0, noise=3.0):
    """Seconds and metres of samples about a walk, one each ten seconds."""
    random = np.random.default_rng(seed + 10 * number)
    trail = TRAILS.trail(number)
    times = np.arange(trail.times[0], trail.times[-1] + 1, 10)
    times[1:-1] += random.integers(-2, 3, len(times) - 2)
    walk = np.stack([np.interp(times, trail.times, x) for x in trail.positions.T], axis=1)
    return times, walk + random.normal(0, noise, walk.shape)


def log(line="{id},{t:.0f},{x:.2f},{y:.2f}\n", numbers=(0, 1, 2), zone=0):
    """Text of samples of some vehicles, one after the other."""
    return "".join(
        line.format(id=TRAILS.names[number], t=t + zone, x=x, y=y, ms=1000 * t, cm=100 * x)
        for number in numbers
        for t, (x, y) in zip(*drive(number), strict=True)
    ).encode()


def body_of(data, trails):
    sink = io.BytesIO()
    write_exact_logs([("a.csv", lambda: [data])], sink, trails)
    return sink.getvalue()


def found_in(data):
    """Guides that are found in text."""
    found = []

    class Finder(GuideFinder):
        def find(self, *args):
            found.append(super().find(*args))
            return found[-1]

    encode_block(data, Finder(TRAILS))
    return [each.guide for each in found if each is not None]


@pytest.mark.parametrize(
    "line",
    [
        "{id},{t:.0f},{x:.2f},{y:.2f}\n",
        "{y:.3f};{ms:.0f};{x:.1f};0\r\n",
        '{{"t": {t:.1f}, "at": [{x:.2f}, {y:.2f}]}}\n',
    ],
)
def test_logs_about_walks_come_back_in_fewer_bytes(line):
    data = log(line)
    body = body_of(data, TRAILS)
    found = read_exact_logs(body, TRAILS)
    assert found.is_guided
    assert b"".join(found.read(0)) == data
    assert exact_logs.read_logs(body, TRAILS) == {"a.csv": data}
    assert len(body) < 0.9 * len(body_of(data, NO_TRAILS))


def test_the_roles_of_columns_are_found():
    (guide,) = found_in(log("{id},{t:.0f},{x:.2f},{y:.3f},{cm:.0f},7\n", (0, 2)))
    assert guide.tracks.tolist() == [1, 3]
    assert guide.roles == (
        Role(NAME_ROLE, 0),
        Role(NAME_ROLE, 1),
        Role(),
        Role(1, 2),
        Role(2, 3),
        Role(1, 2),
        Role(),
    )


def test_rows_without_a_walk_are_runs_of_their_own():
    before = b"".join(b"tram_7,%d,1.00,2.00\n" % t for t in range(1000, 1010))
    (guide,) = found_in(before + log(numbers=(1,)) + b"tram_7,1990,5.00,5.00\n")
    assert guide.tracks.tolist() == [0, 2, 0]
    assert guide.rows.tolist() == [10, len(drive(1)[0]), 1]


@pytest.mark.parametrize("zone", [7200, -12600])
def test_clocks_in_other_zones_are_found(zone):
    (guide,) = found_in(log(numbers=(0, 2), zone=zone))
    assert (guide.exponent, guide.zone) == (0, zone)


def test_a_log_about_other_times_has_no_guide():
    assert found_in(log(zone=10**6)) == []
    data = body_of(log(zone=10**6), TRAILS)
    assert not read_exact_logs(data, TRAILS).is_guided
    assert data == body_of(log(zone=10**6), NO_TRAILS)


def test_a_track_goes_on_in_the_next_block(monkeypatch):
    data = log()
    monkeypatch.setattr(write_logs, "MAX_BLOCK_BYTES", len(data) // 2)
    found = read_exact_logs(body_of(data, TRAILS), TRAILS)
    blocks = [block for span in found.spans for block in span.blocks]
    assert len(blocks) > 2
    assert b"".join(found.read(0)) == data
    # Each block but the last is one about a walk.
    guides = sum(
        len(found_in_block(found, block)) for block in blocks if block.size > len(data) // 4
    )
    assert guides == 4


def found_in_block(found, block):
    """Guides of a block of a log, in the order of its tables."""
    guides = []
    from gpszip.lossless import tables

    original = tables.decode_guide
    tables.decode_guide = lambda *args: guides.append(original(*args)) or guides[-1]
    try:
        found._decode(block)
    finally:
        tables.decode_guide = original
    return [guide for guide in guides if guide is not None]


@given(
    st.lists(st.tuples(st.integers(-99, 4000), *[st.integers(-(10**6), 10**6)] * 2), min_size=2),
    st.integers(0, 5),
)
@examples(60)
def test_any_table_comes_back(rows, seed):
    random = np.random.default_rng(seed)
    # Rows of walks among any others.
    times, positions = drive(int(random.integers(3)), seed)
    near = np.column_stack([times, np.round(100 * positions)]).astype(np.int64)
    table = np.concatenate([near[: seed * 8], np.array(rows, np.int64), near[seed * 8 :]])
    columns = [np.ascontiguousarray(column) for column in table.T]
    data = encode_table(columns, [0, 2, 2], GuideFinder(TRAILS))
    cursor = Cursor(data)
    back = decode_table(cursor, len(table), 3, TRAILS)
    cursor.expect_end("the table")
    assert all(np.array_equal(a, b) for a, b in zip(columns, back, strict=True))


@pytest.mark.parametrize("order", [NEAR, EXACT])
@pytest.mark.parametrize("unit", [1, 10**3, 10**11])
def test_the_plain_decoder_reads_columns_with_guides(order, unit):
    random = np.random.default_rng(order)
    values = np.cumsum(random.integers(-9, 30, 300)) * unit + random.integers(0, unit, 300)
    numbers = 16 * values + np.round(random.normal(0, 40 * unit, 300)).astype(np.int64)
    classes = random.integers(0, 6, 300).astype(np.uint8)
    empty = np.zeros(0, np.int64)
    guide = Guide(numbers, classes, empty, empty, 0)
    setting = _choose(values, order)._replace(contexts=MANY if unit == 1000 else FEW)
    payload, sizes = _encode_with(setting, values, None, [], guide)
    plain = RowsGuide(numbers.tolist(), classes.tolist())
    decoder = ColumnDecoder(payload, setting, [], [], [], [], plain)
    assert decoder.decode(int(values[0]), 300) == (values.tolist(), sizes.tolist())


@pytest.mark.parametrize("order", [NEAR, EXACT])
def test_the_plain_decoder_reads_times_with_guides(order):
    random = np.random.default_rng(5)
    times = np.cumsum(random.integers(1, 60, 300))
    times[150:] -= 2000
    knots = [
        16 * np.sort(random.choice(part, 60, replace=False)) + random.integers(-30, 30, 60)
        for part in (times[:150], times[150:])
    ]
    classes = random.integers(0, 5, 120).astype(np.uint8)
    bounds = np.array([0, 60, 120])
    guide = Guide(np.concatenate(knots), classes, np.array([0, 150, 300]), bounds, 40)
    setting = _choose(times, order)
    payload, _ = _encode_with(setting, times, None, [], guide)
    runs = [
        (first, list(zip(part.tolist(), kinds.tolist(), strict=True)))
        for first, part, kinds in zip((0, 150), knots, (classes[:60], classes[60:]), strict=True)
    ]
    decoder = ColumnDecoder(payload, setting, [], [], [], [], KnotsGuide(runs, 40))
    assert decoder.decode(int(times[0]), 300)[0] == times.tolist()


def test_numbers_at_the_limits_come_back_with_guides():
    limit = MAX_VALUE - 1
    columns = [np.arange(400) * 5 + 20, np.where(np.arange(400) % 3, limit, -limit)]
    data = encode_table(columns, [0, 2], GuideFinder(TRAILS))
    assert np.array_equal(decode_table(Cursor(data), 400, 2, TRAILS)[1], columns[1])

    # A guide far from all numbers, and one beyond what is representable.
    for far in (1e300, -1e300, np.nan):
        trail = Trail(np.array([0.0, 2e3]), np.full((2, 2), far), *[np.zeros(2, bool)] * 3)
        trails = type("Far", (Trails,), {"trail": lambda self, number, trail=trail: trail})()
        guide = TableGuide(np.array([1]), np.array([400]), 0, 0, 3, (Role(), Role(1, 18)))
        knots = Knots(guide, trails, Grid())
        of_axis = knots.positions_guide(guide.roles[1], Grid(), knots.locate(columns[0]))
        setting = _choose(columns[1], NEAR)
        payload, _ = _encode_with(setting, columns[1], None, [], of_axis)
        plain = RowsGuide(of_axis.values.tolist(), of_axis.classes.tolist())
        decoder = ColumnDecoder(payload, setting, [], [], [], [], plain)
        assert decoder.decode(int(columns[1][0]), 400)[0] == columns[1].tolist()


def test_guides_come_back():
    (guide,) = found_in(log(numbers=(0, 2)))
    cursor = Cursor(encode_guide(guide))
    back = decode_guide(cursor, int(guide.rows.sum()), len(guide.roles), TRAILS)
    cursor.expect_end("the guide")
    assert back is not None
    assert np.array_equal(back.tracks, guide.tracks)
    assert np.array_equal(back.rows, guide.rows)
    assert (back.exponent, back.zone, back.slack, back.roles) == (
        guide.exponent,
        guide.zone,
        guide.slack,
        guide.roles,
    )


#: Roles of two columns.
ROLES = (Role(), Role(1, 2))


def forged(tracks=(1, 0), rows=(4, 6), exponent=0, zone=0, slack=0, roles=ROLES):
    tracks, rows = np.array(tracks, np.int64), np.array(rows, np.int64)
    return encode_guide(TableGuide(tracks, rows, exponent, zone, slack, roles))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (forged(tracks=range(3), rows=[3, 3, 4]), "3 runs of 10 rows"),
        (forged(tracks=(4, 0)), "a run is on none of 3 tracks"),
        (forged(tracks=(-1, 0)), "a run is on none of 3 tracks"),
        (forged(rows=(4, 5)), "the runs do not have 10 rows"),
        (forged(rows=(-4, 14)), "the runs do not have 10 rows"),
        (forged(exponent=19), "times of a guide are out of range"),
        (forged(slack=1 << 61), "times of a guide are out of range"),
        (forged(roles=(Role(), Role(3, 2))), "no column has role 3, 2"),
        (forged(roles=(Role(), Role(1, 19))), "no column has role 1, 19"),
        (forged()[:-1], "the detail of a role takes 1 bytes"),
    ],
)
def test_forged_guides_are_refused(data, message):
    with pytest.raises(CorruptArchiveError, match=message):
        decode_guide(Cursor(data), 10, 2, TRAILS)
    assert decode_guide(Cursor(forged()), 10, 2, TRAILS) is not None


def test_a_guide_has_a_bounded_number_of_knots(monkeypatch):
    data = log(numbers=(0, 2))
    block = encode_block(data, GuideFinder(TRAILS))
    monkeypatch.setattr(guides, "_FREE_KNOTS", 0)
    monkeypatch.setattr(guides, "_KNOTS_PER_ROW", 0)
    with pytest.raises(CorruptArchiveError, match="too many knots"):
        decode_block(Cursor(block), len(data), TRAILS)
    assert found_in(data) == []


def test_times_in_steps_far_finer_than_those_of_walks_have_no_guide():
    class Slow(Trails):
        time_step = 1e4

    rows = np.sort(np.random.default_rng(1).random(60)) + 30
    data = "".join(f"{t:.15f},{i % 7},{i % 5}\n" for i, t in enumerate(rows)).encode()
    found = read_exact_logs(body_of(data, Slow()), Slow())
    assert b"".join(found.read(0)) == data
    assert not found.is_guided


def test_a_guide_never_has_more_than_8_million_knots():
    rows = 1 << 22
    trail = len(TRAILS.trail(0).times)
    runs = guides._MAX_KNOTS // trail
    assert not guides.has_too_many_knots(np.ones(runs, np.int64), rows, TRAILS)
    assert guides.has_too_many_knots(np.ones(runs + 1, np.int64), rows, TRAILS)


def test_a_block_with_guides_needs_the_walks():
    data = log()
    block = encode_block(data, GuideFinder(TRAILS))
    assert decode_block(Cursor(block), len(data), TRAILS) == data
    for trails in (None, NO_TRAILS):
        with pytest.raises(CorruptArchiveError):
            decode_block(Cursor(block), len(data), trails)
