"""Compile all kernels for any processor of this platform, for a wheel.

    python scripts/compile_kernels.py FOLDER

A generic processor has no features that only some have (on x86-64: SSE2 and no AVX).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

#: Modules with kernels are imported before their caches are written.
_WRITE = """
import sys
from importlib import import_module
from pathlib import Path

import gpszip
from gpszip.kernels.precompiled import write_precompiled

package = Path(gpszip.__file__).parent
for path in sorted(package.rglob("kernels/*.py")):
    name = path.relative_to(package.parent).with_suffix("").as_posix().replace("/", ".")
    import_module(name.removesuffix(".__init__"))
print(write_precompiled(Path(sys.argv[1])), "compiled kernels")
"""


def main() -> None:
    """Compile into an empty cache, then copy what it holds to the folder."""
    folder = Path(sys.argv[1]).resolve()
    shutil.rmtree(folder, ignore_errors=True)

    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": cache}
        for command in (["-m", "gpszip", "warm"], ["-c", _WRITE, str(folder)]):
            subprocess.run([sys.executable, *command], env=environment, check=True)


if __name__ == "__main__":
    main()
