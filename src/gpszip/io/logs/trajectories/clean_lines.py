"""Lines of numbers without comments, and with single blanks between their cells."""

from __future__ import annotations

import re

__all__ = ["clean_lines"]

#: Lines that begin so are comments, whatever stands before the sign.
_COMMENT = re.compile(rb"(?m)^[ ]*[#%].*$")

#: Blanks at the ends of lines, and repeated blanks.
_END_BLANKS = re.compile(rb"(?m)^ +| +$")
_REPEATED_BLANKS = re.compile(rb" {2,}")

#: Separators that become blanks. A carriage return ends a line, or stands before its end.
_SEPARATORS = bytes.maketrans(b",;\t\v\f", b"     ")

_UTF8_MARK = b"\xef\xbb\xbf"


def clean_lines(block: bytes) -> bytes:
    r"""Return lines without comments and with single blanks between their cells.

    Examples
    --------
    >>> clean_lines(b"# time x\n 1,  2\r\n3\t4 \n")
    b'\n1 2\n3 4\n'
    """
    text = block.removeprefix(_UTF8_MARK).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = text.translate(_SEPARATORS)

    # Most blocks need none of these, each of which takes as long as reading the numbers does.
    if b"#" in text or b"%" in text:
        text = _COMMENT.sub(b"", text)
    if b" \n" in text or b"\n " in text or text[:1] == b" " or text[-1:] == b" ":
        text = _END_BLANKS.sub(b"", text)
    if b"  " in text:
        text = _REPEATED_BLANKS.sub(b" ", text)
    return text
