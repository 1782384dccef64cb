"""Tables of experiments, as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

__all__ = ["Column", "Table", "Value", "to_csv", "to_markdown", "to_records"]

#: What a cell holds; None where there is nothing to state.
Value: TypeAlias = str | int | float | None


@dataclass(frozen=True)
class Column:
    """One column.

    Parameters
    ----------
    key : str
        Name in CSV and JSON, with the unit.
    title : str
        Name in Markdown, with the unit.
    decimals : int, default 0
        Decimals of numbers in Markdown; CSV and JSON have all.
    """

    key: str
    title: str
    decimals: int = 0


@dataclass(frozen=True)
class Table:
    """One table.

    Parameters
    ----------
    name : str
        Follows the name of the experiment in the name of the CSV file; may be empty.
    title : str
        What it shows.
    columns : tuple of Column
        Its columns.
    rows : tuple of mapping of str to value
        Values by the keys of columns; those that are missing are None.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Mapping[str, Value], ...]


def to_markdown(table: Table) -> str:
    """Format a table as Markdown, without its title.

    Examples
    --------
    >>> columns = Column("log", "log"), Column("rmse_m", "RMSE m", 2)
    >>> print(to_markdown(Table("", "", columns, ({"log": "a", "rmse_m": 0.256}, {"log": "b"}))))
    | log | RMSE m |
    |---|---|
    | a | 0.26 |
    | b |  |
    """
    lines = [[column.title for column in table.columns], ["---"] * len(table.columns)]
    lines += [
        [_format(row.get(each.key), each.decimals) for each in table.columns] for row in table.rows
    ]
    head, rule, *rows = lines
    texts = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    return "\n".join([texts[0], f"|{'|'.join(rule)}|", *texts[1:]])


def _format(value: Value, decimals: int) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value.replace("|", "\\|")
    return f"{value:,.{decimals}f}"


def to_records(table: Table) -> list[dict[str, Any]]:
    """Return the rows as objects for JSON, with a key for each column.

    Examples
    --------
    >>> to_records(Table("", "", (Column("a", "A"), Column("b", "B")), ({"a": 1},)))
    [{'a': 1, 'b': None}]
    """
    return [{each.key: row.get(each.key) for each in table.columns} for row in table.rows]


def to_csv(table: Table, comments: Sequence[str] = ()) -> str:
    r"""Format a table as CSV, below comments.

    Examples
    --------
    >>> to_csv(Table("", "", (Column("a", "A"), Column("b", "B")), ({"a": 1},)), ["seed 1"])
    '# seed 1\na,b\n1,\n'
    """
    text = io.StringIO()
    text.writelines(f"# {' '.join(comment.split())}\n" for comment in comments)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([each.key for each in table.columns])
    writer.writerows([[row.get(each.key) for each in table.columns] for row in table.rows])
    return text.getvalue()
