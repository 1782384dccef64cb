"""How many examples random tests try."""

import os
from typing import Any

from hypothesis import settings

#: Share of the examples that a run tries; each run tries others. ``GPSZIP_EXAMPLES=all`` tries all.
SHARE = 1.0 if os.environ.get("GPSZIP_EXAMPLES") == "all" else 0.4

#: Fewest examples that a share leaves.
FEWEST = 5


def examples(count: int, **others: Any) -> settings:
    """Settings of a test that tries a share of so many examples."""
    return settings(max_examples=max(FEWEST, round(SHARE * count)), **others)
