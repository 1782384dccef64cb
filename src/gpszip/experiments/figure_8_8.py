"""Figure 8-8: how the output of table 8.2 grows with the input, beside the thesis's own numbers."""

from __future__ import annotations

from gpszip.experiments.comparison import archive_table, pipeline_table
from gpszip.experiments.curves import Curve, draw_curves
from gpszip.experiments.experiment import Outcome, Picture, Setting
from gpszip.experiments.published import TABLE_8_2
from gpszip.experiments.table_8_2 import compare_prefixes

__all__ = ["run"]


def run(setting: Setting) -> Outcome:
    """Draw the rows of table 8.2."""
    # Percents of the log, here and in the thesis, and the sizes of texts.
    compared = compare_prefixes(setting)
    percents = [int(each.log.split()[0]) for each in compared]
    theirs = [10 * number for number in range(1, 11)]
    texts = [each.thesis.sizes for each in compared]
    logs = [each.log for each in texts]

    # Left: bytes without times. Right: ratios, and the size of the map.
    sizes = [
        Curve("waypoints + map, text", logs, [each.semantic for each in texts]),
        Curve("the same after bzip2", logs, [each.semantic_bzip2 for each in texts]),
        Curve(
            "archive without times", logs, [each.archive.bytes_without_times for each in compared]
        ),
    ]
    ratios = [
        Curve("here", percents, [each.thesis.sizes.both_ratio for each in compared]),
        Curve("thesis, own data", theirs, [row.both for row in TABLE_8_2], dashed=True),
    ]
    maps = [
        Curve("nodes, here", percents, [each.thesis.nodes for each in compared]),
        Curve("edges, here", percents, [each.thesis.edges for each in compared]),
        Curve("nodes, thesis", theirs, [row.nodes for row in TABLE_8_2], dashed=True),
        Curve("edges, thesis", theirs, [row.edges for row in TABLE_8_2], dashed=True),
    ]

    # A picture of each.
    share = "share of the log in %"
    pictures = (
        Picture(
            "left",
            "Bytes of the output over bytes of the input, both without times.",
            draw_curves(sizes, "bytes of the log as text", "bytes", log_y=True),
        ),
        Picture(
            "right",
            "Ratio of sizes after bzip2 over the share of the log.",
            draw_curves(ratios, share, "ratio, semantic + bzip2"),
        ),
        Picture(
            "map",
            "Nodes and directed edges of the map over the share of the log.",
            draw_curves(maps, share, "nodes and edges"),
        ),
    )
    return Outcome((pipeline_table(compared), archive_table(compared)), pictures)
