"""What has changed on the map of an archive since some time, or from one archive to another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpszip.archive import Archive
from gpszip.errors import OptionError
from gpszip.history.changes.changes import KINDS, Changes, find_changes
from gpszip.history.joint import join_histories
from gpszip.history.traversals import read_history
from gpszip.model.timestamps import Times, format_span, to_seconds

__all__ = ["changes"]


def changes(
    old: Archive,
    new: Archive | None,
    *,
    since: Times | None,
    false_alarms: float,
    threshold: float | None,
    kinds: Sequence[str],
) -> Changes:
    """Find what has changed; see :func:`gpszip.changes`."""
    # Refuse what contradicts itself.
    if (since is None) == (new is None):
        raise OptionError("give either a second archive or a time", remedy="one of both")
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown:
        raise OptionError(f"{unknown[0]!r} is no change", remedy=f"kinds are {', '.join(KINDS)}")

    # Either a second archive or a time parts before from after.
    if new is not None:
        history, after = join_histories(old, new)
    else:
        history = read_history(old)
        boundary = float(to_seconds(since if since is not None else 0.0, name="since"))
        after = history.traversals.enter >= boundary
        span = old.time_range
        if span is not None and not span[0] < boundary < span[1]:
            raise OptionError(
                "since lies outside of the archive's times",
                remedy=f"it has {format_span(*span)}",
            )

    return find_changes(
        history,
        np.asarray(after, np.bool_),
        false_alarms=false_alarms,
        threshold=threshold,
        kinds=kinds,
    )
