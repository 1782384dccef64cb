"""The tail's numbers over the compiled range coder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpszip.codec.end_kinds import RARE_TOTAL
from gpszip.codec.kernels.end_coder import code_end_offsets
from gpszip.codec.kernels.range_coder import (
    DECODES,
    DIRECTION,
    Coder,
    code_interval,
    decode_cumulative,
)

__all__ = ["CompiledTailCoder"]


@dataclass(frozen=True)
class CompiledTailCoder:
    """A :class:`gpszip.codec.ends.TailCoder` in the direction of its coder.

    Parameters
    ----------
    coder : Coder
        In any direction.
    """

    coder: Coder

    def code_uniform(self, value: int, total: int) -> int:
        """Code a number below ``total``, all of which are equally likely."""
        # A decoder finds the number; then both directions take the same interval, so they can't
        # differ.
        if self._is_decoding():
            value = int(decode_cumulative(self.coder, total))
        code_interval(self.coder, value, 1, total)
        return value

    def code_rare(self, happens: bool) -> bool:
        """Code whether something happens that has a probability of 1/64."""
        if self._is_decoding():
            happens = int(decode_cumulative(self.coder, RARE_TOTAL)) == RARE_TOTAL - 1
        # The last of 64 numbers stands for what is rare, all others for what is not.
        if happens:
            code_interval(self.coder, RARE_TOTAL - 1, 1, RARE_TOTAL)
        else:
            code_interval(self.coder, 0, RARE_TOTAL - 1, RARE_TOTAL)
        return happens

    def code_offsets(
        self,
        offsets: NDArray[np.int64],
        kinds: NDArray[np.int8],
        counts: NDArray[np.int32],
        levels: int,
    ) -> bool:
        """Code offsets in place, see :func:`gpszip.codec.kernels.end_coder.code_end_offsets`."""
        return bool(code_end_offsets(self.coder, offsets, kinds, counts, levels))

    def _is_decoding(self) -> bool:
        """Whether the coder reads.

        The kernel of this name is built into its callers; called from here, it would be compiled.
        """
        return bool(self.coder.cursor[DIRECTION] == DECODES)
