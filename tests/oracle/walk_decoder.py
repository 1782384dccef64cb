"""A plain decoder of walks payloads, written from docs/format.md, "Walks payload": Python's integers, one number at a time."""

from __future__ import annotations

import math
from fractions import Fraction

from oracle.adaptive import HISTOGRAM, ONE_SIDED, TWO_SIDED, Bit, Mixture, Whole, read_choice
from oracle.range_coder import Reader

# Constants of docs/format.md. A change of the coder's must be mirrored here and there.
BACK, KNOWN, LINK, NEW, STAY = range(5)
EVEN = (10, 10)
FIRST_END, FIRST_GAP, FIRST_KNOWN_START, FIRST_NEAR = (36, 4), (36, 4), (12, 28), (8, 32)
FIRST_STAY, FIRST_BACK_AFTER_OTHERS = (28, 12), (36, 4)
FIRST_ESCAPE_BY_LEVEL = {3: (28, 12), 4: (34, 8)}  # after back, known or link
FIRST_ESCAPE_FRESH = {(1, 0): (3, 37), (1, 1): (3, 37)}  # (degree, level) after new or stay
DISTRIBUTIONS, FIRST_WEIGHT = 28, 65536 // 28
SPAN_SCALES = [16 << s for s in (0, 1, 2, 3, 4, 6, 8, 10, 12)]
AXIS_SCALES = [16 << s for s in (0, 3, 5, 7, 9, 11, 13, 15, 17)]
NEAR_END = 1 << 25
TERMINAL = 24
LINKS, RECENT = 384, 4096
LIKELY_DISTANCE, LIKELY_BEARING = (10, 8, 8, 7, 7, 6, 5, 4, 3, 3), (5, 4, 4, 4, 2, 1, 2, 4)
FIRST_OFFERS, HIT_STEP = 10, 8
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
        self.taken = self.pace = self.passed = 0
        self.then = {}  # how often each way was taken right after this one
        self.opposite = None


class Decoder:
    def __init__(self, payload, dimension, timed, gapped):
        self.coder = Reader(payload)
        self.dimension, self.timed, self.gapped = dimension, timed, gapped
        self.bits, self.wholes, self.mixtures = {}, {}, {}
        self.places, self.ends, self.ways = [], [], []  # of each node: place, weight as an end, ways (newest first)
        self.pace = self.slow_pace = self.step_length = 0
        self.offers = [[FIRST_OFFERS] * 8 for _ in range(10)]
        self.hits = [[d * b // 4 for b in LIKELY_BEARING] for d in LIKELY_DISTANCE]

    # numbers

    def bit(self, key, first=EVEN):
        return self.bits.setdefault(key, Bit(*first)).read(self.coder)

    def whole(self, key):
        return self.wholes.setdefault(key, Whole()).read(self.coder)

    def mixture(self, key, low, high, distributions):
        model = self.mixtures.setdefault(key, Mixture(FIRST_WEIGHT, DISTRIBUTIONS))
        clamped = [(kind, center, min(max(scale, 6), 1 << 36)) for kind, center, scale in distributions]
        return model.read(self.coder, low, high, clamped)

    def span(self, key, guesses=()):
        distributions = [(HISTOGRAM, 0, 16)] + [(ONE_SIDED, 0, scale) for scale in SPAN_SCALES]
        distributions += [(TWO_SIDED, guess, guess >> shift) for guess in guesses for shift in (1, 2, 3, 4)]
        cells = self.mixture(key, 1, NEAR_END, distributions)
        return cells + self.whole("far span") if cells == NEAR_END - 1 else cells

    def offset(self, key, special=()):
        distributions = [*special, *((TWO_SIDED, 0, scale) for scale in AXIS_SCALES)]
        value = self.mixture(key, -NEAR_END, NEAR_END, distributions)
        return self.whole("far offset") if value == NEAR_END - 1 else value

    # the map so far

    def length(self, u, v):
        steps = [min(abs(a - b), 1 << 29) for a, b in zip(self.places[u], self.places[v], strict=True)]
        return int(16 * math.sqrt(float(sum(step * step for step in steps))))

    def way(self, u, v):
        return next((way for way in self.ways[u] if way.end == v), None)

    def add_node(self, place):
        self.places.append(place)
        self.ends.append(1)
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
        if self.timed and far > 0:
            pace = min(max((min(span, 1 << 36) * 16 << 20) // far, 1), 1 << 26)
            way.pace = self.pace = pace
            self.slow_pace = pace if self.slow_pace == 0 else self.slow_pace + (pace - self.slow_pace) // 4
        self.step_length = far if self.step_length == 0 else self.step_length + (far - self.step_length) // 8
        return way

    # one part

    def kind(self, u, arrived, last):
        ways = self.ways[u]
        degree, visits = min(len(ways), 5), sum(way.taken for way in ways)
        level = min(visits.bit_length(), 4)
        fresh = last in (NEW, STAY)
        if ways:
            first = FIRST_ESCAPE_FRESH.get((degree, level), EVEN) if fresh else FIRST_ESCAPE_BY_LEVEL.get(level, EVEN)
            if not self.bit(("escape", degree, level, fresh), first):
                if arrived is None:
                    return KNOWN
                if degree == 1:
                    return BACK
                back = arrived.opposite
                seen = 2 if arrived.then.get(back, 0) else int(back.taken > 0)
                first = EVEN if last == BACK else FIRST_BACK_AFTER_OTHERS
                return BACK if self.bit(("back", min(degree, 4), seen, last == BACK), first) else KNOWN
        if self.bit(("stay", last), FIRST_STAY):
            return STAY
        if len(self.places) < 2:
            return NEW
        return NEW if self.bit(("new", min(degree, 3), last)) else LINK

    def known_way(self, u, arrived):
        back = arrived.opposite if arrived else None
        ways = [way for way in self.ways[u] if way is not back]
        weights = [2 * way.taken + way.opposite.taken + 1 for way in ways]
        single = sum(weights)
        if arrived and arrived.passed:
            weights = [w + 2 * min(arrived.then.get(way, 0), 1 << 16) * single // 3 for w, way in zip(weights, ways, strict=True)]
        return ways[read_choice(self.coder, weights)] if len(ways) > 1 else ways[0]

    def guesses(self, way):
        far = self.length(way.start, way.end)
        paces = (way.pace or way.opposite.pace or self.slow_pace, self.pace, self.slow_pace)
        return [min(far * pace >> 20, 1 << 30) for pace in paces if pace]

    def reach(self, span):
        if not self.timed or self.slow_pace == 0:
            return max(self.step_length, 64)
        return max(min((min(span, 1 << 36) * 16 << 20) // self.slow_pace, 1 << 34), 32)

    def octave(self, far, reach):
        ratio, bound = 0, reach * 181 >> 10
        while ratio < 9 and far >= bound:
            ratio, bound = ratio + 1, bound * 362 >> 8
        return ratio

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

    def link(self, u, before, reach):
        nodes = len(self.places)
        near = []
        for w in range(nodes - 1, max(nodes - RECENT, 0) - 1, -1):
            if len(near) == LINKS:
                break
            if w == u or self.way(u, w):
                continue
            octave = self.octave(self.length(u, w), reach)
            if octave <= 8:
                near.append((w, octave, self.bearing(before, u, w)))
        if near and self.bit("near", FIRST_NEAR):
            v, o, b = near[read_choice(self.coder, [(self.hits[o][b] << 16) // self.offers[o][b] + 1 for _, o, b in near])]
            self.hits[o][b] += HIT_STEP
        else:
            v = self.coder.target(nodes)
            self.coder.interval(v, 1, nodes)
        for _, o, b in near:
            self.offers[o][b] += 1
        return v

    def ahead(self, u, before, reach):
        """A new place in the frame of the last step."""
        here, out = self.places[u], []
        if self.dimension > 1:
            turn = 0
            if before is not None:
                turn = plain_direction(*(a - b for a, b in zip(here[:2], self.places[before][:2], strict=True)))
            along = self.offset("along", self.along(reach))
            across = self.offset("across", self.across(reach, along))
            out = list(plain_rotate_back(along, across, turn))
        while len(out) < self.dimension:
            out.append(self.offset("beside", [(TWO_SIDED, 0, reach >> shift) for shift in range(6)]))
        return [a + b for a, b in zip(here, out, strict=True)]

    def along(self, reach):
        usual = self.step_length
        spots = [(reach, reach >> shift) for shift in (1, 2, 3, 4)]
        spots += [(reach >> 1, reach >> 2), (0, reach >> 2), (0, reach), (usual, usual >> 2)]
        return [(TWO_SIDED, *spot) for spot in spots]

    def across(self, reach, along):
        spots = [(0, reach >> shift) for shift in (1, 2, 3, 4, 5)]
        reach, forth = min(reach, 1 << 30), 16 * min(abs(along), 1 << 26)
        side = int(math.sqrt(float(reach * reach - forth * forth))) if forth < reach else 0
        return [(TWO_SIDED, *spot) for spot in [*spots, *((sign * side, reach >> shift) for sign in (-1, 1) for shift in (4, 2))]]

    def jump(self, u):
        """A new place in the frame of the axes."""
        return [x + self.offset(("jump", axis % 4)) for axis, x in enumerate(self.places[u])]

    def part(self, u, before, arrived, last):
        kind = self.kind(u, arrived, last)
        v, guesses = u, []
        if kind in (BACK, KNOWN):
            way = arrived.opposite if kind == BACK else self.known_way(u, arrived)
            v, guesses = way.end, self.guesses(way)
        span = self.span(("span", max(kind, KNOWN)), guesses) if self.timed else 0
        if kind == LINK:
            v = self.link(u, before, self.reach(span))
        elif kind == NEW:
            v = self.add_node(self.ahead(u, before, self.reach(span)))
        return kind, v, span

    def gap(self, u):
        span = self.span("gap") if self.timed else 0
        if self.bit("gap to itself"):
            return u, span
        if self.bit("gap to known"):
            return self.link(u, None, max(self.step_length, 64)), span
        return self.add_node(self.jump(u)), span

    def start(self, u):
        if self.places and self.bit("known start", FIRST_KNOWN_START):
            return read_choice(self.coder, self.ends)
        return self.add_node(self.jump(u) if self.places else [self.whole("first") for _ in range(self.dimension)])

    def tracks(self, knots, tracks):
        """Lists of (node, cell, whether a gap leads there), one for each track."""
        out, ended, u, first = [], True, None, 0
        for _ in range(knots):
            if self.coder.is_spent:
                raise BadWalks("too short")
            if ended:
                if len(out) == tracks:
                    raise BadWalks("too many knots")
                first = cell = first + self.whole("start") if self.timed else 0
                u = self.start(u)
                self.ends[u] += TERMINAL
                out.append([(u, cell, False)])
                before, arrived, last = None, None, NEW
            else:
                gap = bool(self.gapped and self.bit(("gap", last == STAY), FIRST_GAP))
                if gap:
                    v, span = self.gap(u)
                    before, arrived, last = None, None, NEW
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
            if len(out) < tracks:
                ended = bool(self.bit(("end", self.ends[u] > 1), FIRST_END))
                self.ends[u] += TERMINAL * ended
        if len(out) < tracks:
            raise BadWalks("too few tracks")
        return out


def decode(data, dimension, tracks):
    """Return (places of the nodes, tracks, timed)."""
    count = place = 0
    for place, byte in enumerate(data[:9]):
        count |= (byte & 127) << 7 * place
        if byte < 128:
            break
    else:
        raise BadWalks("no count")
    payload, knots = data[place + 1 :], count >> 2
    if Fraction(knots - 4096, 512) > len(payload) or knots < tracks or (tracks == 0) != (knots == 0):
        raise BadWalks("that many knots can't be")
    decoder = Decoder(payload, dimension, bool(count & 1), bool(count & 2))
    walks = decoder.tracks(knots, tracks)
    if decoder.timed and any(b[1] <= a[1] for walk in walks for a, b in zip(walk, walk[1:], strict=False)):
        raise BadWalks("times go back")
    return decoder.places, walks, decoder.timed
