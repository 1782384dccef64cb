"""Messages of the live page: server-sent events whose data is one line of JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

from gpszip.live.events import Event
from gpszip.live.fix import Fix
from gpszip.live.page.board import AgentState

__all__ = ["agents_message", "events_message", "message", "outlooks_message", "tails_message"]

#: Decimals of degrees (1 cm), and of metres, seconds and other numbers.
_DEGREE_DECIMALS = 7
_DECIMALS = 2


def message(kind: str, value: Any, id: str = "") -> bytes:
    r"""Return a message; no text in it can end its line, as JSON in ASCII has no line ends.

    Examples
    --------
    >>> message("state", {"a": "\n\u2028"}, "7")
    b'event: state\nid: 7\ndata: {"a":"\\n\\u2028"}\n\n'
    """
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    head = f"event: {kind}\n" + (f"id: {id}\n" if id else "")
    return f"{head}data: {text}\n\n".encode("ascii")


def agents_message(agents: Iterable[AgentState]) -> bytes:
    """Where agents are: a row each, in which the page looks fields up by their places."""
    return message("agents", [_agent_row(agent.fix, agent.heard) for agent in agents])


def _agent_row(fix: Fix, heard: float) -> list[Any]:
    return [
        fix.agent,
        fix.source,
        round(fix.time, _DECIMALS),
        round(heard, _DECIMALS),
        *_coordinates(fix, fix.position[0], fix.position[1]),
        _rounded(fix.heading),
        _rounded(fix.speed),
        int(fix.geographic),
    ]


def tails_message(agents: Iterable[AgentState]) -> bytes:
    """The ways that agents came: a name, and then time and two coordinates of each point."""
    rows = []
    for agent in agents:
        row: list[Any] = [agent.fix.agent]
        for i in range(0, len(agent.tail), 3):
            seconds, first, second = agent.tail[i : i + 3]
            row += [round(seconds, _DECIMALS), *_coordinates(agent.fix, first, second)]
        rows.append(row)
    return message("tails", rows)


def events_message(numbered: Iterable[tuple[int, Event]], boot: str) -> bytes:
    """Events; the id of the message is the number of the last one, in this run of the listener."""
    pairs = list(numbered)
    return message("events", [_row(event) for _, event in pairs], f"{boot}-{pairs[-1][0]}")


def outlooks_message(agents: Iterable[AgentState]) -> bytes:
    """Where agents go, as it was predicted last."""
    return message("outlooks", [_row(each.outlook) for each in agents if each.outlook is not None])


def _row(event: Event) -> Mapping[str, Any]:
    row: dict[str, Any] = json.loads(event.to_json())
    return row


def _coordinates(fix: Fix, first: float, second: float) -> tuple[float, float]:
    decimals = _DEGREE_DECIMALS if fix.geographic else _DECIMALS
    return round(first, decimals), round(second, decimals)


def _rounded(number: float | None) -> float | None:
    # What a source states may be NaN or infinite.
    return round(number, 1) if number is not None and math.isfinite(number) else None
