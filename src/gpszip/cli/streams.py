"""Standard streams that are closed, or break."""

from __future__ import annotations

import os
import sys

__all__ = ["flush_stdout", "open_standard_streams"]


def open_standard_streams() -> None:
    """Replace standard streams that are closed.

    Otherwise the next files that are opened would get their numbers. To read or write a replaced
    standard input or output is an error; text for a closed standard error is lost.
    """
    # The system gives a new file the lowest free number. All below are open by now, so that it is
    # the number of the closed stream.
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # Opened for the wrong direction: every use is an error, as of a closed stream.
            os.open(os.devnull, os.O_WRONLY if number == 0 else os.O_RDONLY)

    # Python makes None of a stream that was closed when it started.
    if sys.stdin is None:
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115

    # Names of files need not be valid text.
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")


def flush_stdout() -> OSError | None:
    """Write what standard output still buffers, and return the error if that fails.

    After an error, standard output is the null device, so that the interpreter doesn't report the
    error once more when it shuts down.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        null_device = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null_device, sys.stdout.fileno())
        os.close(null_device)
        return error
    return None
