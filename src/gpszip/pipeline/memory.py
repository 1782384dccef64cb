"""How a budget of memory is spent: rows in sorting, samples in a batch, workers."""

from __future__ import annotations

from gpszip.errors import OptionError
from gpszip.run.executor import Executor
from gpszip.run.threads import Threads

__all__ = [
    "batch_samples",
    "check_memory",
    "fits",
    "knots_of_curves",
    "rows_while_sorting",
    "subsample_size",
    "workers_within",
]

#: Bytes that the interpreter, its libraries and compiled kernels take.
PROGRAM = 300 << 20

#: Bytes beyond those of the program without which no batch is worth its overhead.
_MIN_WORKING = 100 << 20

#: Bytes for each sample while a log is compressed in memory, at the peak.
_BYTES_IN_MEMORY = 700

#: Bytes for each row that is being sorted.
_BYTES_SORTING = 150

#: Bytes for each further column of a row that is being sorted.
_BYTES_SORTING_COLUMN = 120

#: Bytes for each sample from which a map is learned.
_BYTES_LEARNING = 700

#: Bytes for each sample of a batch that is being encoded.
_BYTES_ENCODING = 1200

#: Bytes for each knot of a column within an error, while the column is coded.
_BYTES_KNOT = 160

#: Samples of a batch at most, which take 120 MB while they are encoded.
MAX_BATCH = 100_000

#: Samples of a batch at least: in fewer, an agent hardly comes back to where it was.
_MIN_BATCH = 5000

#: Batches that may be encoded at once.
_BATCHES_AT_ONCE = 4

#: Samples from which a map is learned, at most; they take 1.4 GB.
MAX_SUBSAMPLE = 2_000_000


def check_memory(memory: int) -> None:
    """Refuse a budget in which no batch fits.

    Raises
    ------
    OptionError
        If ``memory``, in bytes, is too small.
    """
    least = PROGRAM + _MIN_WORKING
    if memory < least:
        raise OptionError(
            f"{memory / 2**20:.0f} MiB are too little memory to work in",
            remedy=f"give at least {least >> 20} MiB",
        )


def fits(samples: int, memory: int | None) -> bool:
    """Whether a log of so many samples can be compressed in memory; always without a budget."""
    return memory is None or PROGRAM + _BYTES_IN_MEMORY * samples <= memory


def rows_while_sorting(memory: int, columns: int) -> int:
    """Rows with so many further columns that may be in memory while a log is sorted."""
    return (memory - PROGRAM) // (_BYTES_SORTING + _BYTES_SORTING_COLUMN * columns)


def knots_of_curves(memory: int) -> int:
    """Knots that the curves of one column may have."""
    return (memory - PROGRAM) // _BYTES_KNOT


def subsample_size(memory: int | None) -> int:
    """Samples from which a map may be learned."""
    if memory is None:
        return MAX_SUBSAMPLE
    return min((memory - PROGRAM) // _BYTES_LEARNING, MAX_SUBSAMPLE)


def batch_samples(memory: int | None) -> int:
    """Samples that a batch may have."""
    if memory is None:
        return MAX_BATCH
    affordable = (memory - PROGRAM) // (_BYTES_ENCODING * _BATCHES_AT_ONCE)
    return max(min(MAX_BATCH, affordable), _MIN_BATCH)


def workers_within(memory: int | None, batch: int, executor: Executor | None) -> Executor:
    """Limit threads to as many batches as fit the memory; other executors stay as they are."""
    from gpszip.run import resolve_executor

    workers = Threads() if executor is None else resolve_executor(executor)
    if memory is None or not isinstance(workers, Threads):
        return workers
    affordable = (memory - PROGRAM) // (_BYTES_ENCODING * batch)
    return Threads(max(min(workers.workers, affordable), 1))
