"""Write segment means as GeoJSON, CSV or JSON, and read the model of one from JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpszip.errors import InputError, OutputError
from gpszip.geo.planes import to_plane
from gpszip.io.feature_tables import features_text, line_geometry
from gpszip.io.logs.track_rows import DEGREE_DIGITS
from gpszip.io.storage.sink import open_sink
from gpszip.model import MarkovModel, Plane, SegmentMean
from gpszip.model.projection import UNITS_PER_DEGREE, map_coordinates

__all__ = ["SEGMENT_FORMATS", "read_model", "segment_format", "write_segments"]

#: Formats with their suffixes; the first is that of standard output.
SEGMENT_FORMATS = {"json": (".json",), "geojson": (".geojson",), "csv": (".csv",)}

#: Decimals of metres.
_DECIMALS = 4

#: Most coordinates of a position in GeoJSON (RFC 7946, 3.1.1).
_MAX_AXES = 3

#: Value of the member ``kind`` of the JSON, by which it is known.
_KIND = "segment mean"

#: Largest model that is read, in bytes: a million segments.
_MAX_BYTES = 1 << 30

Floats = NDArray[np.float64]


def segment_format(target: str) -> str:
    """Return the format of a file from its suffix; JSON for standard output.

    Raises
    ------
    OutputError
        If there is none of this suffix.

    Examples
    --------
    >>> segment_format("parts.csv"), segment_format("-")
    ('csv', 'json')
    """
    if target == "-":
        return next(iter(SEGMENT_FORMATS))
    suffix = Path(target).suffix.lower()
    for name, suffixes in SEGMENT_FORMATS.items():
        if suffix in suffixes:
            return name
    raise OutputError(
        "can't tell the format of the segments from this name",
        path=target,
        remedy="end it with .json, .geojson or .csv, or with .png, .svg or .pdf for a picture",
    )


def write_segments(
    target: str,
    mean: SegmentMean,
    model: MarkovModel,
    parts: list[dict[str, Any]],
    facts: dict[str, Any],
) -> None:
    """Write the parts, segments and transitions of a segment mean.

    Parameters
    ----------
    target : str
        The file; ``-`` is standard output. Its suffix gives the format.
    mean : SegmentMean
        Labels of the parts.
    model : MarkovModel
        Its segments and transitions.
    parts : list of dict
        Each part: its track, samples, times and cost by name.
    facts : dict
        Members that the JSON begins with.
    """
    format_name = segment_format(target)
    if format_name == "csv":
        text = _as_csv(mean, model, parts)
    elif format_name == "geojson":
        text = _as_geojson(target, mean, model, parts)
    else:
        text = _as_json(mean, model, parts, facts)
    with open_sink(target) as sink:
        sink.write(text.encode())


def _axes(model: MarkovModel) -> list[str]:
    """Names of the coordinates."""
    if model.plane is not None:
        return ["lat", "lon"]
    return [*"xyz", *(f"x{axis}" for axis in range(4, model.dimension + 1))][: model.dimension]


def _ends(model: MarkovModel) -> tuple[list[list[float]], list[list[float]]]:
    """Start and end of each segment in the coordinates of the log."""
    decimals = _DECIMALS if model.plane is None else _DECIMALS + DEGREE_DIGITS
    starts, ends = (
        np.round(map_coordinates(points, model.plane), decimals).tolist()
        for points in (model.starts, model.ends)
    )
    return starts, ends


def _transitions(model: MarkovModel) -> list[dict[str, Any]]:
    """Each transition, with its count and probability."""
    rows = zip(
        model.transitions.tolist(),
        model.counts.tolist(),
        model.probabilities.tolist(),
        strict=True,
    )
    return [
        {"from": before, "to": after, "count": count, "probability": probability}
        for (before, after), count, probability in rows
    ]


# CSV: a row for each part.


def _as_csv(mean: SegmentMean, model: MarkovModel, parts: list[dict[str, Any]]) -> str:
    """Return the rows of the parts, each with both ends of its segment."""
    starts, ends = _ends(model)
    heads = [f"{side}_{axis}" for side in ("start", "end") for axis in _axes(model)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*parts[0], *heads])
    for part, label in zip(parts, mean.labels.tolist(), strict=True):
        writer.writerow([*part.values(), *starts[label], *ends[label]])
    return text.getvalue()


# GeoJSON: lines for segments, transitions and parts.


def _as_geojson(
    target: str, mean: SegmentMean, model: MarkovModel, parts: list[dict[str, Any]]
) -> str:
    """Return features of three kinds: segments, transitions, and parts."""
    # Positions of GeoJSON have two or three coordinates.
    if model.dimension > _MAX_AXES:
        raise OutputError(
            f"GeoJSON holds up to {_MAX_AXES} coordinates, and there are {model.dimension}",
            path=target,
            remedy="write .json or .csv",
        )

    # Properties of each feature, with both ends of its line.
    traversals = np.bincount(mean.labels, minlength=mean.m)
    rows: list[tuple[dict[str, Any], Floats, Floats]] = [
        (
            {"kind": "segment", "segment": number, "parts": int(count)},
            model.starts[number],
            model.ends[number],
        )
        for number, count in enumerate(traversals)
    ]
    rows += [
        ({"kind": "transition", **row}, model.ends[row["from"]], model.starts[row["to"]])
        for row in _transitions(model)
    ]
    rows += [
        ({"kind": "part", **part}, model.starts[part["segment"]], model.ends[part["segment"]])
        for part in parts
    ]

    # Lines, in degrees if the model is on the Earth.
    geometries = (_geometry(start, end, model.plane) for _, start, end in rows)
    is_geographic = model.plane is not None
    return features_text((row for row, *_ in rows), geometries, geographic=is_geographic)


def _geometry(start: Floats, end: Floats, plane: Plane | None) -> dict[str, Any]:
    """Return a straight line on a plane as a geometry."""
    line = np.stack([start, end])
    if plane is None:
        return line_geometry(line, _DECIMALS, geographic=False)
    degrees = map_coordinates(line, plane)
    return line_geometry(degrees, _DECIMALS + DEGREE_DIGITS, geographic=True)


# JSON: all there is.


def _as_json(
    mean: SegmentMean, model: MarkovModel, parts: list[dict[str, Any]], facts: dict[str, Any]
) -> str:
    """Return everything, with one part, segment and transition a line."""
    # Segments, and the centres of the planes that they are on.
    starts, ends = _ends(model)
    traversals = np.bincount(mean.labels, minlength=mean.m).tolist()
    segments = [
        {"segment": number, "start": start, "end": end, "parts": count, "begins": begins}
        for number, (start, end, count, begins) in enumerate(
            zip(starts, ends, traversals, model.firsts.tolist(), strict=True)
        )
    ]
    centers = None
    if model.plane is not None:
        centers = [[lat / UNITS_PER_DEGREE, lon / UNITS_PER_DEGREE] for lat, lon in _centers(model)]

    # What is said once, then lists.
    members = {
        "kind": _KIND,
        **facts,
        "coordinates": _axes(model),
        "planes": centers,
        "sigma": model.sigma,
    }
    lines = [f"{json.dumps(name)}: {_strict(value)}" for name, value in members.items()]
    for name, rows in (
        ("segments", segments),
        ("transitions", _transitions(model)),
        ("parts", parts),
    ):
        items = ",\n".join(_strict(row) for row in rows)
        lines.append(f"{json.dumps(name)}: [\n{items}\n]")
    return "{" + ",\n".join(lines) + "}\n"


def _centers(model: MarkovModel) -> tuple[tuple[int, int], ...]:
    assert model.plane is not None
    return model.plane.centers


def _strict(value: Any) -> str:
    """Return JSON without the numbers that it can't hold: those are null."""
    if isinstance(value, float) and not math.isfinite(value):
        return "null"
    return json.dumps(value, ensure_ascii=False)


def read_model(path: str) -> MarkovModel:
    """Read the Markov model of a segment mean that :func:`write_segments` wrote as JSON.

    Raises
    ------
    InputError
        If the file is not such a JSON, or numbers in it don't fit each other.
    """
    # Read.
    try:
        if Path(path).stat().st_size > _MAX_BYTES:
            raise InputError("is too large for a segment mean", path=path)
        value = json.loads(Path(path).read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise _no_model(path, f"no JSON ({error})") from error
    if not isinstance(value, dict) or value.get("kind") != _KIND:
        raise _no_model(path, "no segment mean")

    # Take what the model needs.
    try:
        return _to_model(value)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        raise _no_model(path, f"its numbers are damaged ({error})") from error


def _no_model(path: str, reason: str) -> InputError:
    return InputError(
        reason, path=path, remedy="give the JSON that gpszip segments LOG -o FILE.json wrote"
    )


def _to_model(value: dict[str, Any]) -> MarkovModel:
    """Return the model of a JSON; raise an error of Python where it holds none."""
    # The plane and the segments on it.
    plane = None
    if value["planes"] is not None:
        centers = [(float(lat), float(lon)) for lat, lon in value["planes"]]
        if not centers or not all(abs(lat) <= 90 and abs(lon) <= 180 for lat, lon in centers):
            raise ValueError("a plane is not on the globe")
        plane = Plane(
            tuple(
                (round(lat * UNITS_PER_DEGREE), round(lon * UNITS_PER_DEGREE))
                for lat, lon in centers
            )
        )
    starts, ends = (_points(value["segments"], side, plane) for side in ("start", "end"))
    m = len(starts)
    if m == 0 or starts.shape != ends.shape or starts.shape[1] != len(value["coordinates"]):
        raise ValueError("segments have different coordinates")

    # The chain, sorted by segments.
    rows = sorted((row["from"], row["to"], row["count"]) for row in value["transitions"])
    table = np.array(rows, np.int64).reshape(-1, 3)
    firsts = np.array([row["begins"] for row in value["segments"]], np.int64)
    if len(table) and not (table[:, :2].min() >= 0 and table[:, :2].max() < m):
        raise ValueError("a transition leads to a segment that there is not")
    if (table[:, 2] < 0).any() or (firsts < 0).any():
        raise ValueError("a count is below zero")
    sigma = float(value["sigma"])
    if not 0 < sigma < math.inf:
        raise ValueError(f"sigma is {sigma}")
    return MarkovModel(
        starts, ends, firsts, table[:, :2].astype(np.int32), table[:, 2], sigma, plane
    )


def _points(segments: list[dict[str, Any]], side: str, plane: Plane | None) -> Floats:
    """Return one end of all segments in metres."""
    points = np.array([segment[side] for segment in segments], np.float64)
    if points.ndim != 2 or not np.isfinite(points).all():
        raise ValueError("a segment has no position")
    if plane is None:
        return points
    placed = np.column_stack([to_plane(points[:, 0], points[:, 1], plane), points[:, 2:]])
    if not np.isfinite(placed).all():
        raise ValueError("a segment lies on no plane")
    return placed
