"""Messages that wait while others are stored."""

import asyncio

import pytest

from gpszip.live import Notices
from gpszip.live.sources import batches, datagrams
from gpszip.live.sources.batches import batches_of
from gpszip.live.sources.datagrams import Datagrams
from live.receiving import run, until


class Source:
    """Messages that are there already, and what then happens."""

    def __init__(self, *messages, end=EOFError):
        self.left, self.end = list(messages), end

    async def read(self):
        if not self.left:
            raise self.end
        return self.left.pop(0)


def test_all_is_yielded_in_its_order_before_the_error():
    async def gather():
        found = []
        with pytest.raises(EOFError):
            async for batch in batches_of(Source(*map(str, range(5_000))).read):
                found += batch
        return found

    assert run(gather()) == list(map(str, range(5_000)))


@pytest.mark.parametrize(("size", "number"), [(10, 2), (1, 5)])
def test_none_is_read_while_too_many_wait(monkeypatch, size, number):
    monkeypatch.setattr(batches, "_MAX_WAITING", 5)
    monkeypatch.setattr(batches, "_MAX_BYTES", 20)

    async def gather():
        source = Source(*["x" * size] * 50)
        parts = batches_of(source.read)
        await anext(parts)
        # While this batch is stored, so many are read and no more.
        await until(lambda: len(source.left) < 50 - number)
        for _ in range(20):
            await asyncio.sleep(0)
        left = len(source.left)
        following = await anext(parts)
        await parts.aclose()
        return left, len(following)

    left, following = run(gather())
    assert following == number
    assert 50 - left <= 2 * number


@pytest.mark.parametrize(("size", "kept"), [(10, 2), (1, 5), (99, 1)])
def test_of_too_many_datagrams_the_oldest_go(monkeypatch, size, kept):
    monkeypatch.setattr(datagrams, "_MAX_WAITING", 5)
    monkeypatch.setattr(datagrams, "_MAX_BYTES", 20)

    async def take():
        notices = Notices(str)
        found = Datagrams(notices)
        for round in range(2):
            for number in range(9):
                found.datagram_received(bytes([number]) * size, ("host", 7))
            taken = [data[0] for data, _ in await found.take()]
            assert taken == list(range(9 - kept, 9)), round
        return sum(notices.counts.values())

    assert run(take()) == 2 * (9 - kept)
