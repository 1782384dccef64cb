"""Positions of new nodes; see :mod:`gpszip.codec.kernels.position_coder`."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gpszip.codec.kernels.walk_priors import (
    MIX_ACROSS,
    MIX_ACROSS_TIMED,
    MIX_ALONG,
    MIX_ALONG_TIMED,
    MIX_BESIDE,
    MIX_JUMP,
)
from gpszip.codec.plain.distributions import Offsets
from gpszip.codec.plain.model import LARGE_OFFSET, MAX_MAGNITUDE, MIXTURE_LIMIT, PlainModel
from gpszip.codec.plain.rotation import rotate_back, sideways_offset

__all__ = ["read_jump", "read_position"]

#: Distributions about 0: their scales in sixteenths of a space step.
_AXIS_PAIRS = tuple((0, 16 << octave) for octave in (0, 2, 3, 4, 5, 6, 7, 9, 11, 13, 15, 17))

#: A known duration counts as at most this many time steps.
_MAX_DURATION = 1 << 25

#: The step to expect at some speed is at least this long, in sixteenths of a space step.
_MIN_REACH = 64

#: The largest offset along the heading, in space steps, and the largest reach, in sixteenths, with
#: which the offset across it is computed.
_MAX_ALONG = 1 << 26
_MAX_REACH = 1 << 30

#: Mixtures of jumps: one for each of so many axes.
_JUMP_AXES = 4

#: Centre and scale of a distribution.
_Pair = tuple[int, int]


def read_position(model: PlainModel, u: int, duration: int) -> list[int]:
    """Read the position of a new node, on the axes of the last step from u.

    Parameters
    ----------
    model : PlainModel
        Learns the offsets.
    u : int
        Where the walk is.
    duration : int
        Time steps of the step, where they are known; otherwise 0.
    """
    # The first two coordinates along and across the heading.
    offsets, reach = [], model.reach
    if model.dimension > 1:
        along, across, reach = _read_on_heading(model, reach, duration)
        # Without a heading, these are the axes of the grid.
        offsets = list(rotate_back(along, across, model.heading or 0))

    # Further axes.
    while len(offsets) < model.dimension:
        offsets.append(_read_offset(model, MIX_BESIDE, [(0, reach >> i) for i in range(6)]))
    return [a + b for a, b in zip(model.map.positions[u], offsets, strict=True)]


def read_jump(model: PlainModel, u: int) -> list[int]:
    """Read the position of a new node, on the axes of the grid from u."""
    return [
        coordinate + _read_offset(model, MIX_JUMP + axis % _JUMP_AXES, [])
        for axis, coordinate in enumerate(model.map.positions[u])
    ]


def _read_on_heading(model: PlainModel, reach: int, duration: int) -> tuple[int, int, int]:
    """Read offsets along and across the heading; return them with the length to expect."""
    # Without a speed, by the mean length of steps.
    if not duration or model.speed is None:
        along = _read_offset(model, MIX_ALONG, _along(reach))
        return along, _read_offset(model, MIX_ACROSS, _across(model, reach, along)), reach

    # By how far the duration leads at the last speed, and at the mean of the last few.
    duration = min(duration, _MAX_DURATION)
    reach, mean_reach = (
        min(max(length * duration // time_steps, _MIN_REACH), MAX_MAGNITUDE)
        for length, time_steps in (model.speed, model.speed_sums)
    )
    along = _read_offset(model, MIX_ALONG_TIMED, _along_timed(reach, mean_reach))
    return along, _read_offset(model, MIX_ACROSS_TIMED, _across(model, reach, along)), reach


def _along(reach: int) -> list[_Pair]:
    """Distributions of an offset along the heading."""
    # The order is that of the initial weights, in which distributions are known by their places.
    return [
        *((reach, reach >> shift) for shift in range(1, 5)),
        (reach >> 1, reach >> 2),
        (0, reach >> 2),
        (0, reach),
        (reach << 1, reach >> 1),
    ]


def _along_timed(reach: int, mean_reach: int) -> list[_Pair]:
    """Distributions of an offset along the heading, where the duration is known."""
    return [
        *((reach, reach >> shift) for shift in range(1, 7)),
        *((mean_reach, mean_reach >> shift) for shift in range(1, 6)),
        (0, reach >> 2),
        (0, reach),
    ]


def _across(model: PlainModel, reach: int, along: int) -> list[_Pair]:
    """Distributions of an offset across the heading, given the one along it."""
    pairs = [(0, reach >> shift) for shift in range(1, 6)]

    # Such that the step has the length to expect: sqrt(reach**2 - along**2).
    size = 16 * min(abs(along), _MAX_ALONG)
    reach = min(reach, _MAX_REACH)
    side = int(math.sqrt(float(reach * reach - size * size))) if size < reach else 0
    pairs += [(sign * side, reach >> shift) for sign in (-1, 1) for shift in (4, 2)]

    # Such that the walk turns as it did last.
    turned = 0
    if model.turn is not None:
        turned = sideways_offset(size if along >= 0 else -size, model.turn)
    return [*pairs, (turned, size >> 2), (turned, size >> 3)]


def _read_offset(model: PlainModel, mixture_id: np.int64, first: Sequence[_Pair]) -> int:
    """Read an offset on one axis, given the first distributions; others follow about 0."""
    pairs = [*first, *_AXIS_PAIRS]
    value = model.read_mixture(
        model.mixture(int(mixture_id)),
        -MIXTURE_LIMIT,
        MIXTURE_LIMIT,
        Offsets(pairs, -MIXTURE_LIMIT),
    )

    # The largest value stands for all that don't fit.
    return model.read_signed(LARGE_OFFSET) if value == MIXTURE_LIMIT - 1 else value
