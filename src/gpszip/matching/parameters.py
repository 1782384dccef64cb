"""Parameters of the hidden Markov model: those that follow from the log, and those that are fixed.

The scales of a log (:class:`~gpszip.model.match.Scales`) say how large its errors are. Most limits
of the model are multiples of the error, so that a small world is matched like a large one.
"""

from __future__ import annotations

import math

from gpszip.matching.kernels.roads import ModelParameters
from gpszip.model.match import Scales

__all__ = [
    "JUMP_COST",
    "MAX_SPEED_FACTOR",
    "MIN_GAP",
    "backward_tolerance",
    "brisk_speed",
    "min_spacing",
    "model_parameters",
    "search_radius",
]

#: Shortest gap, in seconds, that breaks a route unless another is asked for. Logs of one sample
#: every other minute are matched, too, and most tunnels take less.
MIN_GAP = 120.0

#: Distance, in errors, between samples that make a time step. Two samples of a standing agent
#: differ by less in four cases of five (Newson and Krumm 2009 skip within two).
_MIN_SPACING = 2.5

#: Distance, in errors, within which roads are candidates. The error is that of most time steps;
#: now and then map and receiver err by far more.
_SEARCH_RADIUS = 10.0

#: Nearest positions on roads that a sample has as candidates, each in its open directions.
_MAX_CANDIDATES = 16

#: Length of the longest path that counts as travelled, in straight lines between its samples,
#: unless the median speed allows more.
_MAX_DETOUR = 6.0

#: Cost of leaving the roads, or of a link that the network lacks. It must outweigh the cost of
#: driving along the wrong one of two parallel roads.
JUMP_COST = 30.0

#: Cost of a half turn against going on at a crossing: one crossing in a few.
_TURN_COST = 1.0

#: Cost of turning round where it is allowed: one crossing in a few hundred.
_U_TURN_COST = 5.0

#: Highest speed, as a multiple of the speed that one step in twenty exceeds.
MAX_SPEED_FACTOR = 4.0

#: Distance, in errors, by which a standing agent seems to step back.
_BACKWARD_TOLERANCE = 4.0

#: Distance, in errors, of a step off a crossing and back that errors make.
_MAX_SPUR = 3.0

#: Cost above the best path beyond which paths don't count for the confidence.
_COST_MARGIN = 4.0


def min_spacing(scales: Scales) -> float:
    """Metres between samples that make a time step."""
    return _MIN_SPACING * scales.error


def search_radius(scales: Scales) -> float:
    """Metres within which roads are candidates."""
    return min(_SEARCH_RADIUS * scales.error, scales.reach)


def backward_tolerance(scales: Scales) -> float:
    """Metres by which errors make a standing agent seem to go back."""
    return _BACKWARD_TOLERANCE * scales.error


def brisk_speed(scales: Scales) -> float:
    """Speed in m/s that one step of the log in twenty exceeds."""
    return scales.max_speed / MAX_SPEED_FACTOR


def model_parameters(scales: Scales) -> ModelParameters:
    """Derive the parameters that the kernels take.

    A sample off the roads costs as much as one at the search radius.
    """
    # Metres from a sample within which roads are candidates; emission costs grow with its square.
    radius = search_radius(scales)
    return ModelParameters(
        # Emission.
        sigma=scales.sigma,
        search_radius=radius,
        max_candidates=_MAX_CANDIDATES,
        off_road_cost=0.5 * (radius / scales.sigma) ** 2,
        heading_weight=1.0 / math.radians(scales.heading) ** 2,
        # Transition.
        beta=scales.beta,
        jump_cost=JUMP_COST,
        turn_cost=_TURN_COST,
        u_turn_cost=_U_TURN_COST,
        backward_tolerance=_BACKWARD_TOLERANCE * scales.error,
        # Limits of the search.
        max_speed=scales.max_speed,
        median_speed=scales.median_speed,
        max_detour=_MAX_DETOUR,
        length_tolerance=radius,
        cost_margin=_COST_MARGIN,
        max_spur=_MAX_SPUR * scales.error,
    )
