"""Routes as users give them: sequences of edges and directions."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from typing import Any

from gpszip.errors import OptionError
from gpszip.model.match import Route

__all__ = ["read_route", "tell_route"]

#: Edges at the end of a route that count; predictions look back no farther.
_LONGEST = 256


def read_route(
    route: Route | Iterable[Any],
    options: Sequence[Sequence[int]],
    edges: int,
    *,
    longest: int = _LONGEST,
) -> list[int]:
    """Directed edges at the end of a route, from its last break on.

    Parameters
    ----------
    route : Route, or iterable of (int, bool)
        Edges, and whether each is travelled from its start to its end. Where one does not go on
        from the one before, what came before is forgotten.
    options : sequence of sequences of int
        Directed edges that may follow each.
    edges : int
        Number of edges of the network.
    longest : int, default 256
        Edges at the end of the route that are read.

    Returns
    -------
    list of int
        ``2 * edge``, plus 1 where it is travelled backward; at least one.

    Raises
    ------
    OptionError
        If the route is empty, or names an edge that does not exist.
    """
    # Take the end of a long route.
    if isinstance(route, Route):
        route = list(zip(route.edges.tolist(), route.forward.tolist(), strict=True))
    elif not isinstance(route, list | tuple):
        route = list(route)
    skipped = max(0, len(route) - longest)
    recent = route[skipped:]
    if not recent:
        raise OptionError("the route is empty", remedy="give the edges travelled so far")

    # Check each edge, but look closely only if something is wrong.
    try:
        directed = [2 * operator.index(edge) + (not forward) for edge, forward in recent]
        is_known = min(directed) >= 0 and max(directed) < 2 * edges
    except (TypeError, ValueError):
        is_known = False
    if not is_known:
        directed = [_directed(each, skipped + i, edges) for i, each in enumerate(recent)]

    # Forget what comes before the last break.
    for number in range(len(directed) - 1, 0, -1):
        if directed[number] not in options[directed[number - 1]]:
            return directed[number:]
    return directed


def _directed(each: Any, number: int, edges: int) -> int:
    """Return one edge of a route as a number; ``number`` counts the edges before it."""
    try:
        edge, forward = operator.index(each[0]), bool(each[1])
    except (TypeError, IndexError, KeyError) as error:
        raise OptionError(
            f"edge {number} of the route is {each!r}",
            remedy="give pairs of an edge and whether it is travelled from its start to its end",
        ) from error
    if not 0 <= edge < edges:
        raise OptionError(
            f"edge {number} of the route is {edge}; the archive has edges 0 to {edges - 1}",
            remedy="name edges as gpszip.match(track, archive) does",
        )
    return 2 * edge + (not forward)


def tell_route(directed: Iterable[int]) -> tuple[tuple[int, bool], ...]:
    """Edges and directions of directed edges.

    Examples
    --------
    >>> tell_route([6, 9])
    ((3, True), (4, False))
    """
    return tuple((each >> 1, not each & 1) for each in directed)
