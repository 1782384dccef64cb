"""Columns and sample times that merged archives keep."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gpszip.archive.exact import find_kept
from gpszip.archive.joined_curves import join_curves
from gpszip.container.attributes import KeptColumns, encode_attributes
from gpszip.container.contents import Section
from gpszip.container.layout import EXACT_KINDS
from gpszip.errors import OptionError
from gpszip.lossless.kept import read_kept, smaller_section
from gpszip.pipeline.merge_sources import MergeSource

__all__ = ["merge_columns", "merge_curves"]


def merge_columns(
    sources: Sequence[MergeSource], ids: Sequence[str]
) -> tuple[tuple[Section, ...], tuple[str, ...]]:
    """Join the kept columns of all archives.

    Parameters
    ----------
    sources : sequence of MergeSource
        The archives.
    ids : sequence of str
        All tracks, in their order.

    Returns
    -------
    tuple of Section
        One section, or none where no archive keeps columns.
    tuple of str
        Notes on columns that only some archives keep.

    Raises
    ------
    OptionError
        If a column holds texts in one archive and numbers in another.
    """
    # Find the section of kept columns in each archive; without any there is nothing to join.
    bodies = [find_kept(source.archive.contents) for source in sources]
    exact_notes = _notes_on_exact_logs(sources)
    if not any(bodies):
        return (), exact_notes

    # The table of each archive; empty where it keeps none.
    tables = [
        read_kept(*body, len(source.ids))
        if body is not None
        else KeptColumns((0,) * len(source.ids), np.zeros(0))
        for source, body in zip(sources, bodies, strict=True)
    ]
    names = list(dict.fromkeys(name for table in tables for name in table.columns))

    # Rows of each track in the order of time, track by track.
    rows = _rows_by_track(sources, tables, ids)
    chosen = [row for id in ids for row in rows[id]]
    counts = tuple(sum(where.stop - where.start for _, where in rows[id]) for id in ids)
    times = [table.times[where] for table, where in chosen]
    columns = {
        name: np.concatenate([_values(table, name, where, tables) for table, where in chosen])
        for name in names
    }
    kept = KeptColumns(counts, np.concatenate(times) if times else np.zeros(0), columns)

    # Say which columns, or times, the samples of some archives lack.
    notes = []
    missing = sorted({name for name in names for table in tables if name not in table.columns})
    if missing:
        notes.append(f"only some archives keep {', '.join(missing)}: the others' samples have none")
    if not all(bodies):
        notes.append("only some archives keep the times of samples")
    section = Section(*smaller_section(encode_attributes(kept), len(ids)))
    return (section,), (*notes, *exact_notes)


def merge_curves(
    sources: Sequence[MergeSource], ids: Sequence[str]
) -> tuple[tuple[Section, ...], tuple[str, ...]]:
    """Join the columns that archives keep within an error.

    Parameters
    ----------
    sources, ids
        As for :func:`merge_columns`.

    Returns
    -------
    tuple of Section
        One section, or none where no archive has such columns.
    tuple of str
        Notes on columns that only some archives have.

    Raises
    ------
    OptionError
        If a column is kept exactly in one archive and within an error in another.
    """
    # The tracks of each id.
    parts: dict[str, list[tuple[int, int]]] = {id: [] for id in ids}
    for source, each in enumerate(sources):
        for number, id in enumerate(each.ids):
            parts[id].append((source, number))
    archives = [each.archive for each in sources]
    sections = join_curves(archives, [parts[id] for id in ids])

    # Say which columns some archives lack.
    names = {name for archive in archives for name in archive.curve_sizes}
    missing = sorted(name for name in names if any(name not in a.curve_sizes for a in archives))
    notes = f"only some archives keep {', '.join(missing)} within an error: others have no values"
    return sections, (notes,) if missing else ()


def _notes_on_exact_logs(sources: Sequence[MergeSource]) -> tuple[str, ...]:
    """Say that logs kept byte by byte stay in the archives that are merged."""
    extras = [extra for source in sources for extra in source.archive.contents.extras]
    if all(extra.kind not in EXACT_KINDS for extra in extras):
        return ()
    return ("logs kept exactly are not merged: keep the archives that hold them",)


def _rows_by_track(
    sources: Sequence[MergeSource], tables: Sequence[KeptColumns], ids: Sequence[str]
) -> dict[str, list[tuple[KeptColumns, slice]]]:
    """Where the rows of each track are, in the order of time."""
    rows: dict[str, list[tuple[float, KeptColumns, slice]]] = {id: [] for id in ids}
    for source, table in zip(sources, tables, strict=True):
        for number, id in enumerate(source.ids):
            where = table.rows(number)
            if where.stop > where.start:
                rows[id].append((float(table.times[where.start]), table, where))
    return {
        id: [(table, where) for _, table, where in sorted(found, key=lambda row: row[0])]
        for id, found in rows.items()
    }


def _values(
    table: KeptColumns, name: str, rows: slice, tables: Sequence[KeptColumns]
) -> NDArray[np.generic]:
    """Some rows of a column: as integers, or else numbers with NaN, or texts, as all hold it."""
    # NumPy's kinds of the column in all archives that keep rows; "-" where one lacks it
    kinds = {
        each.columns[name].dtype.kind if name in each.columns else "-"
        for each in tables
        if len(each.times)
    }
    count = rows.stop - rows.start

    # Texts; empty where there are none.
    if kinds & set("OSU"):
        if kinds & set("biuf"):
            raise OptionError(
                f"column {name!r} holds texts in one archive and numbers in another",
                remedy="compress them under different names",
            )
        if name in table.columns:
            return table.columns[name][rows]
        return np.full(count, "", dtype=object)

    # Integers in all.
    if kinds <= set("biu"):
        return table.columns[name][rows]

    # Numbers with a fraction, or holes.
    values = table.columns[name][rows] if name in table.columns else np.full(count, np.nan)
    numbers = values.astype(np.float64)
    if values.dtype.kind in "iu" and (numbers.astype(values.dtype) != values).any():
        raise OptionError(
            f"column {name!r} holds integers in one archive that can't be numbers with a "
            "fraction, as another has it; rename the column in one of them"
        )
    return numbers
