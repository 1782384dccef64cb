"""Parameters of one search for a map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["LOCAL_MAX_ERROR_AIM", "MAX_ERROR_AIM", "RMSE_AIM", "Plan"]

#: Share of an RMSE allowed that a search targets, with a margin for rounding.
RMSE_AIM = 0.9995

#: Share of a maximum allowed that a search targets, with a margin for rounding.
MAX_ERROR_AIM = 0.999

#: The same for a local search, which measures each sample.
LOCAL_MAX_ERROR_AIM = 1 - 1e-6


@dataclass(frozen=True)
class Plan:
    """Parameters of one search for a map.

    Parameters
    ----------
    target : float
        Root mean square error to reach, in grid steps.
    leader_radius : float, default 1
        Radius, in targets, within which the first knots share a node; 0 gives each its own node.
    rounds : int, default 12
        Rounds of E-step, M-step and merging.
    extra_rounds : int, default 0
        Rounds that may follow while the error allowed is not used up.
    give_up_ratio : float, default infinity
        Give up where the error is more than this many times the target, and hardly falls although
        its price rises.
    beam : float, default infinity
        Bits beyond the cheapest node of a slot above which another node is left out.
    encode_alternate_rounds : bool, default False
        Encode the walks only every other round before the last few, concurrently with the next
        round. Prices then lag behind by one round.
    tolerance : float, default 1
        Error, in targets, up to which an outcome counts. Above 1, outcomes are compared by the
        sizes that they would have at the target.
    maximum : float, optional
        Largest distance of any sample, in grid steps, to aim for instead; ``target`` is then the
        error of the first walks.
    window : int, default 24
        Knots that the E-step chooses at once.
    slots_per_knot : float, default infinity
        Slots that each round offers for a knot, evenly spread, beside those next to knots.
    dense_rounds : int, default 5
        Rounds on all slots after those on the sparse ones.
    max_slots : int, default 300
        Slots that a segment may span.
    reach : float, default 3
        Radius, in targets, within which a knot may take a node.
    """

    target: float
    leader_radius: float = 1.0
    rounds: int = 12
    extra_rounds: int = 0
    give_up_ratio: float = np.inf
    beam: float = np.inf
    encode_alternate_rounds: bool = False
    tolerance: float = 1.0
    maximum: float | None = None
    window: int = 24
    slots_per_knot: float = np.inf
    dense_rounds: int = 5
    max_slots: int = 300
    reach: float = 3.0
