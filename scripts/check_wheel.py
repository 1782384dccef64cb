"""Check that a wheel with compiled kernels compiles nothing at the first run.

    python scripts/check_wheel.py FOLDER [--system]

The newest wheel in the folder is installed into a fresh environment, which compresses and
decompresses four points with an empty cache. With --system, the environment sees the packages of
this one, and only the wheel is installed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

#: Runs in the fresh environment: the command, and how many kernels it compiled.
_RUN = """
import sys
from pathlib import Path

import gpszip
from gpszip.cli.main import main
from gpszip.kernels.compiling import on_compile

assert Path(gpszip.__file__).is_relative_to(sys.prefix), gpszip.__file__
compiled = []
with on_compile(lambda: compiled.append(1)):
    codes = [main(words.split()) for words in (
        "compress log.csv -o log.gpsz", "decompress log.gpsz -o back.csv"
    )]
sys.exit(f"exit codes {codes}, {len(compiled)} kernels compiled" if any(codes) or compiled else 0)
"""

#: Four points of a walk.
_LOG = "t,x,y\n0,0,0\n1,1,0\n2,2,1\n3,3,1\n"


def main() -> None:
    """Install the wheel and run it."""
    wheel = max(Path(sys.argv[1]).resolve().glob("*.whl"), key=lambda path: path.stat().st_mtime)
    shares_packages = "--system" in sys.argv[2:]
    with tempfile.TemporaryDirectory() as name:
        # Install.
        folder = Path(name)
        venv.create(folder / "venv", with_pip=not shares_packages)
        python = folder / "venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        options = ["--python", str(python), "--no-deps"] if shares_packages else []
        installer = sys.executable if shares_packages else str(python)
        subprocess.run(
            [installer, "-m", "pip", *options[:2], "install", "-q", *options[2:], str(wheel)],
            check=True,
        )
        if shares_packages:
            packages = next((folder / "venv").glob("[Ll]ib/**/site-packages"))
            (packages / "shared.pth").write_text("\n".join(p for p in sys.path if "site-" in p))

        # Run, with an empty cache and outside of the source tree.
        (folder / "log.csv").write_text(_LOG)
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")}
        environment.pop("PYTHONPATH", None)
        subprocess.run([str(python), "-c", _RUN], cwd=folder, env=environment, check=True)


if __name__ == "__main__":
    main()
