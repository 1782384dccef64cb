"""Sending samples when they are due, over as many connections as there are workers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gpszip.errors import OptionError, OutputError
from gpszip.live.replay.messages import Sample
from gpszip.model import Track

__all__ = ["Played", "Target", "play", "samples_of"]

#: Seconds between attempts to send, at first and at most; it doubles.
_RETRY_SECONDS = (0.2, 2.0)

#: Attempts until a target counts as gone: about two minutes, in which a server may start again.
_MAX_ATTEMPTS = 60

#: Seconds by which samples may be early to go into one message.
_BATCH_SECONDS = 0.5


class Target(Protocol):
    """Where samples are sent to; each worker has its own."""

    #: Samples of a message at most.
    max_samples: int

    def send(self, samples: Sequence[Sample]) -> None:
        """Send samples.

        Raises
        ------
        OSError
            If they did not arrive; they are sent again.
        OutputError
            If they are refused.
        """
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


@dataclass
class Played:
    """What was sent.

    Parameters
    ----------
    samples, messages : int
        Samples, and messages with them.
    repeated : int
        Messages that were sent again, since their answer did not come.
    lag : float
        Seconds by which the latest message was late.
    tell : callable
        Called with a line at the first failure.
    """

    samples: int = 0
    messages: int = 0
    repeated: int = 0
    lag: float = 0.0
    tell: Callable[[str], None] = field(default=lambda _line: None, repr=False)
    _is_told: bool = field(default=False, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def note_failure(self, error: OSError) -> None:
        """Tell of the first failure; others are counted as messages sent again."""
        with self._lock:
            is_told, self._is_told = self._is_told, True
        if not is_told:
            self.tell(f"{error}; trying again")

    def add(self, samples: int, attempts: int, lag: float) -> None:
        """Count a message."""
        with self._lock:
            self.samples += samples
            self.messages += 1
            self.repeated += attempts - 1
            self.lag = max(self.lag, lag)


def samples_of(tracks: Sequence[Track]) -> list[Sample]:
    """Return the samples of tracks in degrees, in the order of time.

    Raises
    ------
    OptionError
        If a track has no times or is not in degrees.
    """
    for track in tracks:
        if not track.timed:
            raise OptionError(f"track {track.id!r} has no times", remedy="replay a log with times")
        if track.plane is None:
            raise OptionError(
                f"track {track.id!r} is not in latitude and longitude, which apps send",
                remedy="pipe it into gpszip listen as it is",
            )
    if not tracks:
        return []

    # Samples of one time stay in the order of their tracks.
    coordinates = np.concatenate([track.coordinates[:, :2] for track in tracks])
    times = np.concatenate([track.times for track in tracks])
    names = [track.id for track in tracks for _ in range(len(track))]
    order = np.argsort(times, kind="stable").tolist()
    rows = zip(times.tolist(), coordinates.tolist(), strict=True)
    samples = [Sample(name, when, *at) for name, (when, at) in zip(names, rows, strict=True)]
    return [samples[number] for number in order]


def play(
    samples: Sequence[Sample],
    open_target: Callable[[], Target],
    speed: float,
    workers: int = 1,
    tell: Callable[[str], None] = lambda _line: None,
) -> Played:
    """Send samples when they are due.

    Parameters
    ----------
    samples : sequence of Sample
        In the order of time.
    open_target : callable
        Opens a connection for a worker.
    speed : float
        Seconds of the log in a second; infinite to send all at once.
    workers : int
        Connections. Samples of one track go over one of them, in their order.
    tell : callable, optional
        Called with a line when the target can't be reached for the first time.

    Raises
    ------
    OutputError
        If the target refuses samples, or is gone for long.
    """
    # Divide the tracks among the workers.
    played = Played(tell=tell)
    tracks = list(dict.fromkeys(sample.track for sample in samples))
    workers = max(min(workers, len(tracks)), 1)
    worker_of = {name: number % workers for number, name in enumerate(tracks)}
    parts = [[each for each in samples if worker_of[each.track] == n] for n in range(workers)]

    # All have the same clock, and end when one fails.
    begin = time.monotonic()
    failures: list[BaseException] = []
    stop = threading.Event()

    def work(part: Sequence[Sample]) -> None:
        try:
            _play_part(part, open_target, samples[0].time, speed, begin, stop, played)
        except BaseException as error:
            failures.append(error)
            stop.set()

    threads = [threading.Thread(target=work, args=(part,), daemon=True) for part in parts if part]
    for thread in threads:
        thread.start()
    try:
        for thread in threads:
            thread.join()
    finally:
        stop.set()
    if failures:
        raise failures[0]
    return played


def _play_part(
    samples: Sequence[Sample],
    open_target: Callable[[], Target],
    zero: float,
    speed: float,
    begin: float,
    stop: threading.Event,
    played: Played,
) -> None:
    """Send the samples of one worker."""
    try:
        target = open_target()
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(f"can't be opened: {reason}", remedy="check --to") from error
    try:
        for batch in _batches(samples, target.max_samples, speed):
            due = begin + (batch[-1].time - zero) / speed
            if stop.wait(max(due - time.monotonic(), 0.0)):
                return
            attempts = _send(target, batch, stop, played)
            played.add(len(batch), attempts, time.monotonic() - due if np.isfinite(speed) else 0.0)
    finally:
        target.close()


def _batches(samples: Sequence[Sample], size: int, speed: float) -> Iterator[list[Sample]]:
    """Gather samples that go into one message: those that are due at about the same time."""
    batch: list[Sample] = []
    for sample in samples:
        if batch and (len(batch) == size or (sample.time - batch[0].time) / speed > _BATCH_SECONDS):
            yield batch
            batch = []
        batch.append(sample)
    if batch:
        yield batch


def _send(target: Target, batch: Sequence[Sample], stop: threading.Event, played: Played) -> int:
    """Send a batch until it arrives; return the number of attempts."""
    pause, longest = _RETRY_SECONDS
    for attempt in range(1, _MAX_ATTEMPTS + 1):
        try:
            target.send(batch)
        except OSError as error:
            if attempt == _MAX_ATTEMPTS or stop.is_set():
                raise OutputError(f"can't be reached: {error}", remedy="check --to") from error
            played.note_failure(error)
            stop.wait(pause)
            pause = min(2 * pause, longest)
        else:
            return attempt
    raise AssertionError
