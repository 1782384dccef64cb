"""What one search for a map is told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Plan"]


@dataclass(frozen=True)
class Plan:
    """How one search for a map goes about it.

    Parameters
    ----------
    target : float
        Root mean square error to reach, in quanta.
    leader_radius : float
        Radius, in targets, within which the first knots are gathered into shared nodes; 0 leaves each its own.
    rounds : int
        Number of rounds of E-step, M-step and merging.
    extra_rounds : int
        Rounds that may follow while the error allowed isn't made use of.
    give_up_ratio : float
        Give up where the error is so many times the target, and hardly falls when the price rises.
    beam : float
        Bits beyond the cheapest node of a slot above which another one isn't looked at.
    encode_alternate_rounds : bool
        Code the walks only every other round before the last few, beside the next round's work: prices lag behind by one.
    maximum : float, optional
        Largest distance of any sample, in quanta, to aim for instead; ``target`` is then the error of the first walks.
    window : int
        Knots that the E-step chooses at once.
    max_slots : int
        Slots that a part may span.
    reach : float
        Radius, in targets, within which a knot may take a node.
    """

    target: float
    leader_radius: float = 1.0
    rounds: int = 12
    extra_rounds: int = 0
    give_up_ratio: float = np.inf
    beam: float = np.inf
    encode_alternate_rounds: bool = False
    maximum: float | None = None
    window: int = 24
    max_slots: int = 300
    reach: float = 3.0
