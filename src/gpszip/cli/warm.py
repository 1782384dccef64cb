"""gpszip warm: compile all kernels now, so that the first log needn't wait."""

from __future__ import annotations

import time

import click

from gpszip.cli.options import Settings, common_options
from gpszip.cli.outcome import Outcome

__all__ = ["command"]


@click.command("warm", short_help="Compile all kernels now, so that the first log needn't wait.")
@common_options
@click.pass_obj
def command(settings: Settings) -> Outcome:
    """Compile all kernels into the cache, once for each installation.

    This takes a minute or two on up to three cores. Kernels that came with a wheel need no
    compiling.
    """
    from gpszip.cli.output import print_json, print_status
    from gpszip.cli.progress import progress_bar
    from gpszip.pipeline.warm import warm

    start = time.perf_counter()
    with progress_bar(quiet=settings.json) as listener:
        warm(listener)
    seconds = time.perf_counter() - start
    if settings.json:
        print_json({"seconds": round(seconds, 3)})
    else:
        print_status(f"compiled in {seconds:.1f} s")
    return Outcome.DONE
