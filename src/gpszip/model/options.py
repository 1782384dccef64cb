"""How a log is to be compressed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gpszip.errors import OptionError
from gpszip.model.error_bound import WRITING_SHARE, WRITING_SHARE_IN_METRES

__all__ = ["Options"]


@dataclass(frozen=True)
class Options:
    """How a log is compressed. The defaults suit a first look.

    Parameters
    ----------
    rmse : float, optional
        Largest root mean square of all synchronised distances in metres.
    max_error : float, optional
        Largest synchronised distance in metres. May be given together with ``rmse``.
    size : int, optional
        Largest number of bytes of the archive; the smallest RMSE that it allows is found.
    ratio : float, optional
        Minimum compression ratio against the log. A size or a ratio excludes all other bounds.
        Without any bound, an RMSE is estimated from the log, and a maximum of four times that.
    gap : float, optional
        Intervals longer than this, in seconds, are gaps; ``math.inf`` for none. Estimated from the
        log by default.
    k, m : int, optional
        Parts and segments of the thesis's model (Algorithm 1), which is used where either is given.
        The other is searched: with a bound as the smallest that holds it, else m as in Algorithm 3.
    times : bool
        Keep the time of every knot.
    keep : tuple of str
        Attributes of the tracks to keep exactly, with the times of the samples.
    keep_times : bool
        Keep the times of the samples exactly, also without attributes.
    layer : {None, "bz2"}
        ``"bz2"`` packs the archive once more, as the thesis did.
    effort : int
        From 1, quick, to 9, small.
    curves : tuple of (str, float)
        Attributes of the tracks to keep as curves over time, each with its largest error at any
        sample.
    heights : bool
        Keep the attribute ``ele`` within 3 m, too, where tracks on the earth have it, unless a size
        is asked for.
    coreset : int, optional
        Learn from the weighted points of a coreset of this many blocks instead of all samples. The
        bound is measured at all samples.

    Raises
    ------
    OptionError
        If two options contradict each other or one is out of range.

    Examples
    --------
    >>> Options(rmse=5.0).effort
    5
    >>> Options(rmse=5.0, size=900)
    Traceback (most recent call last):
    gpszip.errors.OptionError: rmse and size were both given; give one
    """

    rmse: float | None = None
    max_error: float | None = None
    size: int | None = None
    ratio: float | None = None
    gap: float | None = None
    k: int | None = None
    m: int | None = None
    times: bool = True
    keep: tuple[str, ...] = ()
    keep_times: bool = False
    layer: str | None = None
    effort: int = 5
    coreset: int | None = None
    curves: tuple[tuple[str, float], ...] = ()
    heights: bool = False

    def tightened(self, share: float) -> Options:
        """Return the options with the bound on the error multiplied by ``share``.

        Examples
        --------
        >>> Options(rmse=5.0).tightened(0.9).rmse
        4.5
        """
        # A bound that is not given stays open.
        rmse, max_error = (
            None if bound is None else share * bound for bound in (self.rmse, self.max_error)
        )
        return replace(self, rmse=rmse, max_error=max_error)

    def aim(self, *, geographic: bool) -> Options:
        """Return the options with a smaller bound, so that files written from the archive hold it.

        A file rounds numbers, and its lines are straight in degrees: see
        :func:`gpszip.model.error_bound.writing_error`.
        """
        return self.tightened(1 - (WRITING_SHARE if geographic else WRITING_SHARE_IN_METRES))

    @property
    def bounded(self) -> bool:
        """Whether the user bounds the error."""
        return self.rmse is not None or self.max_error is not None

    @property
    def sized(self) -> bool:
        """Whether the user bounds the size."""
        return self.size is not None or self.ratio is not None

    @property
    def thesis(self) -> bool:
        """Whether the thesis's model of independent segments is used."""
        return self.k is not None or self.m is not None

    def __post_init__(self) -> None:
        # Refuse mistakes here, before a log is read, for all callers alike.
        _check_bounds(self)
        _check_thesis(self)
        # ``not gap > 0`` refuses NaN as well, which ``gap <= 0`` would accept.
        if self.gap is not None and not self.gap > 0:
            raise OptionError(
                f"gap is {self.gap:g}; "
                "it must be a positive number of seconds, or infinite for no gaps"
            )
        # Kept columns are stored with the exact times of the samples.
        _check_curves(self)
        if not self.times and (self.keep or self.keep_times or self.curves):
            raise OptionError("columns can't be kept without times; leave out either")
        if self.layer not in {None, "bz2"}:
            raise OptionError(f"layer is {self.layer!r}; the only layer is 'bz2'")
        if not 1 <= self.effort <= 9:
            raise OptionError(f"effort is {self.effort}; it goes from 1 to 9")
        if self.coreset is not None and self.coreset < 1:
            raise OptionError(f"coreset is {self.coreset}; it has at least 1 block")


def _check_curves(options: Options) -> None:
    names = [*options.keep, *(name for name, _ in options.curves)]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise OptionError(f"column {twice!r} is kept twice", remedy="give one bound, or none")
    for name, bound in options.curves:
        if not 0 < bound < math.inf:
            raise OptionError(
                f"column {name!r} is kept within {bound:g}; it must be a positive number"
            )


def _check_bounds(options: Options) -> None:
    # Only an RMSE and a maximum go together.
    bounds = {
        "rmse": options.rmse,
        "max_error": options.max_error,
        "size": options.size,
        "ratio": options.ratio,
    }
    # The order of the dictionary is that of the names in the message.
    given = [name for name, value in bounds.items() if value is not None]
    if len(given) > 1 and given != ["rmse", "max_error"]:
        raise OptionError(f"{given[0]} and {given[-1]} were both given; give one")

    # Ranges.
    kinds = {"size": "number of bytes", "ratio": "number"}
    for name, value in bounds.items():
        if value is not None and not 0 < value < math.inf:
            raise OptionError(
                f"{name} is {value:g}; it must be a positive {kinds.get(name, 'number of metres')}"
            )

    # The thesis's model can't aim at a size.
    if options.sized and options.thesis:
        raise OptionError(f"{given[0]} can't be given with k or m; give rmse or max_error")


def _check_thesis(options: Options) -> None:
    k, m = options.k, options.m
    if k is not None and k < 1:
        raise OptionError(f"k is {k}; a track has at least 1 part")
    if m is not None and m < 1:
        raise OptionError(f"m is {m}; a map has at least 1 segment")
    if k is not None and m is not None and m > k:
        raise OptionError(f"m is {m}; there can't be more segments than parts, and k is {k}")
    # Without k, the smallest k that holds a bound is searched, so there must be one.
    if m is not None and k is None and not options.bounded:
        raise OptionError("m was given alone; give k, or a bound from which k is found")
