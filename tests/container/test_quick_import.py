import subprocess
import sys


def test_archives_are_looked_at_without_the_compiler():
    code = "import sys, gpszip.container.verify, gpszip.container.catalog, gpszip.container; print('numba' in sys.modules, 'scipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
