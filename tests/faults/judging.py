"""Judge the outcome of a command under a fault."""

from __future__ import annotations

__all__ = ["find_complaints"]

#: Exit code of ``injecting.py`` if a signal comes before the command starts.
_NOT_STARTED = 97

#: Exit codes of a command that fails.
_FAILED = (1, 2, 4, 5, 6)

#: Exit code of a command that is interrupted.
_INTERRUPTED = 130

#: Words of messages that no user should see.
_INTERNAL_ERRORS = ("Traceback", "a fault of GPSZip", "Exception ignored", "Fatal")

#: Letters of a message that is one line.
_MAX_LINE_LETTERS = 600


def find_complaints(outcome: dict) -> list[str]:
    """Return complaints about an outcome.

    There are none if the output is the old or the new file, and the message says the rest.

    Parameters
    ----------
    outcome : dict
        As ``injecting.py`` prints it.
    """
    if outcome["code"] == _INTERRUPTED:
        return _judge_interrupted(outcome)
    is_killed = outcome["fault"] == "signal 9"
    is_signal = outcome["fault"].startswith("signal")

    # The output is old or new. Of two outputs, one may be old and the other new.
    complaints = []
    valid = ("old", "new", "mixed") if is_killed else ("old", "new")
    if outcome["output"] not in valid and not _names_written_file(outcome):
        complaints.append(f"the output is {outcome['output']}")

    # A killed process can leave its temporary files, but nothing else. A signal before the command
    # starts, or after it is done, leaves nothing.
    if is_killed:
        left = [name for name in outcome["left"] if "gpszip-" not in name]
        return complaints + [f"left: {name}" for name in left]
    if is_signal and (outcome["code"] < 0 or outcome["code"] == _NOT_STARTED):
        return complaints + [f"left: {name}" for name in outcome["left"]]
    return complaints + _judge_message(outcome)


def _judge_message(outcome: dict) -> list[str]:
    """Return complaints about the exit code and the message of a command that ended by itself."""
    code, message = outcome["code"], outcome["message"]
    complaints = []
    if code not in (0, *_FAILED):
        complaints.append(f"exit code {code}")
    if code == 0 and outcome["output"] != "new":
        complaints.append("it ends with 0 and has not written the output")
    if outcome["fault"].endswith("EINTR") and code:
        complaints.append("an interrupted call was not repeated")
    if any(word in message for word in _INTERNAL_ERRORS):
        complaints.append("the message is that of an internal error")
    message_failed = "/message>" in outcome["injected"]
    if code and not message_failed and not _is_one_line(message):
        complaints.append("the error is not reported in one line")
    left = [name for name in outcome["left"] if name.split("/")[-1] not in message]
    return complaints + [f"left and not named: {name}" for name in left]


def _judge_interrupted(outcome: dict) -> list[str]:
    """Return complaints about a command that ends as interrupted."""
    message, state = outcome["message"], outcome["output"]
    complaints = []
    if "gpszip: interrupted; " not in message and state != "new":
        complaints.append("the message does not say that it was interrupted")
    if "nothing was written" in message and state != "old":
        complaints.append(f"the message says that nothing was written, and the output is {state}")
    if state not in ("old", "new") and "is written" not in message:
        complaints.append(f"the output is {state}")
    return complaints + [f"left: {name}" for name in outcome["left"]]


def _is_one_line(message: str) -> bool:
    lines = [line for line in message.splitlines() if line.startswith("gpszip: ")]
    return len(lines) == 1 and len(lines[0]) < _MAX_LINE_LETTERS


def _names_written_file(outcome: dict) -> bool:
    """Whether one of two outputs is new, the other old, and the message says so."""
    return outcome["output"] == "mixed" and "is written" in outcome["message"]
