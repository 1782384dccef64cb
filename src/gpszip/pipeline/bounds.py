"""Error bounds: what the user asked for, what was reached, and what an archive states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpszip.model import Options, Track
from gpszip.model.error_bound import ErrorBound, rounded_bound, rounded_bounds

if TYPE_CHECKING:
    from gpszip.walks.error import ErrorSummary

__all__ = [
    "describe_bound",
    "excess",
    "holds",
    "requested_bound",
    "size_in_bytes",
    "stated_bound",
    "with_bound",
]

#: Maximum error as a multiple of the RMSE where the user gives no bound. An RMSE alone says
#: nothing about the worst sample.
_MAX_ERROR_PER_RMSE = 4.0

#: RMSE that is estimated for a log that is kept exactly, too, as a multiple of the one otherwise.
#: Walks and log together then take fewer bytes; the log itself tells where its worst samples are.
_EXACT_FACTOR = 2.0

#: Relative excess up to which a bound counts as held: the rounding of the measurement itself.
_ROUNDING = 1e-9


def with_bound(
    options: Options,
    tracks: Sequence[Track],
    gaps: Sequence[NDArray[np.bool_]],
    source: str,
    *,
    exact: bool = False,
) -> tuple[Options, tuple[str, ...]]:
    """Add a bound estimated from the log where the user gave neither a bound, a size, k nor m.

    Parameters
    ----------
    options : Options
        What the user asked for.
    tracks, gaps : sequences of Track and of bool array
        The log, or a subsample of it.
    source : str
        What the tracks are, for the note: ``"the log"``.
    exact : bool, default False
        Whether the log is kept exactly, too: then the RMSE is :data:`_EXACT_FACTOR` times as large,
        and there is no maximum.

    Returns
    -------
    Options
        With RMSE and maximum, if they were missing.
    tuple of str
        A note on the estimate, or nothing.
    """
    from gpszip.mapping.noise import suggest_rmse

    if options.bounded or options.sized or options.thesis:
        return options, ()

    # Beside the log itself, a larger RMSE takes the fewest bytes.
    rmse = suggest_rmse(tracks, gaps)
    if exact:
        rmse *= _EXACT_FACTOR
        note = (
            f"no bound was given: RMSE {rmse:g} m was estimated from {source}, "
            f"{_EXACT_FACTOR:g} times as much as without --lossless"
        )
        return replace(options, rmse=rmse), (note,)

    # Otherwise, a maximum limits the worst sample, too.
    maximum = _MAX_ERROR_PER_RMSE * rmse
    note = (
        f"no bound was given: RMSE {rmse:g} m and maximum {maximum:g} m "
        f"were estimated from {source}"
    )
    return replace(options, rmse=rmse, max_error=maximum), (note,)


def size_in_bytes(options: Options, log_bytes: int) -> Options:
    """Turn a compression ratio into a size in bytes; other options stay as they are."""
    if options.ratio is None:
        return options
    return replace(options, ratio=None, size=max(int(log_bytes / options.ratio), 1))


def holds(errors: ErrorSummary, options: Options) -> bool:
    """Whether the errors measured are within the bound, and every sample has a position."""
    return excess(errors, options) <= 1 + _ROUNDING


def excess(errors: ErrorSummary, options: Options) -> float:
    """Error reached as a multiple of the bound: 0 without a bound, infinite without a position."""
    if errors.uncovered:
        return math.inf
    rmse = errors.rmse / options.rmse if options.rmse is not None else 0.0
    largest = errors.max_error / options.max_error if options.max_error is not None else 0.0
    return max(rmse, largest)


def requested_bound(options: Options) -> ErrorBound | None:
    """The bound of the options as an archive states it."""
    if options.rmse is not None and options.max_error is not None:
        return rounded_bounds(options.rmse, options.max_error)
    metres = options.max_error or options.rmse or 0.0
    return rounded_bound(metres, maximum=options.max_error is not None)


def stated_bound(options: Options, errors: ErrorSummary) -> ErrorBound | None:
    """The bound that an archive states: the one requested, else the RMSE reached.

    None where a requested bound is not held (yet).
    """
    if options.bounded and not holds(errors, options):
        return None
    return (
        requested_bound(options) if options.bounded else rounded_bound(errors.rmse, maximum=False)
    )


def describe_bound(options: Options) -> str:
    """The bound in words, such as ``"RMSE <= 5 m"``; empty where there is none."""
    if options.size is not None:
        return f"size <= {options.size} bytes"
    bounds = {"RMSE": options.rmse, "maximum": options.max_error}
    return ", ".join(
        f"{name} <= {bound:g} m" for name, bound in bounds.items() if bound is not None
    )
