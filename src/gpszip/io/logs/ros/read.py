"""Reader of bags of ROS 1 and ROS 2 and of MCAP files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gpszip.errors import NoPositionsError
from gpszip.io.logs.log_format import CoordinateKind, LogBatches
from gpszip.io.logs.raw import RawLog, Request, join_batches
from gpszip.io.logs.ros.bags import Bag, kind_of, named_faults, open_bag
from gpszip.io.logs.ros.frames import FrameReader, transform_topics
from gpszip.io.logs.ros.topics import TopicReader, choose_topics
from gpszip.io.storage.source import Source
from gpszip.model.text import count_phrase

__all__ = ["read_ros", "read_ros_batches"]


def read_ros(source: Source, request: Request) -> RawLog:
    """Read the positions of topics, or of a frame in another, from a bag.

    Parameters
    ----------
    source : Source
        A ``.bag``, ``.db3`` or ``.mcap``, or ``metadata.yaml`` of a folder.
    request : Request
        Topics, or frames; attributes (``qx``, ``qy``, ``qz``, ``qw``; of positions on the globe
        ``alt``), and whether headings are kept.

    Raises
    ------
    InputError
        If the bag is damaged, it isn't clear which topic is meant, or frames are not connected.
    MissingExtraError
        If the extra ``ros`` isn't installed.
    """
    return _join(list(_read(source, request)))


def read_ros_batches(source: Source, request: Request) -> LogBatches:
    """Open a bag to be read in batches; see :func:`read_ros`."""
    kind = kind_of(source)
    with open_bag(source) as bag, named_faults(source.name, kind):
        reader, count = _make_reader(bag, source, request)
    is_geographic = isinstance(reader, TopicReader) and reader.geographic
    return LogBatches(
        _read(source, request),
        CoordinateKind(is_geographic, 2 if is_geographic else 3),
        count_rows=lambda: count,
    )


def _make_reader(
    bag: Bag, source: Source, request: Request
) -> tuple[TopicReader | FrameReader, int]:
    """Return the reader of topics or frames, and the number of messages that it reads."""
    if request.frame is not None:
        topics = transform_topics(bag, request, source.name)
        return FrameReader(source.name, topics, request), sum(topic.messages for topic in topics)
    topics = choose_topics(bag, request, source.name)
    return TopicReader(source.name, topics, request), sum(topic.messages for topic in topics)


def _read(source: Source, request: Request) -> Iterator[RawLog]:
    """Yield the poses of a bag, which is open meanwhile."""
    kind = kind_of(source)
    with open_bag(source) as bag:
        reader, _ = _make_reader(bag, source, request)
        batches = reader.read(bag)
        while True:
            # What goes wrong in the caller is no fault of the file.
            with named_faults(source.name, kind):
                batch = next(batches, None)
            if batch is None:
                return
            yield batch


def _join(logs: Sequence[RawLog]) -> RawLog:
    """Join the batches of a log."""
    # Without a pose, what was dropped says why.
    if not logs or not any(len(log.times) for log in logs):
        name = logs[0].name if logs else ""
        counts = [count_phrase(item.count, item.what) for log in logs for item in log.repairs]
        why = f": {', '.join(counts)}" if counts else ""
        raise NoPositionsError(
            f"holds no pose{why}", path=name, remedy="choose another --topic, or another bag"
        )
    return join_batches(logs)
