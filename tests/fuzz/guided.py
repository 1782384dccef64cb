"""Fuzz a target with atheris, which prefers inputs that reach new code; needs the extra ``fuzz``.

    PYTHONPATH=tests python -m fuzz.guided TARGET [FOLDER...] [OPTIONS of libFuzzer, such as -max_total_time=600]

Inputs that fail are kept in the working folder, as libFuzzer does.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
import tempfile
from pathlib import Path

__all__ = ["main"]


def main(name: str, words: list[str]) -> None:
    """Fuzz one target until it fails, or for as long as libFuzzer is told."""
    import atheris

    import gpszip

    # the compiler wants its kernels as they are
    for module in pkgutil.walk_packages(gpszip.__path__, "gpszip."):
        if ".kernels." in module.name:
            importlib.import_module(module.name)

    # other code that is imported from here on tells which lines inputs reach
    with atheris.instrument_imports(include=["gpszip"]):
        from fuzz.targets import TARGETS, run

        seeds = TARGETS[name].seeds()
        for seed in seeds:
            run(name, seed)

    # valid files to begin with
    corpus = Path(tempfile.mkdtemp(prefix="fuzz-corpus-"))
    for number, seed in enumerate(seeds):
        (corpus / str(number)).write_bytes(seed)

    def attempt(data: bytes) -> None:
        run(name, data)

    atheris.Setup([sys.argv[0], *words, str(corpus)], attempt)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
