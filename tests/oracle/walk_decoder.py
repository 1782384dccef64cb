"""A plain decoder of walks payloads, written from docs/format.md, "Walks payload": Python's integers, one number at a time."""

from __future__ import annotations

import heapq
import math
from fractions import Fraction

from oracle.adaptive import (
    BY_RATIO,
    HISTOGRAM,
    ONE_SIDED,
    TWO_SIDED,
    Bit,
    Mixture,
    Size,
    Whole,
    log2_of,
    read_choice,
)
from oracle.range_coder import Reader

# Constants of docs/format.md. A change of the coder's must be mirrored here and there.
BACK, KNOWN, LINK, NEW, STAY = range(5)
EVEN = (10, 10)
FIRST_END, FIRST_GAP, FIRST_KNOWN_START, FIRST_NEAR = (36, 4), (36, 4), (12, 28), (8, 32)
FIRST_STAY, FIRST_BACK_AFTER_OTHERS = (28, 12), (36, 4)
FIRST_ESCAPE_BY_LEVEL = {3: (28, 12), 4: (34, 8)}  # after back, known or link
FIRST_ESCAPE_FRESH = {(1, 0): (3, 37), (1, 1): (3, 37)}  # (degree, level) after new or stay
SPAN_SCALES = [16 << s for s in (0, 1, 2, 3, 4, 6, 8, 10, 12)]
AXIS_SCALES = [16 << s for s in (0, 2, 3, 4, 5, 6, 7, 9, 11, 13, 15, 17)]
NEAR_END = 1 << 25
TERMINAL = 24
FIRST_WEIGHTS = {  # of 1024
    "move": (
        26,
        3,
        3,
        13,
        30,
        53,
        6,
        14,
        3,
        3,
        151,
        230,
        73,
        17,
        11,
        6,
        68,
        45,
        14,
        35,
        8,
        115,
        66,
        16,
        9,
    ),
    "stay": (54, 4, 20, 153, 214, 122, 120, 34, 4, 4, 8, 179, 108),
    "gap": (40, 5, 5, 6, 20, 16, 90, 90, 232, 89, 125, 193, 113),
    "ahead": (259, 8, 34, 11, 53, 46, 7, 6, 5, 5, 7, 18, 215, 205, 22, 7, 11, 28, 52, 27),
    "paced along": (
        20,
        57,
        48,
        75,
        5,
        5,
        36,
        265,
        40,
        66,
        16,
        25,
        13,
        236,
        49,
        22,
        9,
        6,
        5,
        4,
        4,
        4,
        4,
        4,
        4,
    ),
    "paced across": (
        75,
        15,
        11,
        16,
        10,
        265,
        51,
        176,
        69,
        5,
        13,
        38,
        205,
        18,
        18,
        6,
        5,
        5,
        5,
        5,
        5,
        5,
        5,
    ),
    "along": (257, 4, 3, 3, 203, 23, 10, 40, 63, 158, 126, 68, 31, 13, 5, 4, 4, 3, 3, 3),
    "across": (123, 15, 13, 16, 8, 6, 45, 6, 20, 38, 5, 11, 78, 478, 131, 8, 5, 4, 4, 3, 3, 2, 2),
    "beside": (36,) * 18,
    "jump": (41, 166, 116, 100, 117, 190, 142, 30, 62, 25, 20, 15),
}
RECENT, FEW, CHEAP_WAYS = 4096, 64, 1 << 14
LIKELY_DISTANCE = (160, 128, 128, 112, 112, 96, 80, 64, 48, 48, 1, 1, 1)
LIKELY_BEARING = (5, 4, 4, 4, 2, 1, 2, 4)
LIKELY_BEYOND = (128, 128, 128, 128, 128, 128, 128, 96, 64, 48, 40, 24, 24)
LIKELY_AGAIN = (1, 4, 8, 16)
LIKELY_RANK = (1, 4, 16, 48, 96, 128, 128, 96, 64, 1, 1, 1, 1)
LIKELY_END = (2, 4, 6, 8, 8, 8, 8, 8)
SORTED, PACED, AIMS = 1, 2, 4
MOST_SORTED = 4096
BREADTH, FEW_SETTLED, MOST_OFFERS = 256, 16, 4096
FIRST_AIM = (36, 4)
FIRST_OFFERS, HIT_STEP = 10, 128
FIRST_TURN, TURN_STEP = 5 << 16, 1 << 16
CLASSES, CLASS_SHARES = 48, {-2: 1, -1: 5, 0: 33, 1: 5, 2: 1}
MOST_OF_CLASS, MOST_OF_WAY, MOST_RESTS = 20, 12, 20
LARGEST_SUM = 1 << 40
COSINES = (0.97, 0.75, 0.25, -0.25, -0.75, -0.97)
FARTHEST, LATEST = 1 << 45, 1 << 60


def _turn_tables():
    """16384 times cosine and sine of every 256th of a turn, sine and tangent of the half of those within an eighth."""
    step = 2 * math.pi / 256
    small = [(i - 32) * step for i in range(65)]
    return {
        "_COS": [round(16384 * math.cos(i * step)) for i in range(256)],
        "_SIN": [round(16384 * math.sin(i * step)) for i in range(256)],
        "_SIN_SMALL": [round(16384 * math.sin(a)) for a in small],
        "_TAN_HALF": [round(16384 * math.tan(a / 2)) for a in small],
    }


TURN_TABLES = _turn_tables()


TANGENTS = [round(16384 * math.tan(i * 2 * math.pi / 256)) for i in range(50)]


def moved(mean, times, most, value):
    """A mean after one more value, and of how many it then is."""
    times = min(times + 1, most)
    return mean + (value - mean) // times, times


class BadWalks(Exception):
    """The payload is no walks."""


def plain_direction(x, y):
    along = [x * c + y * s for c, s in zip(TURN_TABLES["_COS"], TURN_TABLES["_SIN"], strict=True)]
    return along.index(max(along)) if max(along) > 0 else 0


def plain_rotate_back(x, y, turn):
    quarters = (turn + 32) // 64
    small = turn - 64 * quarters + 32
    t, s = -TURN_TABLES["_TAN_HALF"][small], -TURN_TABLES["_SIN_SMALL"][small]
    x += (t * y + 8192) >> 14
    y -= (s * x + 8192) >> 14
    x += (t * y + 8192) >> 14
    for _ in range(quarters % 4):
        x, y = -y, x
    return x, y


class Way:
    """One direction of an edge."""

    def __init__(self, start, end):
        self.start, self.end = start, end
        self.taken = self.passed = self.usual = 0
        self.then = {}  # how often each way was taken right after this one
        self.opposite = None


class Decoder:
    def __init__(self, payload, dimension, timed, gapped, modes=0):
        self.coder = Reader(payload)
        self.modes, self.trail = modes, []  # the nodes still ahead on the way to the one aimed at
        self.speed = None  # length and cells of the last step
        self.sums = (0, 0)  # fading sums of both
        self.last_new = None  # logarithm of the span of the last new way coded ahead
        self.dimension, self.timed, self.gapped = dimension, timed, gapped
        self.bits, self.wholes, self.mixtures = {}, {}, {}
        self.places, self.ends, self.ways = (
            [],
            [],
            [],
        )  # of each node: place, weight as an end, ways (newest first)
        self.pace = self.slow_pace = None
        self.step_length = 0
        self.heading = self.turn = None
        self.rests = []  # of each node: how often gaps began or ended there
        self.cheap = 0  # how many more links were cheap than not
        self.usual = {}  # mean logarithm of cells by class of length, of stops and of gaps, and of how many
        self.offers = {
            layer: [[FIRST_OFFERS] * 8 for _ in LIKELY_DISTANCE] for layer in ("link", "gap", "aim")
        }
        self.hits = {
            "link": [[d * b for b in LIKELY_BEARING] for d in LIKELY_DISTANCE],
            "gap": [[d * a for a in LIKELY_AGAIN] for d in LIKELY_BEYOND],
            "aim": [[r * e for e in LIKELY_END] for r in LIKELY_RANK],
        }
        self.turns_had, self.turns_taken = [FIRST_TURN] * 8, [FIRST_TURN] * 8

    # numbers

    def bit(self, key, first=EVEN):
        return self.bits.setdefault(key, Bit(*first)).read(self.coder)

    def whole(self, key):
        return self.wholes.setdefault(key, Whole()).read(self.coder)

    def count(self, key):
        return self.wholes.setdefault(key, Size()).read(self.coder)

    def mixture(self, key, low, high, distributions):
        first = FIRST_WEIGHTS[key if isinstance(key, str) else key[0]]
        assert len(distributions) <= len(first)
        model = self.mixtures.setdefault(key, Mixture([64 * share for share in first]))
        clamped = [
            (kind, c, scale if kind == BY_RATIO else min(max(scale, 6), 1 << 36))
            for kind, c, scale in distributions
        ]
        return model.read(self.coder, low, high, clamped)

    def rest(self, key):
        """Span of a stop or gap."""
        mean, times = self.usual.get(key, (0, 0))
        cells = self.span(key, [mean] if times else [], (1, 2, 4))
        self.usual[key] = moved(mean, times, MOST_RESTS, log2_of(min(max(cells, 1), 1 << 36)))
        return cells

    def span(self, key, guesses, steep):
        distributions = [(HISTOGRAM, 0, 16)] + [(ONE_SIDED, 0, scale) for scale in SPAN_SCALES]
        distributions += [(BY_RATIO, guess, steepness) for guess in guesses for steepness in steep]
        cells = self.mixture(key, 1, NEAR_END, distributions)
        return cells + self.whole("far span") if cells == NEAR_END - 1 else cells

    def offset(self, key, special=()):
        distributions = [*special, *((TWO_SIDED, 0, scale) for scale in AXIS_SCALES)]
        value = self.mixture(key, -NEAR_END, NEAR_END, distributions)
        return self.whole("far offset") if value == NEAR_END - 1 else value

    # the map so far

    def length(self, u, v):
        steps = [
            min(abs(a - b), 1 << 29) for a, b in zip(self.places[u], self.places[v], strict=True)
        ]
        return int(16 * math.sqrt(float(sum(step * step for step in steps))))

    def way(self, u, v):
        return next((way for way in self.ways[u] if way.end == v), None)

    def add_node(self, place):
        self.places.append(place)
        self.ends.append(1)
        self.rests.append(0)
        self.ways.append([])
        return len(self.places) - 1

    def learn(self, arrived, u, v, span):
        """A step from u to v after the way ``arrived``; return the way taken."""
        far = self.length(u, v)
        way = self.way(u, v)
        if way is None:
            way, back = Way(u, v), Way(v, u)
            way.opposite, back.opposite = back, way
            self.ways[u].insert(0, way)
            self.ways[v].insert(0, back)
        way.taken += 1
        if arrived is not None:
            arrived.then[way] = arrived.then.get(way, 0) + 1
            arrived.passed += 1
        if self.timed:
            self.learn_span(way, far, log2_of(min(max(span, 1), 1 << 36)), span)
        if self.dimension > 1:
            heading = plain_direction(
                *(b - a for a, b in zip(self.places[u][:2], self.places[v][:2], strict=True))
            )
            self.turn = None if self.heading is None else (heading - self.heading + 128) % 256 - 128
            self.heading = heading
        self.step_length = (
            far if self.step_length == 0 else self.step_length + (far - self.step_length) // 8
        )
        return way

    def learn_span(self, way, far, span, cells):
        row = self.length_class(far)
        self.usual[row] = moved(*self.usual.get(row, (0, 0)), MOST_OF_CLASS, span)
        way.usual += (span - way.usual) // min(way.taken, MOST_OF_WAY)
        if far > 0:
            self.pace = span - log2_of(far)
            self.learn_speed(min(far, 1 << 34), min(cells, 1 << 25))
            self.slow_pace = (
                self.pace
                if self.slow_pace is None
                else self.slow_pace + 5 * (self.pace - self.slow_pace) // 32
            )

    def learn_speed(self, far, cells):
        self.speed = far, cells
        self.sums = tuple(
            total + new - (total >> 3) for total, new in zip(self.sums, self.speed, strict=True)
        )

    def length_class(self, far):
        return 0 if far < 16 else min(1 + ((log2_of(far) - (4 << 16)) >> 15), CLASSES - 1)

    # one part

    def kind(self, u, arrived, last):
        ways = self.ways[u]
        degree, visits = min(len(ways), 5), sum(way.taken for way in ways)
        level = min(visits.bit_length(), 4)
        fresh = last in (NEW, STAY)
        if ways:
            first = (
                FIRST_ESCAPE_FRESH.get((degree, level), EVEN)
                if fresh
                else FIRST_ESCAPE_BY_LEVEL.get(level, EVEN)
            )
            if not self.bit(("escape", degree, level, fresh), first):
                if arrived is None:
                    return KNOWN
                if degree == 1:
                    return BACK
                back = arrived.opposite
                seen = 2 if arrived.then.get(back, 0) else int(back.taken > 0)
                first = EVEN if last == BACK else FIRST_BACK_AFTER_OTHERS
                return (
                    BACK if self.bit(("back", min(degree, 4), seen, last == BACK), first) else KNOWN
                )
        if self.bit(("stay", last), FIRST_STAY):
            return STAY
        if len(self.places) < 2:
            return NEW
        return NEW if self.bit(("new", min(degree, 3), last)) else LINK

    def known_way(self, u, before, arrived):
        back = arrived.opposite if arrived else None
        ways = [way for way in self.ways[u] if way is not back]
        if len(ways) == 1:
            return ways[0]
        turns = [self.bearing(before, u, way.end) for way in ways]
        ratios = [
            min(max((self.turns_taken[t] << 8) // self.turns_had[t], 16), 4096) for t in turns
        ]
        weights = [
            (3 * way.taken + way.opposite.taken + 1) * ratio
            for way, ratio in zip(ways, ratios, strict=True)
        ]
        single = sum(weights)
        if arrived and arrived.passed:
            weights = [
                w + min(arrived.then.get(way, 0), 1 << 16) * single // 2
                for w, way in zip(weights, ways, strict=True)
            ]
        while sum(weights) > LARGEST_SUM:
            weights = [(w >> 1) + 1 for w in weights]
        choice = read_choice(self.coder, weights)
        for turn, weight in zip(turns, weights, strict=True):
            self.turns_had[turn] += (weight << 16) // sum(weights)
        self.turns_taken[turns[choice]] += TURN_STEP
        return ways[choice]

    def guesses(self, u, v, way):
        far = self.length(u, v)
        row = self.length_class(far)
        near = [
            (share * times, mean)
            for d, share in CLASS_SHARES.items()
            for mean, times in [self.usual.get(row + d, (0, 0))]
        ]
        weight = sum(w for w, _ in near)
        shares = [(3, sum(w * mean for w, mean in near) // weight)] if weight else []
        if way is not None:
            shares += [
                (share * min(w.taken, MOST_OF_WAY), w.usual)
                for w, share in ((way, 4), (way.opposite, 2))
            ]
        total = sum(w for w, _ in shares)
        own = [sum(w * mean for w, mean in shares) // total] if total else []
        if self.pace is None:
            return own
        distance = log2_of(max(far, 1))
        return [
            *(own or [distance + self.slow_pace]),
            distance + self.pace,
            distance + self.slow_pace,
        ]

    def reach(self):
        return max(self.step_length, 64)

    def octave(self, u, w):
        """How often a squared length reaches a bound that doubles."""
        steps = [
            min(abs(a - b), 1 << 25) for a, b in zip(self.places[u], self.places[w], strict=True)
        ]
        square = 256 * sum(step * step for step in steps)
        bound = (min(self.reach(), 1 << 27) * 181 >> 10) ** 2
        return min((square // bound).bit_length(), len(LIKELY_DISTANCE) - 1)

    def bearing(self, before, u, v):
        if before is None:
            return 7
        dot = one = two = 0.0
        for a, b, c in zip(self.places[before], self.places[u], self.places[v], strict=True):
            dot += float(b - a) * float(c - b)
            one += float(b - a) * float(b - a)
            two += float(c - b) * float(c - b)
        if one == 0 or two == 0:
            return 7
        square = dot * abs(dot) / (one * two)
        return next((i for i, bound in enumerate(COSINES) if square > bound), 6)

    def link(self, u, before, layer):
        nodes = len(self.places)
        near, cheap = [], False
        recent = RECENT if self.cheap < CHEAP_WAYS else FEW
        for w in range(nodes - 1, max(nodes - recent, 0) - 1, -1):
            if w != u and (layer == "gap" or not self.way(u, w)):
                kind = (
                    self.bearing(before, u, w)
                    if layer == "link"
                    else min(self.rests[w].bit_length(), 3)
                )
                near.append((w, self.octave(u, w), kind))
        if near and (nodes <= recent or self.bit("near", FIRST_NEAR)):
            choice, cheap = self.candidate(layer, near)
            v = near[choice][0]
        else:
            v = self.coder.target(nodes)
            self.coder.interval(v, 1, nodes)
        self.learn_candidates(layer, near, cheap)
        return v

    def candidate(self, layer, near):
        """Which of the candidates it is, and whether that was cheap."""
        hits, offers = self.hits[layer], self.offers[layer]
        weights = [(hits[o][b] << 16) // offers[o][b] + 1 for _, o, b in near]
        choice = read_choice(self.coder, weights)
        _, o, b = near[choice]
        hits[o][b] += HIT_STEP
        return choice, 4 * weights[choice] > sum(weights)

    def learn_candidates(self, layer, near, cheap):
        if len(self.places) > FEW:
            self.cheap = max(self.cheap + (1 if cheap else -1), 0)
        for _, o, b in near:
            self.offers[layer][o][b] += 1

    def settle(self, u):
        """Nodes nearest to u along the ways, u first, each with the index of the one that it was reached from."""
        breadth = BREADTH if self.cheap < CHEAP_WAYS else FEW_SETTLED
        settled, done, offers, made = [], set(), [(0, 0, u, None)], 1
        while offers and len(settled) < breadth:
            far, _, node, origin = heapq.heappop(offers)
            if node in done:
                continue
            done.add(node)
            for way in self.ways[node]:
                if made < MOST_OFFERS and way.end not in done:
                    heapq.heappush(
                        offers,
                        (far + max(self.length(node, way.end), 1), made, way.end, len(settled)),
                    )
                    made += 1
            settled.append((node, origin))
        return settled

    def aim(self, u, context):
        """The way to the place that the walk aims at, if it does."""
        if not self.ways[u] or not self.bit(("aim", context), FIRST_AIM):
            return
        settled = self.settle(u)
        ends = [self.ends[node] // TERMINAL for node, _ in settled]
        near = [
            (at, at.bit_length(), min(ends[at].bit_length(), 7))
            for at in range(len(settled) - 1, 0, -1)
        ]
        choice, cheap = self.candidate("aim", near)
        self.learn_candidates("aim", near, cheap)
        at = near[choice][0]
        self.ends[settled[at][0]] += TERMINAL
        while at > 0:
            self.trail.insert(0, settled[at][0])
            at = settled[at][1]

    def ahead(self, u, span=0):
        """A new place in the frame of the last step, of which the span is known or 0."""
        here, out, reach = self.places[u], [], self.reach()
        if self.dimension > 1 and span and self.speed:
            span = min(span, 1 << 25)
            reach, usual = (
                min(max(far * span // cells, 64), 1 << 36) for far, cells in (self.speed, self.sums)
            )
            spots = [(reach, reach >> s) for s in range(1, 7)] + [
                (usual, usual >> s) for s in range(1, 6)
            ]
            along = self.offset(
                "paced along",
                [(TWO_SIDED, *spot) for spot in [*spots, (0, reach >> 2), (0, reach)]],
            )
            across = self.offset("paced across", self.across(reach, along))
            out = list(plain_rotate_back(along, across, self.heading or 0))
        elif self.dimension > 1:
            along = self.offset("along", self.along(reach))
            across = self.offset("across", self.across(reach, along))
            out = list(plain_rotate_back(along, across, self.heading or 0))
        while len(out) < self.dimension:
            out.append(
                self.offset("beside", [(TWO_SIDED, 0, reach >> shift) for shift in range(6)])
            )
        return [a + b for a, b in zip(here, out, strict=True)]

    def along(self, reach):
        spots = [(reach, reach >> shift) for shift in (1, 2, 3, 4)]
        spots += [(reach >> 1, reach >> 2), (0, reach >> 2), (0, reach), (reach << 1, reach >> 1)]
        return [(TWO_SIDED, *spot) for spot in spots]

    def across(self, reach, along):
        spots = [(0, reach >> shift) for shift in (1, 2, 3, 4, 5)]
        reach, forth = min(reach, 1 << 30), 16 * min(abs(along), 1 << 26)
        side = int(math.sqrt(float(reach * reach - forth * forth))) if forth < reach else 0
        spots += [(sign * side, reach >> shift) for sign in (-1, 1) for shift in (4, 2)]
        aside = 0
        if self.turn is not None:
            aside = (forth if along >= 0 else -forth) * TANGENTS[min(abs(self.turn), 49)] >> 14
            aside = aside if self.turn >= 0 else -aside
        return [(TWO_SIDED, *spot) for spot in [*spots, (aside, forth >> 2), (aside, forth >> 3)]]

    def jump(self, u):
        """A new place in the frame of the axes."""
        return [x + self.offset(("jump", axis % 4)) for axis, x in enumerate(self.places[u])]

    def span_ahead(self):
        """Span of a new way, before its place."""
        mean, times = self.usual.get("new", (0, 0))
        cells = self.span("ahead", [mean, self.last_new] if times else [], (1, 2, 4, 8, 16))
        self.last_new = log2_of(min(max(cells, 1), 1 << 36))
        self.usual["new"] = moved(mean, times, MOST_RESTS, self.last_new)
        return cells

    def part(self, u, before, arrived, last):
        if self.trail:
            way = self.way(u, self.trail.pop(0))
            kind = BACK if arrived and way is arrived.opposite else KNOWN
            return (
                kind,
                way.end,
                self.span("move", self.guesses(u, way.end, way), (3, 6, 12, 24, 48))
                if self.timed
                else 0,
            )
        kind = self.kind(u, arrived, last)
        v, way = u, None
        if kind == NEW and self.timed and self.modes & PACED:
            span = self.span_ahead()
            return kind, self.add_node(self.ahead(u, span)), span
        if kind in (BACK, KNOWN):
            way = arrived.opposite if kind == BACK else self.known_way(u, before, arrived)
            v = way.end
        elif kind == LINK:
            v = self.link(u, before, "link")
        elif kind == NEW:
            v = self.add_node(self.ahead(u))
        span = 0
        if self.timed:
            span = (
                self.rest("stay")
                if kind == STAY
                else self.span("move", self.guesses(u, v, way), (3, 6, 12, 24, 48))
            )
        return kind, v, span

    def gap(self, u):
        span = self.rest("gap") if self.timed else 0
        if self.bit("gap to itself"):
            return u, span
        if self.bit("gap to known"):
            return self.link(u, None, "gap"), span
        return self.add_node(self.jump(u)), span

    def start(self, u):
        if self.places and self.bit("known start", FIRST_KNOWN_START):
            return read_choice(self.coder, self.ends)
        return self.add_node(
            self.jump(u) if self.places else [self.whole("first") for _ in range(self.dimension)]
        )

    def first_cells(self, tracks):
        """First cells of all tracks, in order."""
        cells = [self.whole("start")] if tracks else []
        while len(cells) < tracks:
            cells.append(cells[-1] + self.count("start gap"))
        if any(abs(cell) >= LATEST for cell in cells):
            raise BadWalks("out of bounds")
        return list(enumerate(cells))

    def first_cell(self, starts, last):
        """The first cell of a track, and its place among those that are left; the last track's was at ``last`` of all."""
        skipped = self.count("track order") % self.all_tracks
        after = [start for start in starts if start[0] >= last] + [
            start for start in starts if start[0] < last
        ]
        chosen = after[skipped % len(after)]
        starts.remove(chosen)
        return chosen

    def tracks(self, knots, tracks):
        """Lists of (node, cell, whether a gap leads there), one for each track."""
        out, ended, u, first = [], True, None, 0
        self.all_tracks, at = tracks, 0
        starts = self.first_cells(tracks) if self.modes & SORTED else []
        for _ in range(knots):
            if self.coder.is_spent:
                raise BadWalks("too short")
            if ended:
                if len(out) == tracks:
                    raise BadWalks("too many knots")
                if self.modes & SORTED:
                    at, first = self.first_cell(starts, at)
                    at, cell = at + 1, first
                else:
                    first = cell = first + self.whole("start") if self.timed else 0
                u = self.start(u)
                self.ends[u] += TERMINAL
                out.append([(u, cell, False)])
                before, arrived, last, arrival = None, None, NEW, False
                self.heading = self.turn = None
            else:
                gap = bool(
                    self.gapped
                    and not self.trail
                    and self.bit(("gap", min((self.rests[u] + 1) // 2, 2), last == STAY), FIRST_GAP)
                )
                if self.modes & AIMS and not gap and not self.trail:
                    self.aim(u, "arrival" if arrival else last)
                arrival = len(self.trail) == 1
                if gap:
                    v, span = self.gap(u)
                    before, arrived, last = None, None, NEW
                    self.heading = self.turn = None
                    self.rests[u] += 1
                    self.rests[v] += 1
                else:
                    last, v, span = self.part(u, before, arrived, last)
                    if v != u:
                        arrived = self.learn(arrived, u, v, span)
                        before = u
                u, cell = v, cell + span
                out[-1].append((u, cell, gap))
            if abs(cell) >= LATEST or max(map(abs, self.places[u])) >= FARTHEST:
                raise BadWalks("out of bounds")
            ended = False
            if len(out) < tracks and not self.trail:
                ended = bool(self.bit(("end", self.ends[u] > 1), FIRST_END))
                self.ends[u] += TERMINAL * ended
        if len(out) < tracks or self.trail:
            raise BadWalks("too few tracks")
        return out


def decode(data, dimension, tracks):
    """Return (places of the nodes, tracks, timed)."""
    decoder, walks = read(data, dimension, tracks)
    return decoder.places, walks, decoder.timed


def read(data, dimension, tracks):
    """Return the decoder, whose coder is at the tail by now, and the tracks."""
    count = place = modes = 0
    if tracks and data and data[0] < 4:
        if data[0] == 0 and data[1:2] not in (b"\4", b"\5", b"\6", b"\7"):
            raise BadWalks("no such modes")
        modes, data = (data[0], data[1:]) if data[0] else (data[1], data[2:])
    for place, byte in enumerate(data[:9]):
        count |= (byte & 127) << 7 * place
        if byte < 128:
            break
    else:
        raise BadWalks("no count")
    payload, knots = data[place + 1 :], count >> 2
    if (
        Fraction(knots - 4096, 512) > len(payload)
        or knots < tracks
        or (tracks == 0) != (knots == 0)
    ):
        raise BadWalks("that many knots can't be")
    if modes & SORTED and not (count & 1 and tracks <= MOST_SORTED):
        raise BadWalks("starts can't be sorted")
    decoder = Decoder(payload, dimension, bool(count & 1), bool(count & 2), modes)
    walks = decoder.tracks(knots, tracks)
    if decoder.timed and any(
        b[1] <= a[1] for walk in walks for a, b in zip(walk, walk[1:], strict=False)
    ):
        raise BadWalks("times go back")
    return decoder, walks
