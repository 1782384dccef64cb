"""gpsd as a source: its reports in JSON over TCP."""

from __future__ import annotations

from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.gpsd import GpsdParser
from gpszip.live.formats.values import Context, MessageError, parse_json
from gpszip.live.notices import Notices
from gpszip.live.source import Receiver
from gpszip.live.sources.connection import connected_lines
from gpszip.live.sources.lines import store_lines

__all__ = ["GpsdSource"]

#: What gpsd is asked for: reports of all devices.
_WATCH = b'?WATCH={"enable":true,"json":true}\n'


class GpsdSource:
    """Reads reports of gpsd, and connects again when it was off.

    Parameters
    ----------
    host, port : str and int
        Where gpsd listens; its port is 2947.
    name : str
        Name of the agent; that of the device where it is empty.
    notices : Notices
        Is told when gpsd can't be reached.
    """

    def __init__(self, host: str, port: int, name: str, notices: Notices) -> None:
        self._host, self._port, self._name, self._notices = host, port, name, notices

    async def run(self, receiver: Receiver) -> None:
        """Store fixes until the task is cancelled."""
        lines = connected_lines(
            self._host, self._port, f"gpsd at {self._host}", self._notices, lambda: _WATCH
        )

        def make_context(received: float) -> Context:
            return Context(received, "gpsd", self._name)

        await store_lines(lines, _ReportParser(), receiver, make_context)


class _ReportParser:
    """Turns lines of gpsd into fixes."""

    pending = False

    def __init__(self) -> None:
        self._parser = GpsdParser()

    def push(self, line: bytes, context: Context) -> list[Fix | Unusable]:
        """Return the fix of a line; lines that gpsd had to cut are no JSON."""
        if not line.strip():
            return []
        try:
            report = parse_json(line)
            if not isinstance(report, dict):
                return [Unusable(context.agent, "lines of gpsd that are no report left out")]
            return self._parser.parse(report, context)
        except MessageError as error:
            return [Unusable(context.agent, str(error))]

    def finish(self, _context: Context) -> list[Fix | Unusable]:
        """Return nothing: each line is complete."""
        return []
