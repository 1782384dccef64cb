"""Where vehicles and brokers get samples: MAVLink over UDP, and Kafka."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Sequence
from typing import Any

from gpszip.errors import OptionError, OutputError
from gpszip.live.replay.messages import Sample, row_message
from gpszip.live.sources.kafka import require_aiokafka
from gpszip.live.sources.mavlink import require_pymavlink

__all__ = ["KafkaTarget", "MavlinkTarget"]

#: Systems that MAVLink can tell apart, without those of ground stations.
_MAX_SYSTEMS = 240

#: Units of a degree.
_UNITS_PER_DEGREE = 1e7

#: Seconds for which a system has been on at its first sample.
_BEGAN = 1.0

#: Milliseconds since it began that a system can tell: 49.7 days.
_MAX_SINCE = 2**32 - 1

#: Seconds since 1970 from which times are told as such; earlier ones count from some other zero.
_FIRST_DATE = 1e8

#: Heading that is unknown.
_UNKNOWN = 65_535

#: Samples that are sent to Kafka before it has acknowledged them.
_BATCH = 500


class MavlinkTarget:
    """Sends packets of MAVLink as datagrams; each track is a system.

    Times have milliseconds, positions 1 cm, as MAVLink has them. After 49.7 days, a system begins
    anew.

    Parameters
    ----------
    host, port : str and int
        Who listens.
    tracks : sequence of str
        The tracks; the first one is system 1.
    """

    max_samples = 1

    def __init__(self, host: str, port: int, tracks: Sequence[str]) -> None:
        require_pymavlink("--as mavlink")
        if len(tracks) > _MAX_SYSTEMS:
            raise OptionError(
                f"MAVLink has {_MAX_SYSTEMS} systems, and there are {len(tracks):,} tracks",
                remedy="choose some with --track",
            )
        from pymavlink.dialects.v20 import common

        self._links: dict[str, Any] = {
            track: common.MAVLink(None, number, 1) for number, track in enumerate(tracks, 1)
        }
        self._zeros: dict[str, float] = {}
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._address = found[4]
        self._socket = socket.socket(found[0], found[1])

    def send(self, samples: Sequence[Sample]) -> None:
        """Send a datagram for each sample, with the clock of the system and its position.

        Raises
        ------
        OptionError
            If a time is one that MAVLink can't tell.
        """
        for sample in samples:
            link, since = self._links[sample.track], self._since(sample)
            clock = link.system_time_encode(round(sample.time * 1e6), since)
            position = link.global_position_int_encode(
                since,
                round(sample.latitude * _UNITS_PER_DEGREE),
                round(sample.longitude * _UNITS_PER_DEGREE),
                *(0, 0, 0, 0, 0, _UNKNOWN),
            )
            self._socket.sendto(clock.pack(link) + position.pack(link), self._address)

    def _since(self, sample: Sample) -> int:
        """Milliseconds since the system of a sample began."""
        if sample.time < _FIRST_DATE:
            raise OptionError(
                f"track {sample.track!r}: MAVLink has no times before 1973",
                remedy="choose another kind with --as",
            )
        zero = self._zeros.setdefault(sample.track, sample.time - _BEGAN)
        since = round((sample.time - zero) * 1e3)
        if since <= _MAX_SINCE:
            return since
        self._zeros[sample.track] = sample.time - _BEGAN
        return round(_BEGAN * 1e3)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class KafkaTarget:
    """Writes objects of JSON to a topic of Kafka; their key is the track.

    Parameters
    ----------
    brokers : sequence of str
        Addresses of brokers.
    topic : str
        The topic.
    """

    max_samples = _BATCH

    def __init__(self, brokers: Sequence[str], topic: str) -> None:
        require_aiokafka("--as kafka")
        from aiokafka.errors import KafkaError

        self._brokers, self._topic = list(brokers), topic
        self._loop = asyncio.new_event_loop()
        try:
            self._producer = self._loop.run_until_complete(self._open())
        except KafkaError as error:
            self._loop.close()
            raise OutputError(f"can't be reached: {error}", remedy="check --to") from error

    async def _open(self) -> Any:
        from aiokafka import AIOKafkaProducer

        producer = AIOKafkaProducer(bootstrap_servers=self._brokers, enable_idempotence=False)
        try:
            await producer.start()
        except BaseException:
            await producer.stop()
            raise
        return producer

    def send(self, samples: Sequence[Sample]) -> None:
        """Send samples, and wait until the broker has them."""
        from aiokafka.errors import KafkaError

        async def send_all() -> None:
            sent = [
                await self._producer.send(
                    self._topic, row_message(sample), key=sample.track.encode()
                )
                for sample in samples
            ]
            await asyncio.gather(*sent)

        try:
            self._loop.run_until_complete(send_all())
        except KafkaError as error:
            raise OSError(str(error)) from error

    def close(self) -> None:
        """Close the connection."""
        self._loop.run_until_complete(self._producer.stop())
        self._loop.close()
