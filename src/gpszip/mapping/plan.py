"""Parameters of one search for a map."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

__all__ = ["LOCAL_MAX_ERROR_AIM", "MAX_ERROR_AIM", "RMSE_AIM", "Plan", "is_dense"]

#: Share of an RMSE allowed that a search targets, with a margin for rounding.
RMSE_AIM = 0.9995

#: Share of a maximum allowed that a search targets, with a margin for rounding.
MAX_ERROR_AIM = 0.999

#: The same for a local search, which measures each sample.
LOCAL_MAX_ERROR_AIM = 1 - 1e-6

#: Samples for each slot from which on a log is dense.
_DENSE_SAMPLES = 4

#: Samples below which all rounds together take less than .1 s: few rounds would save nothing.
_MIN_DENSE_LOG = 20_000

#: Rounds on a dense log where speed counts: of a patrol of a million samples, 12 took 0.3 % less.
_FEW_ROUNDS = 3
#: Rounds after which any walks within the target do on such a log.
_ENOUGH_ROUNDS = 5
#: Rounds along segments that keep the maximum.
_FEW_MAX_ERROR_ROUNDS = 3
#: The beam on such a log.
_NARROW_BEAM = 6.0


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
    enough_rounds : int, optional
        Rounds after which any outcome within the target ends the extra rounds.
    give_up_ratio : float, default infinity
        Give up where the error is more than this many times the target, and hardly falls although
        its price rises.
    beam : float, default infinity
        Bits beyond the cheapest node of a slot above which another node is left out.
    encode_alternate_rounds : bool, default False
        Encode the walks only every other round before the last few, concurrently with the next
        round. Prices then lag behind by one round.
    many_knots : int, optional
        Knots from which on an outcome that uses up the error ends the rounds before their number is
        reached.
    tolerance : float, default 1
        Error, in targets, up to which an outcome counts. Above 1, outcomes are compared by the
        sizes that they would have at the target.
    maximum : float, optional
        Largest distance of any sample, in grid steps, to aim for instead; ``target`` is then the
        error of the first walks.
    max_error_rounds : int, default 4
        Rounds at last in which knots are assigned along segments that keep the maximum.
    limits_all : bool, default True
        Limit the distance of all samples in these rounds; else only of those farthest out between
        two slots, and of others once they miss the maximum.
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
    enough_rounds: int | None = None
    give_up_ratio: float = np.inf
    beam: float = np.inf
    encode_alternate_rounds: bool = False
    many_knots: int | None = None
    tolerance: float = 1.0
    maximum: float | None = None
    max_error_rounds: int = 4
    limits_all: bool = True
    window: int = 24
    slots_per_knot: float = np.inf
    dense_rounds: int = 5
    max_slots: int = 300
    reach: float = 3.0

    def hurried(self) -> Plan:
        """Return the plan for a dense log where speed counts: the walks of few rounds do."""
        return replace(
            self,
            rounds=min(self.rounds, _FEW_ROUNDS),
            extra_rounds=self.rounds + self.extra_rounds - min(self.rounds, _FEW_ROUNDS),
            enough_rounds=_ENOUGH_ROUNDS,
            max_error_rounds=min(self.max_error_rounds, _FEW_MAX_ERROR_ROUNDS),
            beam=min(self.beam, _NARROW_BEAM),
            limits_all=False,
        )


def is_dense(samples: int, slots: int) -> bool:
    """Whether a log is large and has several samples for each slot of its time grid."""
    return samples >= max(_DENSE_SAMPLES * slots, _MIN_DENSE_LOG)
