"""Tables of bytes and CPU seconds, and where GPSZip leads."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .codecs import Codec
from .results import Results

#: CPU seconds below this are measured too roughly for a rate.
SHORTEST = 1e-3


def rate(points: int, result: dict[str, Any]) -> float:
    """Points per CPU second after the start-up."""
    return points / max(result["seconds"], SHORTEST)


def write_table(results: Results, title: str, codecs: list[Codec]) -> Iterator[str]:
    """Lines of a Markdown table of one log."""
    log = results.logs[title]
    tracks = f"{log['tracks']:,} track{'s' * (log['tracks'] > 1)}"
    yield f"{title}: {log['points']:,} points, {tracks}, {log['bound']:g} m"
    yield ""
    yield "| codec | bytes | by coder | CPU s | start-up | points/s | maximum error |"
    yield "|---|---|---|---|---|---|---|"
    for codec in codecs:
        for level, result in results.points_of(title, codec):
            name = codec.label if level == "samples" else f"{codec.label}, {level}"
            sizes = ", ".join(f"{coder} {size:,}" for coder, size in result["sizes"].items())
            yield (
                f"| {name} | {result['bytes']:,} | {sizes} | {result['seconds']:.2f} "
                f"| {result['startup']:.2f} | {rate(log['points'], result):,.0f} "
                f"| {result['error']:.3f} m |"
            )


def write_verdict(results: Results, title: str, codecs: list[Codec]) -> Iterator[str]:
    """Lines that say from which speed down GPSZip's files are smallest, and which peers win."""
    # Rates and sizes of both sides.
    log = results.logs[title]
    ours, peers = [], []
    for codec in codecs:
        for level, result in results.points_of(title, codec):
            side = ours if codec.name == "gpszip" else peers
            side.append((rate(log["points"], result), result["bytes"], f"{codec.label} {level}"))
    if not ours or not peers:
        return

    # At any speed, the smallest file among those that are made as fast; GPSZip leads where its is.
    fastest = leading_rate(ours, peers)
    if fastest > 0:
        yield f"{title}: GPSZip's files are smallest from {fastest:,.0f} points/s down."
    else:
        yield f"{title}: a peer's files are smallest."

    # Peers that are both faster and smaller than some effort.
    for speed, size, name in ours:
        winners = [peer for rate, bytes_, peer in peers if rate >= speed and bytes_ <= size]
        if winners:
            yield f"{title}: faster and smaller than {name}: {', '.join(winners)}."


def leading_rate(ours: list[tuple[float, int, str]], peers: list[tuple[float, int, str]]) -> float:
    """Largest rate from which down the smallest file is GPSZip's; 0 if there is none."""
    leading = 0.0
    for limit in sorted({entry[0] for entry in ours + peers}):
        best = min((e[1] for e in ours if e[0] >= limit), default=float("inf"))
        if best >= min((e[1] for e in peers if e[0] >= limit), default=float("inf")):
            break
        leading = limit
    return leading
