"""The standard streams: those that are closed, and those that break."""

from __future__ import annotations

import os
import sys

__all__ = ["flush_stdout", "open_standard_streams"]


def open_standard_streams() -> None:
    """Put something in the place of standard streams that are closed, so that no file is opened under their numbers.

    Whoever reads or writes standard input or output is told that it is closed; what goes to standard error is lost.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # open the wrong way round: every use is an error, as it is of a closed one
            os.open(os.devnull, os.O_WRONLY if number == 0 else os.O_RDONLY)
    if sys.stdin is None:
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    if sys.stdout is None:
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    # names of files need not be text
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")


def flush_stdout() -> OSError | None:
    """Write what standard output still holds; return what is wrong with it, which the end of the interpreter won't say again."""
    try:
        sys.stdout.flush()
    except OSError as error:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
        return error
    return None
