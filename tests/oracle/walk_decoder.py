"""A plain decoder of walks payloads, written from docs/format.md, "Walks payload".

It works on Python's integers, one number at a time.
"""

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
    Signed,
    Unsigned,
    log2_of,
    read_choice,
)
from oracle.range_coder import Decoder

# Constants of docs/format.md. A change of the coder's must be mirrored here and there.

#: Kinds of steps.
BACK, KNOWN, NEW_EDGE, NEW_NODE, STAY = range(5)

#: Modes.
SORTED_STARTS = 1
TIME_FIRST = 2
SHORTEST_PATHS = 4
MAX_SORTED_TRACKS = 4096

#: Initial counts of bits.
EVEN = (10, 10)
INITIAL_END = (36, 4)
INITIAL_GAP = (36, 4)
INITIAL_TARGET = (36, 4)
INITIAL_KNOWN_START = (12, 28)
INITIAL_RECENT = (8, 32)
INITIAL_STAY = (28, 12)
INITIAL_BACK_AFTER_OTHERS = (36, 4)
INITIAL_ESCAPE_BY_LEVEL = {3: (28, 12), 4: (34, 8)}  # after back, known or a new edge
INITIAL_ESCAPE_FRESH = {(1, 0): (3, 37), (1, 1): (3, 37)}  # (degree, level) after new or stay

#: Mixtures.
DURATION_SCALES = [16 << s for s in (0, 1, 2, 3, 4, 6, 8, 10, 12)]
AXIS_SCALES = [16 << s for s in (0, 2, 3, 4, 5, 6, 7, 9, 11, 13, 15, 17)]
MIXTURE_LIMIT = 1 << 25
MAX_SCALE = 1 << 36
INITIAL_WEIGHTS = {  # of 1024
    "move": (
        *(26, 3, 3, 13, 30, 53, 6, 14, 3, 3, 151, 230, 73, 17, 11),
        *(6, 68, 45, 14, 35, 8, 115, 66, 16, 9),
    ),
    "stay": (54, 4, 20, 153, 214, 122, 120, 34, 4, 4, 8, 179, 108),
    "gap": (40, 5, 5, 6, 20, 16, 90, 90, 232, 89, 125, 193, 113),
    "duration first": (
        *(259, 8, 34, 11, 53, 46, 7, 6, 5, 5, 7, 18, 215, 205, 22),
        *(7, 11, 28, 52, 27),
    ),
    "along": (257, 4, 3, 3, 203, 23, 10, 40, 63, 158, 126, 68, 31, 13, 5, 4, 4, 3, 3, 3),
    "across": (
        *(123, 15, 13, 16, 8, 6, 45, 6, 20, 38, 5, 11, 78, 478, 131),
        *(8, 5, 4, 4, 3, 3, 2, 2),
    ),
    "along, timed": (
        *(20, 57, 48, 75, 5, 5, 36, 265, 40, 66, 16, 25, 13, 236, 49),
        *(22, 9, 6, 5, 4, 4, 4, 4, 4, 4),
    ),
    "across, timed": (
        *(75, 15, 11, 16, 10, 265, 51, 176, 69, 5, 13, 38, 205, 18, 18),
        *(6, 5, 5, 5, 5, 5, 5, 5),
    ),
    "beside": (36,) * 18,
    "jump": (41, 166, 116, 100, 117, 190, 142, 30, 62, 25, 20, 15),
}

#: Choices among nodes and edges.
MAX_CANDIDATES = 4096
FEW_CANDIDATES = 64
MAX_CHEAP_CHOICES = 1 << 14
NEW_EDGE_BY_DISTANCE = (160, 128, 128, 112, 112, 96, 80, 64, 48, 48, 1, 1, 1)
NEW_EDGE_BY_BEARING = (5, 4, 4, 4, 2, 1, 2, 4)
GAP_BY_DISTANCE = (128, 128, 128, 128, 128, 128, 128, 96, 64, 48, 40, 24, 24)
GAP_BY_GAP_ENDS = (1, 4, 8, 16)
TARGET_BY_RANK = (1, 4, 16, 48, 96, 128, 128, 96, 64, 1, 1, 1, 1)
TARGET_BY_ENDS = (2, 4, 6, 8, 8, 8, 8, 8)
INITIAL_OFFERED = 10
CHOSEN_INCREMENT = 128
INITIAL_TURNS = 5 << 16
TURN_INCREMENT = 1 << 16
COSINES = (0.97, 0.75, 0.25, -0.25, -0.75, -0.97)
MAX_WEIGHT_SUM = 1 << 40
END_WEIGHT = 24

#: Searches for targets.
MAX_SEARCH_NODES = 256
FEW_SEARCH_NODES = 16
MAX_ENTRIES = 4096

#: Means of durations.
LENGTH_CLASSES = 48
CLASS_SHARES = {-2: 1, -1: 5, 0: 33, 1: 5, 2: 1}
MAX_CLASS_SAMPLES = 20
MAX_EDGE_SAMPLES = 12
MAX_PAUSE_SAMPLES = 20

#: Bounds of coordinates and time steps.
MAX_COORDINATE = 1 << 45
MAX_TIME_STEP = 1 << 60


def _turn_tables():
    """Cosine and sine of each 256th of a turn, sine and tangent of half of those within an eighth.

    All are times 16384.
    """
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


def updated_mean(mean, samples, max_samples, value):
    """A mean after one more value, and its number of samples."""
    samples = min(samples + 1, max_samples)
    return mean + (value - mean) // samples, samples


def log_duration(duration):
    return log2_of(min(max(duration, 1), 1 << 36))


class InvalidWalks(Exception):
    """The payload holds no walks."""


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


class HalfEdge:
    """One direction of an edge."""

    def __init__(self, start, end):
        self.start, self.end = start, end
        self.traversals = self.continued = self.mean_log = 0
        self.followers = {}  # how often each half-edge was taken right after this one
        self.opposite = None


class WalkDecoder:
    def __init__(self, payload, dimension, timed, gapped, modes=0):
        self.coder = Decoder(payload)
        self.dimension, self.timed, self.gapped, self.modes = dimension, timed, gapped, modes
        self.bits, self.integers, self.mixtures = {}, {}, {}

        # of each node
        self.positions, self.end_weights = [], []
        self.half_edges = []  # the newest first
        self.gap_ends = []  # how often gaps began or ended there

        # what the last steps were like
        self.log_pace = self.mean_log_pace = None
        self.step_length = 0
        self.heading = self.turn = None
        self.speed = None  # length and duration of the last step
        self.speed_sums = (0, 0)  # fading sums of both
        self.last_log_duration = None  # of the last new node where durations come first
        self.means = {}  # mean logarithm of durations, and samples, by what lasts

        # choices
        self.path = []  # nodes on the way to the target
        self.cheap_choices = 0  # how many more choices were cheap than not
        self.offered = {
            table: [[INITIAL_OFFERED] * 8 for _ in range(13)]
            for table in ("new edge", "gap", "target")
        }
        self.chosen = {
            "new edge": [[d * b for b in NEW_EDGE_BY_BEARING] for d in NEW_EDGE_BY_DISTANCE],
            "gap": [[d * g for g in GAP_BY_GAP_ENDS] for d in GAP_BY_DISTANCE],
            "target": [[r * e for e in TARGET_BY_ENDS] for r in TARGET_BY_RANK],
        }
        self.turns_offered, self.turns_chosen = [INITIAL_TURNS] * 8, [INITIAL_TURNS] * 8

    # numbers

    def bit(self, key, initial=EVEN):
        return self.bits.setdefault(key, Bit(*initial)).read(self.coder)

    def signed(self, key):
        return self.integers.setdefault(key, Signed()).read(self.coder)

    def unsigned(self, key):
        return self.integers.setdefault(key, Unsigned()).read(self.coder)

    def mixture(self, key, low, high, distributions):
        initial = INITIAL_WEIGHTS[key if isinstance(key, str) else key[0]]
        assert len(distributions) <= len(initial)
        model = self.mixtures.setdefault(key, Mixture([64 * share for share in initial]))
        clamped = [
            (kind, center, scale if kind == BY_RATIO else min(max(scale, 6), MAX_SCALE))
            for kind, center, scale in distributions
        ]
        return model.read(self.coder, low, high, clamped)

    def pause_duration(self, key):
        """Duration of a stop or gap."""
        mean, samples = self.means.get(key, (0, 0))
        duration = self.duration(key, [mean] if samples else [], (1, 2, 4))
        self.means[key] = updated_mean(mean, samples, MAX_PAUSE_SAMPLES, log_duration(duration))
        return duration

    def move_duration(self, u, v, half_edge):
        return self.duration("move", self.guesses(u, v, half_edge), (3, 6, 12, 24, 48))

    def duration_first(self):
        """Duration of a step to a new node, before its position."""
        mean, samples = self.means.get("new node", (0, 0))
        guesses = [mean, self.last_log_duration] if samples else []
        duration = self.duration("duration first", guesses, (1, 2, 4, 8, 16))
        self.last_log_duration = log_duration(duration)
        self.means["new node"] = updated_mean(
            mean, samples, MAX_PAUSE_SAMPLES, self.last_log_duration
        )
        return duration

    def duration(self, key, guesses, scales):
        distributions = [(HISTOGRAM, 0, 16)] + [(ONE_SIDED, 0, scale) for scale in DURATION_SCALES]
        distributions += [(BY_RATIO, guess, scale) for guess in guesses for scale in scales]
        duration = self.mixture(key, 1, MIXTURE_LIMIT, distributions)
        return (
            duration + self.signed("large duration") if duration == MIXTURE_LIMIT - 1 else duration
        )

    def offset(self, key, special=()):
        """An offset on one axis; ``special`` are (centre, scale) of the first distributions."""
        distributions = [(TWO_SIDED, *pair) for pair in special]
        distributions += [(TWO_SIDED, 0, scale) for scale in AXIS_SCALES]
        value = self.mixture(key, -MIXTURE_LIMIT, MIXTURE_LIMIT, distributions)
        return self.signed("large offset") if value == MIXTURE_LIMIT - 1 else value

    # the map so far

    def length(self, u, v):
        steps = [
            min(abs(a - b), 1 << 29)
            for a, b in zip(self.positions[u], self.positions[v], strict=True)
        ]
        return int(16 * math.sqrt(float(sum(step * step for step in steps))))

    def half_edge(self, u, v):
        return next((edge for edge in self.half_edges[u] if edge.end == v), None)

    def add_node(self, position):
        self.positions.append(position)
        self.end_weights.append(1)
        self.gap_ends.append(0)
        self.half_edges.append([])
        return len(self.positions) - 1

    def learn(self, incoming, u, v, duration):
        """Learn a step from u to v after the half-edge ``incoming``; return its half-edge."""
        length = self.length(u, v)
        edge = self.half_edge(u, v)
        if edge is None:
            edge, back = HalfEdge(u, v), HalfEdge(v, u)
            edge.opposite, back.opposite = back, edge
            self.half_edges[u].insert(0, edge)
            self.half_edges[v].insert(0, back)
        edge.traversals += 1
        if incoming is not None:
            incoming.followers[edge] = incoming.followers.get(edge, 0) + 1
            incoming.continued += 1
        if self.timed:
            self.learn_duration(edge, length, duration)
        if self.dimension > 1:
            self.learn_heading(u, v)
        self.step_length += (length - self.step_length) // 8 if self.step_length else length
        return edge

    def learn_heading(self, u, v):
        start, end = self.positions[u], self.positions[v]
        heading = plain_direction(end[0] - start[0], end[1] - start[1])
        self.turn = None if self.heading is None else (heading - self.heading + 128) % 256 - 128
        self.heading = heading

    def learn_duration(self, edge, length, duration):
        log, row = log_duration(duration), self.length_class(length)
        self.means[row] = updated_mean(*self.means.get(row, (0, 0)), MAX_CLASS_SAMPLES, log)
        edge.mean_log += (log - edge.mean_log) // min(edge.traversals, MAX_EDGE_SAMPLES)
        if length > 0:
            pace = self.log_pace = log - log2_of(length)
            if self.mean_log_pace is None:
                self.mean_log_pace = pace
            else:
                self.mean_log_pace += 5 * (pace - self.mean_log_pace) // 32
            self.speed = min(length, 1 << 34), min(duration, 1 << 25)
            self.speed_sums = tuple(
                total + new - (total >> 3)
                for total, new in zip(self.speed_sums, self.speed, strict=True)
            )

    def length_class(self, length):
        if length < 16:
            return 0
        return min(1 + ((log2_of(length) - (4 << 16)) >> 15), LENGTH_CLASSES - 1)

    def bearing(self, before, u, v):
        if before is None:
            return 7
        dot = step_square = square = 0.0
        positions = (self.positions[before], self.positions[u], self.positions[v])
        for a, b, c in zip(*positions, strict=True):
            dot += float(b - a) * float(c - b)
            step_square += float(b - a) * float(b - a)
            square += float(c - b) * float(c - b)
        if step_square == 0 or square == 0:
            return 7
        cosine = dot * abs(dot) / (step_square * square)
        return next((i for i, bound in enumerate(COSINES) if cosine > bound), 6)

    # one step

    def kind(self, u, incoming, last_kind):
        edges = self.half_edges[u]
        degree = min(len(edges), 5)
        level = min(sum(edge.traversals for edge in edges).bit_length(), 4)
        fresh = last_kind in (NEW_NODE, STAY)
        if edges:
            initial = (
                INITIAL_ESCAPE_FRESH.get((degree, level), EVEN)
                if fresh
                else INITIAL_ESCAPE_BY_LEVEL.get(level, EVEN)
            )
            if not self.bit(("escape", degree, level, fresh), initial):
                return self.known_kind(degree, incoming, last_kind)
        if self.bit(("stay", last_kind), INITIAL_STAY):
            return STAY
        if len(self.positions) < 2:
            return NEW_NODE
        return NEW_NODE if self.bit(("new node", min(degree, 3), last_kind)) else NEW_EDGE

    def known_kind(self, degree, incoming, last_kind):
        if incoming is None:
            return KNOWN
        if degree == 1:
            return BACK
        back = incoming.opposite
        seen = 2 if incoming.followers.get(back, 0) else int(back.traversals > 0)
        initial = EVEN if last_kind == BACK else INITIAL_BACK_AFTER_OTHERS
        key = ("back", min(degree, 4), seen, last_kind == BACK)
        return BACK if self.bit(key, initial) else KNOWN

    def known_edge(self, u, before, incoming):
        back = incoming.opposite if incoming else None
        edges = [edge for edge in self.half_edges[u] if edge is not back]
        if len(edges) == 1:
            return edges[0]
        turns = [self.bearing(before, u, edge.end) for edge in edges]
        weights = []
        for edge, turn in zip(edges, turns, strict=True):
            ratio = (self.turns_chosen[turn] << 8) // self.turns_offered[turn]
            traversals = 3 * edge.traversals + edge.opposite.traversals + 1
            weights.append(traversals * min(max(ratio, 16), 4096))
        if incoming and incoming.continued:
            total = sum(weights)
            weights = [
                weight + min(incoming.followers.get(edge, 0), 1 << 16) * total // 2
                for weight, edge in zip(weights, edges, strict=True)
            ]
        while sum(weights) > MAX_WEIGHT_SUM:
            weights = [(weight >> 1) + 1 for weight in weights]
        choice = read_choice(self.coder, weights)
        for turn, weight in zip(turns, weights, strict=True):
            self.turns_offered[turn] += (weight << 16) // sum(weights)
        self.turns_chosen[turns[choice]] += TURN_INCREMENT
        return edges[choice]

    def guesses(self, u, v, edge):
        length = self.length(u, v)
        row = self.length_class(length)
        near = [
            (share * samples, mean)
            for offset, share in CLASS_SHARES.items()
            for mean, samples in [self.means.get(row + offset, (0, 0))]
        ]
        weight = sum(w for w, _ in near)
        shares = [(3, sum(w * mean for w, mean in near) // weight)] if weight else []
        if edge is not None:
            shares += [
                (share * min(e.traversals, MAX_EDGE_SAMPLES), e.mean_log)
                for e, share in ((edge, 4), (edge.opposite, 2))
            ]
        total = sum(w for w, _ in shares)
        mean = [sum(w * mean for w, mean in shares) // total] if total else []
        if self.log_pace is None:
            return mean
        log_length = log2_of(max(length, 1))
        return [
            *(mean or [log_length + self.mean_log_pace]),
            log_length + self.log_pace,
            log_length + self.mean_log_pace,
        ]

    def step(self, u, before, incoming, last_kind):
        """Kind of a step, the node to which it leads, and its duration."""
        if self.path:
            edge = self.half_edge(u, self.path.pop(0))
            kind = BACK if incoming and edge is incoming.opposite else KNOWN
            return kind, edge.end, self.move_duration(u, edge.end, edge) if self.timed else 0
        kind = self.kind(u, incoming, last_kind)
        if kind == NEW_NODE and self.timed and self.modes & TIME_FIRST:
            duration = self.duration_first()
            return kind, self.add_node(self.new_position(u, duration)), duration
        v, edge = u, None
        if kind in (BACK, KNOWN):
            edge = incoming.opposite if kind == BACK else self.known_edge(u, before, incoming)
            v = edge.end
        elif kind == NEW_EDGE:
            v = self.known_node(u, before, "new edge")
        elif kind == NEW_NODE:
            v = self.add_node(self.new_position(u))
        if not self.timed:
            return kind, v, 0
        duration = self.pause_duration("stay") if kind == STAY else self.move_duration(u, v, edge)
        return kind, v, duration

    def gap(self, u):
        """The node at which a gap ends, and its duration."""
        duration = self.pause_duration("gap") if self.timed else 0
        if self.bit("gap to itself"):
            return u, duration
        if self.bit("gap to known"):
            return self.known_node(u, None, "gap"), duration
        return self.add_node(self.jump(u)), duration

    # choices among nodes

    def octave(self, u, w):
        """How often a squared length reaches a bound that doubles."""
        steps = [
            min(abs(a - b), 1 << 25)
            for a, b in zip(self.positions[u], self.positions[w], strict=True)
        ]
        square = 256 * sum(step * step for step in steps)
        bound = (min(self.reach(), 1 << 27) * 181 >> 10) ** 2
        return min((square // bound).bit_length(), len(NEW_EDGE_BY_DISTANCE) - 1)

    def known_node(self, u, before, table):
        nodes = len(self.positions)
        candidates, cheap = [], False
        count = MAX_CANDIDATES if self.cheap_choices < MAX_CHEAP_CHOICES else FEW_CANDIDATES
        for w in range(nodes - 1, max(nodes - count, 0) - 1, -1):
            if w != u and (table == "gap" or not self.half_edge(u, w)):
                kind = (
                    self.bearing(before, u, w)
                    if table == "new edge"
                    else min(self.gap_ends[w].bit_length(), 3)
                )
                candidates.append((w, self.octave(u, w), kind))
        if candidates and (nodes <= count or self.bit("recent node", INITIAL_RECENT)):
            choice, cheap = self.candidate(table, candidates)
            v = candidates[choice][0]
        else:
            v = self.coder.decode_cumulative(nodes)
            self.coder.interval(v, 1, nodes)
        self.learn_candidates(table, candidates, cheap)
        return v

    def candidate(self, table, candidates):
        """Which candidate is chosen, and whether that was cheap."""
        chosen, offered = self.chosen[table], self.offered[table]
        weights = [
            (chosen[octave][kind] << 16) // offered[octave][kind] + 1
            for _, octave, kind in candidates
        ]
        choice = read_choice(self.coder, weights)
        _, octave, kind = candidates[choice]
        chosen[octave][kind] += CHOSEN_INCREMENT
        return choice, 4 * weights[choice] > sum(weights)

    def learn_candidates(self, table, candidates, cheap):
        if len(self.positions) > FEW_CANDIDATES:
            self.cheap_choices = max(self.cheap_choices + (1 if cheap else -1), 0)
        for _, octave, kind in candidates:
            self.offered[table][octave][kind] += 1

    def find_nearest(self, u):
        """Nodes nearest to u along edges, u first, each with the rank of its parent."""
        few = self.cheap_choices >= MAX_CHEAP_CHOICES
        max_nodes = FEW_SEARCH_NODES if few else MAX_SEARCH_NODES
        nearest, reached, heap, entries = [], set(), [(0, 0, u, None)], 1
        while heap and len(nearest) < max_nodes:
            distance, _, node, parent = heapq.heappop(heap)
            if node in reached:
                continue
            reached.add(node)
            for edge in self.half_edges[node]:
                if entries < MAX_ENTRIES and edge.end not in reached:
                    length = max(self.length(node, edge.end), 1)
                    heapq.heappush(heap, (distance + length, entries, edge.end, len(nearest)))
                    entries += 1
            nearest.append((node, parent))
        return nearest

    def target(self, u, context):
        """Set the path to a target, if there is one."""
        if not self.half_edges[u] or not self.bit(("target", context), INITIAL_TARGET):
            return
        nearest = self.find_nearest(u)
        ends = [self.end_weights[node] // END_WEIGHT for node, _ in nearest]
        candidates = [
            (rank, rank.bit_length(), min(ends[rank].bit_length(), 7))
            for rank in range(len(nearest) - 1, 0, -1)
        ]
        choice, cheap = self.candidate("target", candidates)
        self.learn_candidates("target", candidates, cheap)
        rank = candidates[choice][0]
        self.end_weights[nearest[rank][0]] += END_WEIGHT
        while rank > 0:
            self.path.insert(0, nearest[rank][0])
            rank = nearest[rank][1]

    # positions

    def reach(self):
        return max(self.step_length, 64)

    def new_position(self, u, duration=0):
        """A position on the axes of the last step, whose duration is known or 0."""
        offsets, reach = [], self.reach()
        if self.dimension > 1:
            if duration and self.speed:
                duration = min(duration, 1 << 25)
                reach, mean_reach = (
                    min(max(length * duration // time_steps, 64), MAX_SCALE)
                    for length, time_steps in (self.speed, self.speed_sums)
                )
                special = [(reach, reach >> shift) for shift in range(1, 7)]
                special += [(mean_reach, mean_reach >> shift) for shift in range(1, 6)]
                along = self.offset("along, timed", [*special, (0, reach >> 2), (0, reach)])
                across = self.offset("across, timed", self.across(reach, along))
            else:
                along = self.offset("along", self.along(reach))
                across = self.offset("across", self.across(reach, along))
            offsets = list(plain_rotate_back(along, across, self.heading or 0))
        while len(offsets) < self.dimension:
            offsets.append(self.offset("beside", [(0, reach >> shift) for shift in range(6)]))
        return [a + b for a, b in zip(self.positions[u], offsets, strict=True)]

    def along(self, reach):
        pairs = [(reach, reach >> shift) for shift in (1, 2, 3, 4)]
        halves = (reach >> 1, reach >> 2), (0, reach >> 2)
        return [*pairs, *halves, (0, reach), (reach << 1, reach >> 1)]

    def across(self, reach, along):
        pairs = [(0, reach >> shift) for shift in (1, 2, 3, 4, 5)]
        reach, size = min(reach, 1 << 30), 16 * min(abs(along), 1 << 26)
        side = int(math.sqrt(float(reach * reach - size * size))) if size < reach else 0
        pairs += [(sign * side, reach >> shift) for sign in (-1, 1) for shift in (4, 2)]
        turned = 0
        if self.turn is not None:
            turned = (size if along >= 0 else -size) * TANGENTS[min(abs(self.turn), 49)] >> 14
            turned = turned if self.turn >= 0 else -turned
        return [*pairs, (turned, size >> 2), (turned, size >> 3)]

    def jump(self, u):
        """A position on the axes of the grid."""
        return [x + self.offset(("jump", axis % 4)) for axis, x in enumerate(self.positions[u])]

    # tracks

    def first_node(self, last_end):
        if self.positions and self.bit("known start", INITIAL_KNOWN_START):
            return read_choice(self.coder, self.end_weights)
        if self.positions:
            return self.add_node(self.jump(last_end))
        return self.add_node([self.signed("first position") for _ in range(self.dimension)])

    def sorted_starts(self, tracks):
        """First time steps of all tracks with their numbers, in order."""
        starts = [self.signed("track start")] if tracks else []
        while len(starts) < tracks:
            starts.append(starts[-1] + self.unsigned("start gap"))
        if any(abs(start) >= MAX_TIME_STEP for start in starts):
            raise InvalidWalks("out of bounds")
        return list(enumerate(starts))

    def take_start(self, starts, first, tracks):
        """Take one of the starts that are left, counted from the number ``first`` on."""
        skipped = self.unsigned("track order") % tracks
        after = [start for start in starts if start[0] >= first]
        after += [start for start in starts if start[0] < first]
        chosen = after[skipped % len(after)]
        starts.remove(chosen)
        return chosen

    def read_tracks(self, knots, tracks):
        """Lists of (node, time step, whether a gap leads there), one for each track."""
        out, ended, u, first = [], True, None, 0
        next_start = 0
        starts = self.sorted_starts(tracks) if self.modes & SORTED_STARTS else []
        for _ in range(knots):
            if self.coder.is_exhausted:
                raise InvalidWalks("too short")
            if ended:
                if len(out) == tracks:
                    raise InvalidWalks("too many knots")
                if self.modes & SORTED_STARTS:
                    number, first = self.take_start(starts, next_start, tracks)
                    next_start = number + 1
                elif self.timed:
                    first += self.signed("track start")
                time_step = first
                u = self.first_node(u)
                self.end_weights[u] += END_WEIGHT
                out.append([(u, time_step, False)])
                before, incoming, last_kind, arrived = None, None, NEW_NODE, False
                self.heading = self.turn = None
            else:
                gap = False
                if self.gapped and not self.path:
                    key = ("gap", min((self.gap_ends[u] + 1) // 2, 2), last_kind == STAY)
                    gap = bool(self.bit(key, INITIAL_GAP))
                if self.modes & SHORTEST_PATHS and not gap and not self.path:
                    self.target(u, "arrived" if arrived else last_kind)
                arrived = len(self.path) == 1
                if gap:
                    v, duration = self.gap(u)
                    before, incoming, last_kind = None, None, NEW_NODE
                    self.heading = self.turn = None
                    self.gap_ends[u] += 1
                    self.gap_ends[v] += 1
                else:
                    last_kind, v, duration = self.step(u, before, incoming, last_kind)
                    if v != u:
                        incoming = self.learn(incoming, u, v, duration)
                        before = u
                u, time_step = v, time_step + duration
                out[-1].append((u, time_step, gap))
            if (
                abs(time_step) >= MAX_TIME_STEP
                or max(map(abs, self.positions[u])) >= MAX_COORDINATE
            ):
                raise InvalidWalks("out of bounds")
            ended = False
            if len(out) < tracks and not self.path:
                ended = bool(self.bit(("end", self.end_weights[u] > 1), INITIAL_END))
                self.end_weights[u] += END_WEIGHT * ended
        if len(out) < tracks or self.path:
            raise InvalidWalks("too few tracks")
        return out


def decode(data, dimension, tracks):
    """Return (positions of the nodes, tracks, timed)."""
    decoder, walks = read(data, dimension, tracks)
    return decoder.positions, walks, decoder.timed


def read(data, dimension, tracks):
    """Return the decoder, whose coder is at the tail by now, and the tracks."""
    # modes
    modes = 0
    if tracks and data and data[0] < 4:
        if data[0] == 0 and data[1:2] not in (b"\4", b"\5", b"\6", b"\7"):
            raise InvalidWalks("no such modes")
        modes, data = (data[0], data[1:]) if data[0] else (data[1], data[2:])

    # number of knots, and flags
    number = place = 0
    for place, byte in enumerate(data[:9]):
        number |= (byte & 127) << 7 * place
        if byte < 128:
            break
    else:
        raise InvalidWalks("no count")
    payload, knots = data[place + 1 :], number >> 2
    timed, gapped = bool(number & 1), bool(number & 2)
    if (
        Fraction(knots - 4096, 512) > len(payload)
        or knots < tracks
        or (tracks == 0) != (knots == 0)
    ):
        raise InvalidWalks("that many knots can't be")
    if modes & SORTED_STARTS and not (timed and tracks <= MAX_SORTED_TRACKS):
        raise InvalidWalks("starts can't be sorted")

    # knots
    decoder = WalkDecoder(payload, dimension, timed, gapped, modes)
    walks = decoder.read_tracks(knots, tracks)
    if timed and any(
        after[1] <= before[1]
        for walk in walks
        for before, after in zip(walk, walk[1:], strict=False)
    ):
        raise InvalidWalks("times go back")
    return decoder, walks
