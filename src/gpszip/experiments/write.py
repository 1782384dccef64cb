"""Files of an experiment: tables and pictures that say how they were made."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

from gpszip.drawing.style import save_figure
from gpszip.experiments.experiment import Outcome, Picture
from gpszip.experiments.listing import Experiment
from gpszip.experiments.table import Table, to_csv, to_markdown, to_records
from gpszip.files.atomic_write import atomic_write_all

__all__ = ["describe_versions", "file_names", "write_outcome"]

#: Packages whose versions can change numbers or pictures.
_PACKAGES = ("numpy", "scipy", "numba", "matplotlib")

#: Formats of pictures.
_PICTURES = ("png", "svg")


def describe_versions(own: str) -> dict[str, str]:
    """Return the versions of gpszip, Python and the packages that compute and draw."""
    versions = {"gpszip": own, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = version_of(package)
        except PackageNotFoundError:
            versions[package] = "none"
    return versions


def file_names(experiment: Experiment, outcome: Outcome) -> list[str]:
    """Return the names of all files of an outcome, the Markdown first."""
    names = [f"{experiment.name}.md", f"{experiment.name}.json"]
    names += [f"{_stem(experiment, table)}.csv" for table in outcome.tables]
    return names + [
        f"{_stem(experiment, picture)}.{kind}" for picture in outcome.pictures for kind in _PICTURES
    ]


def write_outcome(
    experiment: Experiment,
    outcome: Outcome,
    folder: Path,
    *,
    seed: int,
    command: str,
    version: str,
    force: bool = False,
) -> list[str]:
    """Write all files of an experiment into a folder, all or none.

    Parameters
    ----------
    experiment : Experiment
        Its name begins the names of the files.
    outcome : Outcome
        What it found.
    folder : path
        An existing folder.
    seed : int
        Seed of the generated logs.
    command : str
        The command that ran it.
    version : str
        Version of gpszip.
    force : bool, default False
        Replace existing files.

    Returns
    -------
    list of str
        Names of the files.

    Raises
    ------
    OutputError
        If a file exists and ``force`` is not given, or can't be written.
    """
    made = {"command": command, "seed": seed, "versions": describe_versions(version)}
    names = file_names(experiment, outcome)
    with atomic_write_all([folder / name for name in names], force=force) as paths:
        targets = iter(paths)
        next(targets).write_text(_markdown(experiment, outcome, made), encoding="utf-8")
        next(targets).write_text(_json(experiment, outcome, made), encoding="utf-8")

        # A file for each table and picture.
        for table in outcome.tables:
            comments = [table.title, _made_by(made)]
            next(targets).write_text(to_csv(table, comments), encoding="utf-8")
        for picture in outcome.pictures:
            picture.figure.set_label(f"{picture.caption} {_made_by(made)}")
            for kind in _PICTURES:
                save_figure(picture.figure, next(targets), kind)
    return names


def _stem(experiment: Experiment, part: Table | Picture) -> str:
    """Return the name of a file without its suffix."""
    return f"{experiment.name}-{part.name}" if part.name else experiment.name


def _made_by(made: Mapping[str, Any]) -> str:
    """Say in one line how a file was made."""
    versions = ", ".join(f"{name} {number}" for name, number in made["versions"].items())
    return f"Made by `{made['command']}`, seed {made['seed']}, with {versions}."


def _markdown(experiment: Experiment, outcome: Outcome, made: Mapping[str, Any]) -> str:
    """Return all tables and pictures as one page."""
    parts = [f"# {experiment.name}: {experiment.description}", *outcome.notes]
    for table in outcome.tables:
        parts += [f"{table.title}:", to_markdown(table)]
    for picture in outcome.pictures:
        parts += [f"![{picture.caption}]({_stem(experiment, picture)}.png)", picture.caption]
    return "\n\n".join([*parts, _made_by(made)]) + "\n"


def _json(experiment: Experiment, outcome: Outcome, made: Mapping[str, Any]) -> str:
    """Return everything as one object: tables by their names, "main" where there is none."""
    content = {
        "experiment": experiment.name,
        **made,
        "notes": list(outcome.notes),
        "tables": {table.name or "main": to_records(table) for table in outcome.tables},
        "pictures": {_stem(experiment, picture): picture.caption for picture in outcome.pictures},
    }
    return json.dumps(content, indent=1) + "\n"
