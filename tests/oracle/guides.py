"""Plain guides of tables by walks, row by row, written from docs/format.md."""

import math
import re

from oracle.lossless import KnotsGuide, RowsGuide


def read_guide(source, fields, trails):
    from oracle.exact_logs import read_column

    runs = source.varint()
    if not runs:
        return None
    tracks, rows = read_column(source, runs).values, read_column(source, runs).values
    exponent, zone, slack = source.u8(), source.signed(), source.varint()
    roles = []
    for _ in range(fields):
        role = source.u8()
        roles.append((role, source.u8() if role else 0))
    return PlainGuide(trails, tracks, rows, exponent, zone, slack, roles)


def on_grid(number, exponent, zone, grid):
    """Sixteenths of the steps of a grid."""
    p, q, offset = grid
    scaled = (float(number) * 10.0**exponent + float(zone - offset)) * (16 * q / p)
    return math.floor(min(max(scaled, -(2.0**60)), 2.0**60))


class PlainGuide:
    def __init__(self, trails, tracks, rows, exponent, zone, slack, roles):
        self.names_of_tracks, self.tracks, self.rows, self.roles = trails.names, tracks, rows, roles
        self.exponent, self.zone, self.slack = exponent, zone, slack
        self.trails = [trails.trail(track - 1) if track else None for track in tracks]

    def names(self, which):
        numbers = []
        for track, rows in zip(self.tracks, self.rows, strict=True):
            digits = (
                re.findall("(?:(?<![0-9])-)?[0-9]{1,17}", self.names_of_tracks[track - 1])
                if track
                else []
            )
            numbers += [int(digits[which]) if which < len(digits) else 0] * rows
        return numbers

    def times_guide(self, grid):
        runs, first = [], 0
        self.knot_times = []
        for trail, rows in zip(self.trails, self.rows, strict=True):
            if trail is None:
                runs.append((first, []))
                self.knot_times.append([])
                first += rows
                continue
            times = [on_grid(t, self.exponent, self.zone, grid) for t in trail.times]
            kinds = [
                2 if end else 4 if stay else 1
                for end, stay in zip(trail.is_end, trail.is_stay, strict=True)
            ]
            runs.append((first, list(zip(times, kinds, strict=True))))
            self.knot_times.append(times)
            first += rows
        return KnotsGuide(runs, self.slack)

    def positions_guide(self, axis, exponent, grid, times):
        spans = [knots[-1] - knots[0] for knots in self.knot_times if knots]
        shift = max(max(spans).bit_length() - 42, 0)
        numbers, classes, row = [], [], 0
        for trail, knots, rows in zip(self.trails, self.knot_times, self.rows, strict=True):
            if trail is None:
                numbers += [0] * rows
                classes += [0] * rows
                row += rows
                continue
            places = [on_grid(x, exponent, 0, grid) for x in trail.positions[:, axis]]
            first = knots[0]
            since_first = [(knot - first) >> shift for knot in knots]
            for time in times[row : row + rows]:
                since = min(max((16 * time - first) >> shift, 0), 2**42 - 1)
                number, kind = place_at(since, since_first, places, trail, self.slack >> shift)
                numbers.append(number)
                classes.append(kind)
            row += rows
        return RowsGuide(numbers, classes)


def place_at(since, knots, places, trail, slack):
    """Where a walk is at a time since its first knot, and the class of the place."""
    before = sum(knot <= since for knot in knots) - 1
    k = max(min(before, len(knots) - 2), 0)
    after = min(k + 1, len(knots) - 1)
    elapsed = max(since - knots[k], 0)
    share = min((elapsed << 16) // max(knots[after] - knots[k], 1), 2**16)
    way = min(max(places[after] - places[k], -(2**45)), 2**45)
    kind = 5 if trail.is_gap[after] else 4 if trail.is_stay[after] else 3
    if min(elapsed, abs(knots[after] - since)) <= slack:
        kind = 1
    return places[k] + (way * share >> 16), kind
