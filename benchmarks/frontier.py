"""Compare GPSZip with its peers: bytes over CPU seconds, at equal maximum error.

    python benchmarks/frontier.py [LOG:BOUND...] [--out docs/frontier.svg]
                                  [--efforts 1,3,5,7,9] [--limit 30] [--again CODEC]

Logs are generated unless some are named, each with a bound in metres. Every measurement is a
process of its own, and its file is decoded and checked at every sample. Prints a table of each log
and from which speed down GPSZip's files are smallest, and draws a figure.

Results are kept in a JSON file beside the figure: what is there is not measured again. ``--again``
names codecs to measure anew, such as ``gpszip``, or ``all``. A level is left out if the one before
it took more CPU seconds than ``--limit``.

The peers need the extra ``benchmarks``: ``pip install '.[benchmarks]'``. A codec whose package is
missing is named and left out.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from comparing.codecs import Codec, list_codecs
from comparing.logs import Case, generated_cases, named_case, write_tiny
from comparing.measure import MeasurementError, measure
from comparing.report import write_table, write_verdict
from comparing.results import Results, missing, read_results


def main() -> int:
    arguments = parse()
    codecs = list_codecs(tuple(arguments.efforts.split(",")))
    results = read_results(arguments.out.with_suffix(".json"), arguments.again)
    with tempfile.TemporaryDirectory() as name:
        # The logs, and what is not known of them.
        folder = Path(name)
        named = [named_case(folder, argument) for argument in arguments.logs]
        cases = named or generated_cases(folder)
        for case in cases:
            results.open_log(case)
        failures = measure_missing(results, cases, codecs, write_tiny(folder), arguments.limit)

    # Tables, verdicts and the figure.
    results.keep_only([case.title for case in cases])
    for title in results.logs:
        print("", *write_table(results, title, codecs), "", sep="\n")
    for title in results.logs:
        print(*write_verdict(results, title, codecs), sep="\n")
    from comparing.figure import draw

    draw(results, codecs, arguments.out)
    return 1 if failures else 0


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("logs", nargs="*", metavar="LOG:BOUND", help="a log and metres")
    parser.add_argument("--out", type=Path, default=Path("docs/frontier.svg"), help="the figure")
    parser.add_argument("--efforts", default="1,3,5,7,9", help="efforts of GPSZip")
    parser.add_argument("--limit", type=float, default=30.0, help="CPU seconds of a level")
    parser.add_argument("--again", action="append", default=[], metavar="CODEC", help="or all")
    return parser.parse_args()


def measure_missing(
    results: Results, cases: list[Case], codecs: list[Codec], tiny: Path, limit: float
) -> int:
    """Measure what is not known; return the number of failures."""
    failures = 0
    for case, codec, level in missing(results, cases, codecs):
        # The level before tells how long this one may take.
        name = f"{case.title}: {codec.name} {level}"
        before = [result["seconds"] for _, result in results.points_of(case.title, codec)]
        if max(before, default=0.0) > limit:
            print(f"{name}: left out, the level before took {max(before):.0f} s", file=sys.stderr)
            continue

        # Measure it; what fails is named, and the others follow.
        try:
            result = measure(codec.name, level, tiny, case)
        except MeasurementError as error:
            print(f"{name}: {error}", file=sys.stderr)
            failures += 1
            continue
        results.add(case.title, f"{codec.name} {level}", result)
        print(f"{name}: {result['bytes']:,} B, {result['seconds']:.2f} s", flush=True)
    return failures


if __name__ == "__main__":
    sys.exit(main())
