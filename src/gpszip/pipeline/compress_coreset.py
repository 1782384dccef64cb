"""An archive of a log of which only the coreset is at hand (thesis, section 2.4).

Map and walks are learned from samples that stand for the blocks. Walks are polylines over time,
whose cost at the samples of the log a coreset bounds strictly: the archive states an RMSE that
holds at samples that nobody has any more.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

from gpszip.archive import Archive, with_error_bound
from gpszip.errors import BoundError, OptionError
from gpszip.model import Listener, Options, Report
from gpszip.model.error_bound import rounded_bound
from gpszip.pipeline.compress import compress
from gpszip.run.executor import Executor
from gpszip.sketches.coreset import Coreset, Cost
from gpszip.sketches.kernels.blocks import WEIGHT
from gpszip.sketches.pieces import polyline
from gpszip.sketches.stand_ins import stand_ins
from gpszip.sketches.stream import CoresetStream

__all__ = ["compress_coreset", "cost_of_walks"]

#: Samples that stand for a block.
_STAND_INS = 8

#: Targets that are tried: breaks inside of blocks widen the bounds of the cost.
_MAX_TRIES = 6

#: Where a target was missed, the next one lies this much below what should do.
_TIGHTENING = 0.99


def compress_coreset(
    coreset: Coreset | CoresetStream,
    options: Options,
    *,
    executor: Executor | None = None,
    progress: Listener | None = None,
) -> tuple[Archive, Report]:
    """Learn map and walks from a coreset.

    Parameters
    ----------
    coreset : Coreset or CoresetStream
        The stream stays as it is, and can go on.
    options : Options
        With an RMSE, which the walks hold at all samples of the log; or with k and m.
    executor : Executor, optional
        Spreads the work.
    progress : callable, optional
        Called with events.

    Returns
    -------
    Archive
        It states the RMSE that was asked for, else the least that the coreset guarantees.
    Report
        Its RMSE is the most that the coreset allows; the largest error is not known (infinite).

    Raises
    ------
    OptionError
        If options need the samples, such as a maximum error.
    BoundError
        If the coreset can't guarantee the RMSE.

    Examples
    --------
    >>> from gpszip import Track, coreset
    >>> lane = Track("lane", range(90), [[abs(t % 30 - 15.0)] for t in range(90)])
    >>> archive, report = compress_coreset(coreset(lane, size=9), Options(rmse=0.5))
    >>> report.points, report.rmse <= 0.5, archive.error_bound.metres
    (90, True, 0.5)
    """
    # What the blocks alone have of the RMSE is lost for the walks.
    start = time.perf_counter()
    blocks = coreset.coreset() if isinstance(coreset, CoresetStream) else coreset
    _check_options(options)
    weight = float(blocks.rows[:, WEIGHT].sum())
    target = options
    if options.rmse is not None:
        left = options.rmse**2 - float(blocks.free_costs.sum()) / weight
        if left <= 0:
            raise _too_few_blocks_error(blocks, options.rmse)
        target = replace(options, rmse=math.sqrt(left))

    # Learn from samples that stand for the blocks, until the coreset guarantees the RMSE.
    tracks = stand_ins(blocks, _STAND_INS).tracks
    for _ in range(_MAX_TRIES):
        own = replace(target, gap=math.inf, heights=False)
        archive, report = compress(tracks, own, executor=executor, progress=progress)
        cost = cost_of_walks(archive, blocks)
        most = math.sqrt(cost.upper / weight)
        if options.rmse is None or most <= options.rmse:
            report = replace(
                report,
                points=blocks.samples,
                rmse=most,
                max_error=math.inf,
                seconds=time.perf_counter() - start,
                bound="" if options.rmse is None else f"RMSE {options.rmse:g} m",
                notes=(*report.notes, _guarantee(math.sqrt(max(cost.lower, 0.0) / weight), most)),
            )
            stated = most if options.rmse is None else options.rmse
            return with_error_bound(archive, rounded_bound(stated, maximum=False)), report
        target = target.tightened(_TIGHTENING * options.rmse / most)
    assert options.rmse is not None
    raise _too_few_blocks_error(blocks, options.rmse)


def cost_of_walks(archive: Archive, coreset: Coreset) -> Cost:
    """Estimate and strict bounds of the squared errors of walks at the samples of a log.

    Parameters
    ----------
    archive : Archive
        With the tracks of the coreset.
    coreset : Coreset
        Of the log.

    Returns
    -------
    Cost
        In square metres.
    """
    nodes = archive.road_map.nodes
    estimate, lower, upper = 0.0, 0.0, 0.0
    for name in coreset.tracks:
        walk = archive.walk(name)
        assert walk.times is not None
        cost = coreset.cost(polyline(walk.times, nodes[walk.nodes]), track=name)
        estimate, lower, upper = (
            estimate + cost.estimate,
            lower + cost.lower,
            upper + cost.upper,
        )
    return Cost(estimate, lower, upper)


def _check_options(options: Options) -> None:
    """Refuse what needs the samples."""
    # What a user may ask for that only samples tell.
    needs = {
        "a maximum error": options.max_error is not None,
        "a size": options.sized,
        "gaps": options.gap is not None,
        "a coreset of another size": options.coreset is not None,
        "columns": bool(options.keep or options.keep_times or options.curves),
        "an archive without times": not options.times,
    }
    for what, is_asked in needs.items():
        if is_asked:
            raise OptionError(
                f"{what} can't be had from a coreset, which has no samples",
                remedy="ask for an RMSE alone, or give the log itself",
            )

    # What there has to be.
    if options.rmse is None and not (options.k is not None and options.m is not None):
        raise OptionError(
            "an archive of a coreset needs an RMSE, or k and m", remedy="give the RMSE"
        )


def _too_few_blocks_error(coreset: Coreset, rmse: float) -> BoundError:
    return BoundError(
        f"the coreset can't guarantee an RMSE of {rmse:g} m: its blocks alone have "
        f"{coreset.rmse:.3g} m",
        remedy="make it of more blocks, allow a larger error, or give the log",
    )


def _guarantee(least: float, most: float) -> str:
    return (
        f"learned from a coreset: at the samples of the log, the RMSE is between {least:.3g} m and "
        f"{most:.3g} m"
    )
