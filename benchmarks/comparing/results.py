"""Results in a JSON file beside the figure, so that a run that was stopped goes on."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .codecs import Codec
from .logs import Case


@dataclass
class Results:
    """What has been measured, by log and by codec with its level.

    Parameters
    ----------
    path : Path
        The JSON file.
    logs : dict
        For each log: ``points``, ``tracks``, ``bound``, ``stamp`` and ``codecs``.
    """

    path: Path
    logs: dict[str, dict[str, Any]] = field(default_factory=dict)

    def open_log(self, case: Case) -> None:
        """Keep the results of a log if it is the same log with the same bound, and no others."""
        facts = {
            "points": case.points,
            "tracks": case.tracks,
            "bound": case.bound,
            "stamp": case.stamp,
        }
        known = self.logs.get(case.title, {})
        codecs = known.get("codecs", {}) if facts.items() <= known.items() else {}
        self.logs[case.title] = {**facts, "codecs": codecs}

    def add(self, title: str, key: str, result: dict[str, Any]) -> None:
        """Add a result, and write the file."""
        self.logs[title]["codecs"][key] = result
        self.path.write_text(json.dumps(self.logs, indent=1) + "\n")

    def keep_only(self, titles: list[str]) -> None:
        """Forget all other logs, and keep these in this order."""
        self.logs = {title: self.logs[title] for title in titles}

    def points_of(self, title: str, codec: Codec) -> list[tuple[str, dict[str, Any]]]:
        """Levels and results of a codec on a log, from quick to thorough."""
        codecs = self.logs[title]["codecs"]
        return [
            (level, codecs[f"{codec.name} {level}"])
            for level in codec.levels
            if f"{codec.name} {level}" in codecs
        ]


def read_results(path: Path, again: list[str]) -> Results:
    """Read results, without those of the codecs that are to be measured again."""
    logs = json.loads(path.read_text()) if path.exists() else {}
    for log in logs.values():
        log["codecs"] = {
            key: result
            for key, result in log["codecs"].items()
            if "all" not in again and key.split()[0] not in again
        }
    return Results(path, logs)


def missing(
    results: Results, cases: list[Case], codecs: list[Codec]
) -> Iterator[tuple[Case, Codec, str]]:
    """What has not been measured yet."""
    for case in cases:
        for codec in codecs:
            for level in codec.levels:
                if f"{codec.name} {level}" not in results.logs[case.title]["codecs"]:
                    yield case, codec, level
