"""Live data: fixes of phones, receivers and robots, kept in a journal and then in archives.

``sources/`` brings fixes from servers, receivers and streams, each behind :class:`FixSource`.
``formats/`` turns their messages into a :class:`Fix`. A :class:`Recorder` screens them, leaves out
repeats, and has them on disk, in a :class:`Journal`, before a sender is told so.

``follow.py`` reads the journal, ``monitor/`` finds events in it, and ``outbox.py`` brings them to
``sinks/``, each behind :class:`EventSink`.
"""

from gpszip.live.events import Event, EventSink
from gpszip.live.fix import Fix, Marks, Unusable
from gpszip.live.journal import Journal
from gpszip.live.notices import Notices
from gpszip.live.recorder import Recorder
from gpszip.live.source import FixSource, Receiver

__all__ = [
    "Event",
    "EventSink",
    "Fix",
    "FixSource",
    "Journal",
    "Marks",
    "Notices",
    "Receiver",
    "Recorder",
    "Unusable",
]
