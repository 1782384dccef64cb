"""The page on events names all kinds."""

import re
from pathlib import Path

from gpszip.live.events import KINDS

PAGE = Path(__file__).parents[2] / "docs/events.md"


def test_the_page_describes_each_kind_as_the_code_does():
    rows = re.findall(r"^\| `([a-z_]+(?:\.[a-z]+)?)` \| ([^|]+) \|", PAGE.read_text(), re.MULTILINE)
    told = {kind: text for kind, text in rows if kind in KINDS}
    assert list(told) == list(KINDS)
