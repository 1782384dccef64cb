"""Kafka as a source: offsets are committed once what lies before them is on disk.

A consumer group of its own, named by the journal, remembers how far the topic was read.
"""

from __future__ import annotations

import asyncio
import logging
import os
import re
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, tzinfo
from typing import Any

from gpszip.errors import MissingExtraError, OptionError
from gpszip.live.fix import Fix, Unusable
from gpszip.live.formats.text import TextParser
from gpszip.live.formats.values import Context, MessageError, clean_name
from gpszip.live.notices import Notices
from gpszip.live.source import Receiver
from gpszip.live.sources.connection import session_name
from gpszip.live.sources.lines import store_patiently

__all__ = ["KafkaSource", "require_aiokafka", "split_address"]

#: Messages that are taken at once.
_MAX_RECORDS = 2_000

#: Milliseconds to wait for a message.
_POLL_MILLISECONDS = 500

#: Bytes of a message; those with one position have less than 4 kB.
_MAX_MESSAGE_BYTES = 1 << 16

#: Seconds between attempts to reach the brokers, at first and at most; it doubles.
_RETRY_SECONDS = (0.5, 30.0)

#: Addresses of brokers, and the topic behind them, as Kafka allows its name.
_BROKER = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:\d{1,5})?")
_TOPIC = re.compile(r"[\w.-]{1,249}", re.ASCII)

_EXAMPLE = "127.0.0.1:9092/positions"


class KafkaSource:
    """Reads a topic, from its beginning when it is read for the first time.

    Parameters
    ----------
    text : str
        ``HOST:PORT/TOPIC``, or several brokers divided by commas before the topic.
    journal : path
        The journal; names the consumer group.
    name : str
        Agent of messages that name none and have no key; the topic where it is empty.
    notices : Notices
        Is told what happens.
    timezone : tzinfo
        Zone of times without one.

    Raises
    ------
    MissingExtraError
        If aiokafka is not installed.
    OptionError
        If the address can't be used.
    """

    def __init__(
        self,
        text: str,
        journal: str | os.PathLike[str],
        name: str,
        notices: Notices,
        timezone: tzinfo = UTC,
    ) -> None:
        require_aiokafka("--kafka")
        self._brokers, self._topic = split_address(text, "--kafka")
        self._group = session_name(journal)
        self._parser = TextParser(name or self._topic)
        self._notices, self._timezone = notices, timezone
        self._is_away = False

    async def run(self, receiver: Receiver) -> None:
        """Store positions until the task is cancelled."""
        from aiokafka.errors import KafkaError

        pause = _RETRY_SECONDS[0]
        handler = _Reports(self._notices, self._topic)
        with handler:
            while True:
                begin = time.monotonic()
                try:
                    await self._read(receiver)
                except (KafkaError, OSError, TimeoutError) as error:
                    self._note_away(error)
                if time.monotonic() - begin > _RETRY_SECONDS[1]:
                    pause = _RETRY_SECONDS[0]
                await asyncio.sleep(pause)
                pause = min(2 * pause, _RETRY_SECONDS[1])

    async def _read(self, receiver: Receiver) -> None:
        """Read and store until the brokers are gone."""
        from aiokafka import AIOKafkaConsumer

        consumer: Any = AIOKafkaConsumer(
            self._topic,
            bootstrap_servers=self._brokers,
            group_id=self._group,
            client_id=self._group,
            enable_auto_commit=False,
            auto_offset_reset="earliest",
        )
        try:
            await consumer.start()
            if self._is_away:
                self._notices.note("connected again", self._topic)
            self._is_away = False
            while True:
                records = await consumer.getmany(
                    timeout_ms=_POLL_MILLISECONDS, max_records=_MAX_RECORDS
                )
                found = [item for part in records.values() for item in self._parse(part)]
                await store_patiently(receiver, found)
                await self._commit(consumer, records)
        finally:
            await consumer.stop()

    async def _commit(self, consumer: Any, records: Mapping[Any, Sequence[Any]]) -> None:
        """Commit what was stored, unless its partitions were given to another consumer meanwhile.

        Then they are read again, and repeats are left out.
        """
        from aiokafka.errors import CommitFailedError, IllegalStateError, RebalanceInProgressError

        if not records:
            return
        try:
            await consumer.commit({part: each[-1].offset + 1 for part, each in records.items()})
        except (CommitFailedError, IllegalStateError, RebalanceInProgressError):
            event = "offsets not committed, as partitions were moved; they are read again"
            self._notices.note(event, self._topic)

    def _parse(self, records: Sequence[Any]) -> list[Fix | Unusable]:
        """Return the fixes of messages of one partition."""
        found: list[Fix | Unusable] = []
        for record in records:
            context = Context(time.time(), "kafka", _name_of(record.key), self._timezone)
            found += _parse_value(self._parser, record.value, context)
        return found

    def _note_away(self, error: Exception) -> None:
        """Tell once that the brokers can't be reached, until they are back."""
        if not self._is_away:
            event = "brokers can't be reached; will be tried again"
            self._notices.note(event, self._topic, str(error) or type(error).__name__)
        self._is_away = True


def _parse_value(parser: TextParser, value: bytes | None, context: Context) -> list[Fix | Unusable]:
    """Return the fix of a message, which is an object of JSON as standard input has them."""
    if not value:
        return [Unusable(context.agent, "messages without a value left out")]
    if len(value) > _MAX_MESSAGE_BYTES:
        return [Unusable(context.agent, "messages that are too large left out")]
    if value.strip()[:1] != b"{":
        return [Unusable(context.agent, "messages that are no object of JSON left out")]
    return parser.push(value, context)


def _name_of(key: bytes | None) -> str:
    """Return the agent that a key names; an empty text where it names none."""
    try:
        return clean_name((key or b"").decode())
    except (MessageError, UnicodeDecodeError):
        return ""


def split_address(text: str, option: str) -> tuple[list[str], str]:
    """Return the brokers and the topic of an address.

    Raises
    ------
    OptionError
        If it is none.

    Examples
    --------
    >>> split_address("a,b:9093/positions", "--kafka")
    (['a:9092', 'b:9093'], 'positions')
    """
    hosts, _, topic = text.removeprefix("kafka://").rpartition("/")
    brokers = hosts.split(",")
    if not _TOPIC.fullmatch(topic) or not all(map(_BROKER.fullmatch, brokers)):
        raise OptionError(
            f"{option} {text}: is no such address", remedy=f"give one such as {_EXAMPLE}"
        )
    return [host if re.search(r":\d+$", host) else f"{host}:9092" for host in brokers], topic


def require_aiokafka(purpose: str) -> None:
    """Raise MissingExtraError unless aiokafka is installed."""
    try:
        import aiokafka
    except ImportError:
        raise MissingExtraError("kafka", purpose) from None
    del aiokafka


class _Reports(logging.Handler):
    """Tells what aiokafka logs, which would go to standard error otherwise."""

    def __init__(self, notices: Notices, topic: str) -> None:
        super().__init__(logging.WARNING)
        self._notices, self._topic = notices, topic
        self._logger = logging.getLogger("aiokafka")

    def __enter__(self) -> None:
        self._logger.addHandler(self)
        self._propagated, self._logger.propagate = self._logger.propagate, False

    def __exit__(self, *_error: object) -> None:
        self._logger.removeHandler(self)
        self._logger.propagate = self._propagated

    def emit(self, record: logging.LogRecord) -> None:
        """Tell of a problem."""
        self._notices.note(
            "the client of Kafka reports a problem", self._topic, record.getMessage()
        )
