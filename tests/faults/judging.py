"""What is wrong with the outcome of a command under a fault, if anything."""

from __future__ import annotations

__all__ = ["wrong"]

#: What ``injecting.py`` ends with if a signal comes before the command begins.
_NOT_BEGUN = 97

#: Exit codes that a command may fail with, and beginnings of messages that no user should see.
_FAILED, _INTERRUPTED, _FAULTS = (
    (1, 2, 4, 5, 6),
    130,
    ("Traceback", "a fault of GPSZip", "Exception ignored", "Fatal"),
)


def wrong(outcome: dict) -> list[str]:
    """Complaints about an outcome; none if the old or the new file is there, and the rest is told.

    Parameters
    ----------
    outcome : dict
        As ``injecting.py`` prints it.
    """
    killed, told, interrupted = (
        outcome["fault"] == "signal 9",
        outcome["told"],
        outcome["fault"].endswith("EINTR"),
    )
    if outcome["code"] == _INTERRUPTED:
        return _interrupted(outcome)
    found = []
    if outcome["output"] not in (
        ("old", "new", "mixed") if killed else ("old", "new")
    ) and not _says_so(outcome):
        found.append(f"the output is {outcome['output']}")
    if killed:
        return found + [f"left: {name}" for name in outcome["left"] if "gpszip-" not in name]
    if outcome["fault"].startswith("signal") and (
        outcome["code"] < 0 or outcome["code"] == _NOT_BEGUN
    ):
        # before it began, or when all was done
        return found + [f"left: {name}" for name in outcome["left"]]
    if outcome["code"] not in (0, *_FAILED):
        found.append(f"exit code {outcome['code']}")
    if outcome["code"] == 0 and outcome["output"] != "new":
        found.append("done, it says, and has not done it")
    if interrupted and outcome["code"]:
        found.append("an interrupted call was not made again")
    if any(word in told for word in _FAULTS):
        found.append("a fault is told as one of GPSZip's own")
    if outcome["code"] and "<" + "told" not in outcome["struck"] and not _one_line(told):
        found.append("the error is not told in one line")
    found += [
        f"left and not named: {name}" for name in outcome["left"] if name.split("/")[-1] not in told
    ]
    return found


def _interrupted(outcome: dict) -> list[str]:
    told, state = outcome["told"], outcome["output"]
    found = (
        []
        if "gpszip: interrupted; " in told or state == "new"
        else ["it does not say that it was interrupted"]
    )
    found += (
        [f"nothing was written, it says, and the output is {state}"]
        if "nothing was written" in told and state != "old"
        else []
    )
    found += (
        [f"the output is {state}"]
        if state not in ("old", "new") and "is written" not in told
        else []
    )
    return found + [f"left: {name}" for name in outcome["left"]]


def _one_line(told: str) -> bool:
    lines = [line for line in told.splitlines() if line.startswith("gpszip: ")]
    return len(lines) == 1 and len(lines[0]) < 600


def _says_so(outcome: dict) -> bool:
    """Whether one of two outputs is new, the other old, and the message names both."""
    return outcome["output"] == "mixed" and "is written" in outcome["told"]
