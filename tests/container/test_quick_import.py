import subprocess
import sys


def test_archives_are_verified_without_the_compiler():
    code = (
        "import sys, gpszip.container.verify, gpszip.container.catalog;"
        "print(*(name in sys.modules for name in ('numba', 'scipy')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
