"""Fuzz a target with atheris, which prefers inputs that reach new code; needs the extra ``fuzz``.

    PYTHONPATH=tests python -m fuzz.guided TARGET [FOLDER...] [OPTION...]

Options are those of libFuzzer, such as ``-max_total_time=600``. Inputs that fail are kept in the
working folder, as libFuzzer does.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
import tempfile
from pathlib import Path

__all__ = ["main"]


def main(target: str, arguments: list[str]) -> None:
    """Fuzz one target until it fails, or for the time that libFuzzer's options set."""
    import atheris

    import gpszip

    # Kernels can't be instrumented, as the compiler wants them as they are.
    for module in pkgutil.walk_packages(gpszip.__path__, "gpszip."):
        if ".kernels." in module.name:
            importlib.import_module(module.name)

    # Other code is instrumented as it is imported, to show which lines inputs reach.
    with atheris.instrument_imports(include=["gpszip"]):
        from fuzz.targets import TARGETS, run

        seeds = TARGETS[target].seeds()
        for seed in seeds:
            run(target, seed)

    # Valid files to begin with.
    corpus = Path(tempfile.mkdtemp(prefix="fuzz-corpus-"))
    for number, seed in enumerate(seeds):
        (corpus / str(number)).write_bytes(seed)

    def test_one_input(data: bytes) -> None:
        run(target, data)

    atheris.Setup([sys.argv[0], *arguments, str(corpus)], test_one_input)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
