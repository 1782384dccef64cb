"""Tests of the page in a browser are skipped, and say so, where there is nothing to drive one."""

import re
import subprocess
import sys
from pathlib import Path

BROWSER_TESTS = Path(__file__).parent / "browser"

#: Runs pytest as if selenium were not installed.
WITHOUT_SELENIUM = """
import sys
sys.modules["selenium"] = None
import pytest
sys.exit(pytest.main(sys.argv[1:]))
"""


def test_without_selenium_each_module_is_skipped_with_the_reason():
    options = ["-rs", "-p", "no:xdist", "-p", "no:cacheprovider"]
    modules = sorted(map(str, BROWSER_TESTS.glob("test_*.py")))
    result = subprocess.run(
        [sys.executable, "-c", WITHOUT_SELENIUM, *options, *modules],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "no selenium to drive a browser with" in result.stdout
    assert re.search(rf"= {len(modules)} skipped in ", result.stdout), result.stdout
