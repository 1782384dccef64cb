"""Time the compilation of each kernel, at the first compress and for all kernels.

    python benchmarks/compiling.py [--least SECONDS]

Both runs begin with an empty cache. Seconds are CPU time of the compiling thread, and a kernel's
own: those of the kernels that it calls are counted there. A kernel that Python calls also takes
the time to optimise all kernels that it calls, and to generate machine code.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

#: Four points of a walk.
LOG = "t,x,y\n0,0,0\n1,1,0\n2,2,1\n3,3,1\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--least", type=float, default=0.2, help="seconds of a kernel to list")
    parser.add_argument("--run", choices=("compress", "warm"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.run:
        run_and_time(options.run, options.least)
        return

    # Each run in a process of its own, since kernels stay compiled within one.
    for run in ("compress", "warm"):
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "log.csv").write_text(LOG)
            command = [sys.executable, __file__, "--run", run, "--least", str(options.least)]
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
            subprocess.run(command, cwd=folder, env=environment, check=True)


def run_and_time(run: str, least: float) -> None:
    """Do one run, and print the kernels that take the longest, and the sums."""
    from numba.core import event

    from gpszip.cli.main import main as gpszip
    from gpszip.pipeline import warm

    # Run with the events of the compiler; without processes, so that all of them are heard.
    timer = compile_timer()
    event.register("numba:compile", timer)
    if run == "compress":
        gpszip(["compress", "log.csv", "-o", "log.gpsz", "--quiet"])
    else:
        for task in warm.TASKS:
            task()

    # Print.
    print(f"\n{run}")
    for kernel, seconds in timer.seconds.most_common():
        if seconds >= least:
            print(f"{seconds:7.2f} s  {timer.signatures[kernel]:3d}  {kernel}")
    print(
        f"{timer.seconds.total():7.2f} s  {timer.signatures.total():3d}  all kernels; "
        f"{time.process_time():.1f} s of CPU for the whole run"
    )


def compile_timer() -> Any:
    """A listener of the compiler's events: ``seconds`` and ``signatures`` of each kernel."""
    from numba.core.event import Listener

    class CompileTimer(Listener):
        def __init__(self):
            self.seconds = Counter()
            self.signatures = Counter()
            self.running = []  # start, and seconds of the kernels called, of each

        def on_start(self, _):
            self.running.append([time.thread_time(), 0.0])

        def on_end(self, event):
            start, called = self.running.pop()
            total = time.thread_time() - start
            if self.running:
                self.running[-1][1] += total
            function = event.data["dispatcher"].py_func
            kernel = f"{function.__module__}.{function.__qualname__}"
            self.seconds[kernel] += total - called
            self.signatures[kernel] += 1

    return CompileTimer()


if __name__ == "__main__":
    main()
