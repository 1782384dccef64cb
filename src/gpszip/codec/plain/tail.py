"""The tail's numbers; see :mod:`gpszip.codec.kernels.end_coder`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.end_kinds import MAX_QUOTIENT, NEVER, RARE_TOTAL, SOMETIMES
from gpszip.codec.plain.adaptive import read_bit
from gpszip.codec.plain.range_decoder import RangeDecoder
from gpszip.codec.plain.work import WorkLimit

__all__ = ["PlainTailCoder"]


@dataclass(frozen=True)
class PlainTailCoder:
    """A :class:`gpszip.codec.ends.TailCoder` that decodes.

    Parameters
    ----------
    decoder : RangeDecoder
        After the knots.
    work : WorkLimit
        How much may be done.
    """

    decoder: RangeDecoder
    work: WorkLimit

    def code_uniform(self, value: int, total: int) -> int:  # noqa: ARG002 - a decoder has none
        """Read a number below ``total``, all of which are equally likely; ``value`` is ignored."""
        self.work.spend(1)
        return self.decoder.read_uniform(total)

    def code_rare(self, happens: bool) -> bool:
        """Read whether something with a probability of 1/64 happens; ``happens`` is ignored."""
        happens = self.decoder.find(RARE_TOTAL) == RARE_TOTAL - 1
        self.decoder.take(
            RARE_TOTAL - 1 if happens else 0, 1 if happens else RARE_TOTAL - 1, RARE_TOTAL
        )
        return happens

    def code_offsets(
        self,
        offsets: NDArray[np.int64],
        kinds: NDArray[np.int8],
        counts: NDArray[np.int32],
        levels: int,
    ) -> bool:
        """Read offsets in place, see :func:`gpszip.codec.kernels.end_coder.code_end_offsets`."""
        adapted = counts.tolist()
        for i, kind in enumerate(kinds.tolist()):
            # Whether there is an offset.
            self.work.spend(1)
            offsets[i] = 0
            if kind == NEVER or (kind == SOMETIMES and not read_bit(self.decoder, adapted, 0)):
                continue

            # Quotient and remainder.
            quotient = 0
            while self.code_rare(False):
                quotient += 1
                if quotient > MAX_QUOTIENT:
                    return False
            offsets[i] = quotient * levels + self.decoder.read_uniform(levels)
        return True
