"""One codec on one log, as a process of its own: what ``measure.py`` starts.

    python process.py CODEC LEVEL TINY_LOG LOG BOUND OUT

Modules are imported where they are used, so that no codec pays for the start-up of another. A tiny
log is compressed first, which imports everything and loads compiled code. What takes little is
repeated. Prints as JSON the CPU seconds of the start-up (``startup``), those of each run after it
(``runs``), and the bytes by coder (``sizes``).
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))


#: Runs shorter than this are repeated, since the clock and caches move them by tenths.
SHORT_SECONDS = 3.0

#: Number of short runs.
RUNS = 3


def main(codec: str, level: str, tiny: str, log: str, bound: str, out: str) -> None:
    # Start-up.
    compress(codec, level, tiny, bound, out)
    startup = time.process_time()

    # The log, from the file to the compressed file.
    runs: list[float] = []
    while not runs or (len(runs) < RUNS and runs[0] < SHORT_SECONDS):
        start = time.process_time()
        sizes = compress(codec, level, log, bound, out)
        runs.append(time.process_time() - start)
    print(json.dumps({"startup": startup, "runs": runs, "sizes": sizes}))


def compress(codec: str, level: str, path: str, bound: str, out: str) -> dict[str, int]:
    """Read a CSV file and write a compressed file; return the bytes by coder, if it has several."""
    if codec == "gpszip":
        from gpszip.cli.main import main as command

        options = ["--force", "--quiet", "--max-error", bound, "--effort", level]
        code = command(["compress", path, "-o", out, *options])
        if code != 0:
            raise SystemExit(code)
        return {}

    from peers.log import read_log

    log = read_log(path)
    if level == "samples":
        from peers import on_samples

        Path(out).write_bytes(on_samples.compress(log, float(bound), codec))
        return {}

    from peers import on_knots

    data, sizes = on_knots.compress(log, float(bound), codec, level)
    Path(out).write_bytes(data)
    return sizes


if __name__ == "__main__":
    main(*sys.argv[1:])
