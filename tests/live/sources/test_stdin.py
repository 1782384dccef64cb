"""Reading of descriptors."""

import asyncio
import os
import threading

from gpszip.live.sources import stdin


def test_a_reader_that_ended_takes_nothing_from_the_next(monkeypatch):
    # The thread of the first reader stops between two reads, until the second has begun.
    go_on, counts = threading.Event(), iter(range(100))

    class HeldSemaphore(threading.Semaphore):
        def acquire(self, *_):
            if next(counts) == 1:
                go_on.wait(60)
            return super().acquire()

    monkeypatch.setattr(stdin.threading, "Semaphore", HeldSemaphore)

    async def read_first(descriptor):
        chunks = stdin.read_descriptor_chunks(descriptor)
        try:
            return await anext(chunks)
        finally:
            await chunks.aclose()

    async def read_all(descriptor):
        return b"".join([c async for c in stdin.read_descriptor_chunks(descriptor) if c])

    others = set(threading.enumerate())

    # The number of the first pipe becomes that of the second, as when input is redirected.
    number, writer = os.pipe()
    os.write(writer, b"first")
    assert asyncio.run(read_first(number)) == b"first"
    reader, second_writer = os.pipe()
    os.dup2(reader, number)
    os.write(second_writer, b"second")
    readers = set(threading.enumerate()) - others
    assert readers
    go_on.set()
    os.close(writer)
    for thread in readers:
        thread.join(60)
        assert not thread.is_alive()
    os.close(second_writer)

    assert asyncio.run(read_all(number)) == b"second"
    for descriptor in (number, reader):
        os.close(descriptor)
