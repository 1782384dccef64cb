"""Names of files as messages show them."""

from __future__ import annotations

import re

__all__ = ["printable_name"]

#: Letters that move the cursor, end the line or turn the direction of writing.
_CONTROL_LETTERS = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def printable_name(name: str) -> str:
    r"""Return a name in one line: letters that are no Unicode or steer a terminal are escaped.

    Examples
    --------
    >>> printable_name("wälk.csv"), printable_name("a\nb\x1b.csv"), printable_name("\udcff.csv")
    ('wälk.csv', 'a\\nb\\x1b.csv', '\\xff.csv')
    """
    try:
        # bytes that are no UTF-8 stand in names of files as lone surrogates
        text = name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:
        text = name.encode("utf-8", "backslashreplace").decode()
    return _CONTROL_LETTERS.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
