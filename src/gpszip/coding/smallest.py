"""Walks in the fewest bytes: coded in each mode that may pay, of which the smallest is kept."""

from __future__ import annotations

import numpy as np

from gpszip.coding.past import Past
from gpszip.coding.walks import MOST_SORTED, encode_in_modes
from gpszip.kernels.walk_model import AIMS, KIND_BITS, PACED, SORTED
from gpszip.model import LatticeWalks

__all__ = ["encode_smallest"]

#: Aims are tried for walks of at most so many knots: the searches for them take a tenth of a second for each thousand or two.
_MOST_AIMING = 1 << 15

#: Kinds of steps whose ways an aim may spare.
_BACK, _KNOWN, _NEW = 0, 1, 3


def encode_smallest(walks: LatticeWalks, past: Past | None = None) -> bytes:
    """Code walks as :func:`gpszip.coding.walks.encode` does, but in the modes that take the fewest bytes.

    Each mode is tried by itself, and those that pay together once more: at most four times the work of coding once, and that of the
    searches for aims.

    Examples
    --------
    >>> import numpy as np
    >>> from gpszip.coding.walks import decode
    >>> from gpszip.model import LatticeWalk
    >>> walk = LatticeWalk(np.array([0, 1, 0], np.int32), np.array([0, 9, 18]), np.zeros(2, bool))
    >>> data = encode_smallest(LatticeWalks(np.array([[0, 0], [30, 4]]), (walk,)))
    >>> decode(data, dimension=2, tracks=1).walks[0].cells.tolist()
    [0, 9, 18]
    """
    spent = np.zeros(sum(len(walk.nodes) for walk in walks.walks))
    best, model = encode_in_modes(walks, past, 0, spent)
    steps = model.ledger[KIND_BITS : KIND_BITS + 5, 1]
    tries = [
        (SORTED, walks.timed and 2 < len(walks.walks) <= MOST_SORTED),
        (PACED, walks.timed and walks.nodes.shape[1] > 1 and steps[_NEW] > 1),
        (AIMS, steps[_BACK] + steps[_KNOWN] > 1 and len(spent) <= _MOST_AIMING),
    ]
    plain, paying = len(best), []
    for mode, worth in tries:
        data = encode_in_modes(walks, past, mode, spent)[0] if worth else best
        if len(data) < plain:
            paying.append(mode)
        best = min(best, data, key=len)
    if len(paying) > 1:
        best = min(best, encode_in_modes(walks, past, int(sum(paying)), spent)[0], key=len)
    return best
