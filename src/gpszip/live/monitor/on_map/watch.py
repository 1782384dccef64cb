"""What all agents together tell of the map."""

from __future__ import annotations

from typing import Any

from gpszip.live.events import Event
from gpszip.live.monitor.on_map.closures import ClosureWatch
from gpszip.live.monitor.on_map.known_map import KnownMap
from gpszip.live.monitor.on_map.new_edges import NewEdges
from gpszip.live.monitor.on_map.tracker import MapTracker

__all__ = ["MapWatch"]


class MapWatch:
    """Watches for edges that are closed, and for new ones.

    Parameters
    ----------
    known_map : KnownMap
        The map.
    """

    def __init__(self, known_map: KnownMap) -> None:
        self.closures = ClosureWatch(known_map)
        self._new_edges = NewEdges(known_map)

    def take(self, agent: str, tracker: MapTracker, received: float) -> list[Event]:
        """Take what an agent has travelled since; return the events that follow."""
        events = self.closures.take(agent, *tracker.passes.take(), received)
        return events + self._new_edges.take(agent, *tracker.paths.take(), received)

    def forget(self, agent: str) -> None:
        """Note that an agent begins anew; what it travelled stays."""
        self.closures.forget(agent)
        self._new_edges.forget(agent)

    def to_row(self) -> dict[str, Any]:
        """Return the state as a value of JSON."""
        return {"closures": self.closures.to_row(), "new_edges": self._new_edges.to_row()}

    def restore(self, row: dict[str, Any]) -> None:
        """Take over what :meth:`to_row` returned."""
        self.closures.restore(row["closures"])
        self._new_edges.restore(row["new_edges"])
