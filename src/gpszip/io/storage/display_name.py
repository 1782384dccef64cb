"""Names of files in the form in which messages show them."""

from __future__ import annotations

import re

__all__ = ["printable_name"]

#: Characters that move the cursor, end the line or change the direction of text.
_CONTROL_LETTERS = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def printable_name(name: str) -> str:
    r"""Return a name in one line, with invalid and control characters escaped.

    Examples
    --------
    >>> printable_name("wälk.csv"), printable_name("a\nb\x1b.csv"), printable_name("\udcff.csv")
    ('wälk.csv', 'a\\nb\\x1b.csv', '\\xff.csv')
    """
    try:
        # Python represents bytes that are no UTF-8 as lone surrogates in names of files.
        text = name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:
        # Other lone surrogates stand for no byte: they are escaped as such.
        text = name.encode("utf-8", "backslashreplace").decode()
    return _CONTROL_LETTERS.sub(lambda match: match[0].encode("unicode_escape").decode(), text)
