"""JSON schemas of what commands print with ``--json``, one for each command.

A field is a text ``TYPES: description``, with the types of JSON joined by ``|``, or a schema.
Lengths are in metres, times in seconds, sizes in bytes. Numbers that are not finite are null.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

__all__ = ["ERROR", "EVENT", "SCHEMAS"]

#: The draft of JSON Schema in which the schemas are written.
_DRAFT = "https://json-schema.org/draft/2020-12/schema"

Schema: TypeAlias = dict[str, Any]
Fields: TypeAlias = Mapping[str, "str | Schema"]


def _field(spec: str | Schema) -> Schema:
    """Return the schema of a field."""
    if not isinstance(spec, str):
        return spec
    types, _, text = spec.partition(": ")
    names = types.split("|")
    return {"type": names[0] if len(names) == 1 else names, "description": text}


def _object(fields: Fields, text: str = "", optional: Fields | None = None) -> Schema:
    """Return the schema of an object with exactly these fields; optional ones may be missing."""
    schema: Schema = {"type": "object"}
    if text:
        schema["description"] = text
    properties = {**fields, **(optional or {})}
    schema["properties"] = {name: _field(spec) for name, spec in properties.items()}
    schema["required"] = list(fields)
    schema["additionalProperties"] = False
    return schema


def _list(item: str | Schema, text: str) -> Schema:
    return {"type": "array", "items": _field(item), "description": text}


def _table(value: str, text: str) -> Schema:
    """Return the schema of an object whose keys are not known before."""
    return {"type": "object", "additionalProperties": _field(value), "description": text}


#: What was repaired and left out while reading.
_REPAIRS: Fields = {
    "repairs": _list(
        _object(
            {
                "what": "string: the problem, and what was done about it",
                "count": "integer: points (or tracks) concerned",
                "where": "string: the log, with the first row concerned if that is known",
                "drops": "boolean: whether these points were dropped",
                "value": "string: the first value concerned; empty if there is none to show",
            }
        ),
        "what readers changed",
    ),
    "left_out": _list(
        _object({"name": "string: the log, or an item in it", "reason": "string: why"}),
        "what was not read",
    ),
}

#: What reading lost.
_LOSSES: Fields = {
    "points_read": "integer: points of the logs, or of the selection",
    "points_not_selected": "integer: points that the selection leaves out",
    "points_lost": "integer: points that are in no track",
    "losses": _list(
        _object(
            {
                "track": "string: the track; empty for rows of no known track",
                "where": "string: the log",
                "lost": "integer: points that can't be used",
                "points": "integer: points of the track in the log",
                "shared": "integer: most points that share one time; 0 if none do",
            }
        ),
        "tracks that lost many points",
    ),
    "other_files": _list(
        _object(
            {
                "where": "string: the folder or zip archive",
                "what": "string: which files, such as: without positions",
                "count": "integer: how many",
                "kinds": _table("integer: files", "how many have each suffix"),
            }
        ),
        "files of folders and zip archives that hold no log, or one that another file has, too",
    ),
}

_READ: Fields = {**_LOSSES, **_REPAIRS}
_OUTPUT: Fields = {"output": "string: the file that was written; - is standard output"}
_NOTES: Fields = {"notes": _list("string: a sentence", "what the user should know")}
_DROPPED: Fields = {"dropped": _list("string: a column", "columns that are not kept")}

_BOUND: Fields = {
    "error_bound": "string|null: rmse or max_error; null without a bound",
    "error_bound_m": "number|null: the bound in metres",
    "error_bound_max_m": "number|null: the maximum beside an RMSE in metres",
}

_COMPRESSION: Fields = {
    "points": "integer: samples that went in",
    "tracks": "integer: tracks that went in",
    "bytes_in": "integer: size of the logs as stored",
    "bytes_out": "integer: size of the archive",
    "ratio": "number: bytes_in / bytes_out",
    "rmse": "number: root mean square error in metres, measured after decoding",
    "max_error": "number|null: largest error of any sample in metres, measured after decoding; "
    "null for a coreset",
    "bound": "string: the bound that was held; empty if there was none",
    "gap": "number|null: longer intervals, in seconds, are gaps; null for none",
    "seconds": "number: time on the clock",
    "segments": "integer: straight segments of all walks",
    "nodes": "integer: nodes of the map",
    "edges": "integer: edges of the map",
    **_NOTES,
    **_READ,
    **_DROPPED,
}

_STREAM: Fields = {
    "lines": "integer: lines that were read",
    "points": "integer: samples that went in",
    "lost": "integer: lines and rows that could not be used",
    "batches": "integer: times that the archive was written",
    "tracks": "integer: tracks of the archive",
    "bytes_out": "integer: size of the archive",
    "rmse": "number: root mean square error of the samples that went in, in metres",
    "max_error": "number: their largest error in metres",
    "bound": "number|null: the error in metres that the archive states",
    "nodes": "integer: nodes of the archive's map",
    "edges": "integer: its edges",
    "counts": {
        "type": "object",
        "additionalProperties": {"type": "integer"},
        "description": "rows and lines that were left out or put elsewhere, by what was done",
    },
}

_DRY_RUN: Fields = {
    "dry_run": {"const": True, "description": "nothing was written"},
    "output": "string: the file that would be written",
    "files": _list(
        _object(
            {
                "name": "string: the file",
                "format": "string|null: its format; null if it can't be read",
                "bytes": "integer: its size as stored",
            }
        ),
        "the logs",
    ),
    "points": "integer: samples that would go in",
    "tracks": "integer: tracks that would go in",
    "coordinates": "string: lat,lon or x,y or x,y,z or x0,x1,...",
    "t_start": "number|null: first time in seconds; null without times",
    "t_end": "number|null: last time in seconds; null without times",
    "gap": "number|null: longer intervals, in seconds, are gaps; null for none",
    "bytes_in": "integer: size of the logs as stored",
    "bound": "string: the bound that would be held; empty if there is none",
    "estimated_bytes": "integer|null: size of the archive; null if it is not estimated",
    "estimated_cpu_seconds": "number|null: CPU time of the command; null if it is not estimated",
    "sampled_points": "integer: samples that were compressed for the estimate; all of a small log",
    **_NOTES,
    **_READ,
    **_DROPPED,
}

_INFO: Fields = {
    "archive": "string: the file",
    "bytes": "integer: its size",
    "version": "integer: version of the format",
    "form": "string: which of the forms of the format it has",
    "layer": "string|null: bz2 if it is packed once more",
    "groups": "integer: groups of tracks that are decoded by themselves",
    "sections": _list(
        _object({"kind": "string: what it holds", "bytes": "integer: its size"}),
        "parts of the file",
    ),
    "tracks": "integer: tracks",
    "ids": _list("string: a track", "names of the tracks"),
    "dimension": "integer: coordinates of a position",
    "geographic": "boolean: whether positions are latitude and longitude",
    "node_step_m": "number: resolution of positions in metres",
    "time_step_s": "number: resolution of times in seconds",
    "kept": {
        "type": ["array", "null"],
        "items": {"type": "string"},
        "description": "columns kept exactly, with the times of the samples; null if none are",
    },
    "map": "string|null: hash of the archive that holds the map; null if it is in this one",
    **_BOUND,
    "sampling_s": "number|null: typical interval between two samples in seconds",
    "timed": "boolean: whether tracks have times",
    "epoch": "number: zero of the archive's times, in seconds",
    "origin": _list("number: a coordinate", "zero of the archive's positions in metres"),
    "planes": _list(_list("number: degrees", "latitude and longitude"), "centres of planes"),
    "exact_logs": _list("string: a log", "logs kept byte by byte"),
    "curves": _list(
        _object(
            {
                "name": "string: the column",
                "bound": "number: largest error at any sample",
                "bytes": "integer: what it takes",
            }
        ),
        "columns kept within an error",
    ),
}

#: Distances between positions at one time.
_DISTANCES: Fields = {
    "mean": "number|null: mean distance in metres",
    "rmse": "number|null: root of the mean square in metres",
    "percentile_95": "number|null: distance in metres that 95 % don't exceed",
    "maximum": "number|null: largest distance in metres",
    "compared": "integer: times that were compared",
}

#: Edges of a route.
_ROUTE = _list(
    _object(
        {
            "edge": "integer: edge of the map",
            "forward": "boolean: whether it is travelled from its start to its end",
        }
    ),
    "edges of the map and directions of travel, in order",
)

#: Something unusual, for gpszip unusual.
_ANOMALY: Fields = {
    "track_id": "string: name of the track",
    "kind": {
        "enum": ["route", "wrong direction", "off the map", "slow", "fast", "stop", "absence"],
        "description": "what is unusual",
    },
    "t_start": "number: seconds at which it begins",
    "t_end": "number: seconds at which it ends",
    "score": "number: bits; each doubles the surprise",
    "reason": "string: what is unusual, for people",
    "coded_bits": "number|null: bits of its path by the archive's coder, if asked",
    "position": _list("number", "latitude and longitude, or x and y; empty for an absence"),
    "edges": _ROUTE,
}

#: What gpszip unusual says.
_UNUSUAL: Fields = {
    "trips": _list(
        _object(
            {
                "track_id": "string: name of the track",
                "t_start": "number: seconds at which it begins",
                "t_end": "number: seconds at which it ends",
                "score": "number: bits; each doubles the surprise",
                "reason": "string: what is the most unusual of it",
                "coded_bits": "number|null: bits of its path by the archive's coder, if asked",
                "parts": _list(_object(_ANOMALY), "its unusual parts, the most unusual first"),
            }
        ),
        "trips, the most unusual first",
    ),
    "absences": _list(_object(_ANOMALY), "hours at which agents always travel, and did not"),
    "alarm": "number: bits from which a trip counts as unusual",
    "alarms": "integer: trips with so many bits or more",
    "alarms_per_agent_and_day": "number|null: these for each agent and day with a trip",
    "delay": "number|null: median seconds from the begin of what is unusual to its end",
    "read": _object(_READ, "what reading the log lost and repaired"),
    "output": "string|null: the table",
}

#: What gpszip predict says.
_PREDICT: Fields = {
    "tracks": _list(
        _object(
            {
                "track_id": "string: name of the track",
                "t": "number|null: seconds of its last position",
                "edge": "integer|null: edge of the map that it travels; null off the map",
                "forward": "boolean|null: whether it travels it from its start to its end",
                "next": _list(
                    _object(
                        {
                            "edge": "integer: edge of the map",
                            "forward": "boolean: direction of travel",
                            "probability": "number: from 0 to 1",
                        }
                    ),
                    "edges that may follow, the likeliest first",
                ),
                "routes": _list(
                    _object({"edges": _ROUTE, "probability": "number: from 0 to 1"}),
                    "likeliest routes over the next edges",
                ),
                "destinations": _list(
                    _object(
                        {
                            "node": "integer: node of the map",
                            "probability": "number: from 0 to 1",
                            "position": _list("number", "latitude and longitude, or x and y"),
                            "arrival": {
                                "anyOf": [
                                    _object(
                                        {
                                            "seconds": "number: seconds from the last position",
                                            "low": "number: a tenth arrives earlier",
                                            "high": "number: a tenth arrives later",
                                            "metres": "number: length of the way",
                                            "route": _ROUTE,
                                        }
                                    ),
                                    {"type": "null"},
                                ],
                                "description": "null if no way leads there, or without times",
                            },
                        }
                    ),
                    "where the trip may end, the likeliest first",
                ),
            }
        ),
        "tracks of the log, or of the archive",
    ),
    "read": {
        "anyOf": [_object(_READ), {"type": "null"}],
        "description": "what reading the log lost and repaired; null without one",
    },
    "output": "string|null: the table",
}

#: What gpszip usage says.
_USAGE: Fields = {
    "edges": "integer: edges of the clean map",
    "traversals": "integer: traversals of edges",
    "tracks": "integer: tracks",
    "length": "number: metres travelled",
    "dwell": "number: seconds of standing",
    "rows": "integer: rows of the table",
    "by": _list("string: a part of local time", "parts by which rows are split"),
    "timezone": "string|null: time zone of hours; null where times are no dates",
    "timezone_from": {
        "enum": ["option", "place", "default", "log"],
        "description": "who said it; log: hours count from the log's zero",
    },
    "repeated": "number: share of the metres on edges that were travelled before",
    "repeated_by_track": "number: the same, by the same track",
    "transitions": "integer: transitions from edge to edge",
    "smoothing": "number: added to the count of each exit of a node",
    "likelihood": {
        "anyOf": [
            _object(
                {
                    "log_likelihood": "number: natural logarithm of the probability of the log",
                    "transitions": "integer: transitions of the log",
                    "bits_per_transition": "number|null: mean of -log2 of the probabilities",
                }
            ),
            {"type": "null"},
        ],
        "description": "of the log of --likelihood",
    },
    "agents": _list(
        _object(
            {
                "track": "string: its name",
                "traversals": "integer: traversals with a speed",
                "relative_speed": "number: median of its speed over that of all",
                "cluster": "integer: 0 is slowest; -1 where there are few traversals",
            }
        ),
        "speeds of the tracks relative to each other",
    ),
    "read": {
        "anyOf": [_object(_READ), {"type": "null"}],
        "description": "what reading a log lost and repaired; null for an archive",
    },
    "output": "string|null: the table",
    "transitions_output": "string|null: the table of transitions",
}

#: What gpszip route says.
_PLAN: Fields = {
    "by": "string: what the routes minimise",
    "depart": "number|null: departure in seconds, in the log's zero",
    "timezone": _USAGE["timezone"],
    "timezone_from": _USAGE["timezone_from"],
    "routes": _list(
        _object(
            {
                "length": "number: metres",
                "seconds": "number|null: expected seconds; null without times in the log",
                "seconds_low": "number|null: 10 % of drives take less",
                "seconds_high": "number|null: 10 % of drives take more",
                "traversals": "integer: traversals of its least travelled edge",
                "edges": _list("integer: an edge", "edges of the clean map"),
                "forward": _list("boolean: from its start to its end", "directions"),
            }
        ),
        "the best one first",
    ),
    "output": "string|null: the routes",
    "read": _USAGE["read"],
}

#: What gpszip changes says.
_CHANGES: Fields = {
    "since": "number: first time after, in seconds",
    "days": "number: days after",
    "threshold": "number: nats of evidence for a closure",
    "false_alarms": "number|null: false alarms a day that it was chosen for; null if it was given",
    "changes": _list(
        _object(
            {
                "kind": "string: closed, reopened, new, moved, slower, faster or one-way",
                "edge": "integer: edge of the clean map",
                "forward": "boolean: direction concerned, from the start of the edge to its end",
                "since": "number: when it was first seen, in seconds",
                "detected": "number: when the evidence sufficed",
                "delay": "number: seconds from one to the other",
                "evidence": "number: nats",
                "agents": "integer: missed passages, passages, or observations of a speed",
                "factor": "number|null: travel time now over that before",
                "other": "integer: new edge of a moved one; else -1",
            }
        ),
        "by kind and time",
    ),
    "output": "string|null: the table",
    "read": {
        "type": "array",
        "items": {"anyOf": [_object(_READ), {"type": "null"}]},
        "description": "what reading OLD and NEW lost and repaired; null for an archive",
    },
}

#: What gpszip rounds says.
_ROUNDS: Fields = {
    "rounds": "integer: complete rounds",
    "complete": "integer: those that cover the usual round",
    "usual": _list(
        _object(
            {
                "edge": "integer: edge of the clean map",
                "forward": "boolean: whether it is travelled from its start to its end",
            }
        ),
        "the usual round in the order of travel",
    ),
    "length": "number: its metres",
    "duration": "number|null: median seconds of a round; null without times",
    "regularity": "number: share of travel that the usual round tells",
    "output": "string|null: the table of rounds",
    "edges_output": "string|null: the table of edges",
    "read": _USAGE["read"],
}

#: Latitude and longitude, or x and y in metres: an archive has one pair.
_POSITION: Fields = {
    "lat": "number: degrees",
    "lon": "number: degrees",
    "x": "number: metres",
    "y": "number: metres",
}


def _or_null(fields: Fields, text: str) -> Schema:
    """Return the schema of an object with these fields, or null where it can't be told."""
    return {"anyOf": [_object(fields), {"type": "null"}], "description": text}


def _list_or_null(fields: Fields, text: str, optional: Fields | None = None) -> Schema:
    """Return the schema of a list of objects, or null where it can't be told."""
    items = _object(fields, optional=optional)
    return {"type": ["array", "null"], "items": items, "description": text}


#: What gpszip report says of travel as a whole.
_REPORT_TOTALS: Fields = {
    "archive": _object(
        {
            "bytes": "integer: its size",
            "tracks": "integer: its tracks",
            "points": "integer|null: points of the log, where it is named",
            "error_bound": "string|null: the error bound",
            "error_bound_m": "number|null: the bound in metres",
            "gaps": "integer: gaps of its tracks",
        },
        "the archive",
    ),
    "period": _or_null(
        {
            "start": "number: first time in seconds",
            "end": "number: last time",
            "days": "integer: local dates from the first to the last",
            "days_with_travel": "integer: those on which something moved",
            "timezone": "string|null: whose hours are told; null where times are no dates",
            "timezone_from": "string: option, place, default or log",
            "since": "number|null: time from which on changes are told",
        },
        "from when to when; null without times",
    ),
    "travel": _or_null(
        {
            "tracks": "integer: tracks that move",
            "metres": "number: way travelled on the map",
            "moving_s": "number: seconds in motion",
            "speed": "number|null: metres a second in motion",
            "jumps": "integer: traversals too fast to be travel, which have no speed",
            "max_speed": "number|null: metres a second above which they are",
            "edges": "integer: edges of the clean map",
            "network_metres": "number: their length",
            "repeated": "number|null: share of the way on edges travelled before",
        },
        "all travel; null if nothing moves",
    ),
}

#: What gpszip report says of each part of the history.
_REPORT_PARTS: Fields = {
    "trips": _or_null(
        {
            "trips": "integer: trips from place to place",
            "stays": "integer: stays",
            "places": "integer: places",
            "median_length": "number|null: metres",
            "median_duration": "number|null: seconds",
            "unseen": "integer: changes of place in gaps",
            "doubtful": "integer: single fixes far off that are left out",
            "pairs": _list(
                _object(
                    {
                        "from": "integer: place",
                        "to": "integer: place",
                        "trips": "integer: trips between them",
                    }
                ),
                "the most frequent ways",
            ),
        },
        "trips",
    ),
    "activity": _or_null(
        {
            "unit": "string: hour, day, week or month",
            "first": "integer: number of the first one, since 1970 or the log's zero",
            "starts": _list("string: a date, or a number", "when each begins"),
            "trips": {
                "type": ["array", "null"],
                "items": {"type": "integer"},
                "description": "trips that begin in each; null if there are none",
            },
            "metres": _list("number: metres", "way travelled in each"),
        },
        "how much happens when",
    ),
    "places": _list_or_null(
        {
            "place": "integer: number of the place",
            "visits": "integer: stays",
            "dwell_s": "number: seconds of all stays",
            "usual": "string: usual hours",
            "role": "string: home, work or nothing",
            "evidence": "string: why",
            "arrivals": "integer: trips to it",
            "departures": "integer: trips from it",
        },
        "places by the time spent there",
        _POSITION,
    ),
    "hours": {
        "type": ["array", "null"],
        "items": {"type": "number"},
        "description": "metres travelled in each hour of the week, from Monday 0 o'clock",
    },
    "speeds": _list_or_null(
        {
            "hour": "integer: hour of the day",
            "traversals": "integer: traversals with a speed",
            "speed_q1": "number: first quartile in metres a second",
            "speed": "number: median",
            "speed_q3": "number: third quartile",
        },
        "speeds by hour, without standing",
    ),
    "edges": _list_or_null(
        {
            "edge": "integer: edge of the clean map",
            "length": "number: metres",
            "forward": "integer: traversals from its start to its end",
            "backward": "integer: traversals the other way",
            "speed": "number|null: median metres a second",
        },
        "the edges that are travelled most, with their middles",
        _POSITION,
    ),
    "changes": _or_null(
        {
            "since": "number: time from which on they are told",
            "days": "number: days compared with the time before",
            "threshold": "number: nats of evidence",
            "expected_false": "number: false alarms of closures to be expected",
            "changes": "integer: all changes",
            "rows": _list(
                _object(
                    {
                        "kind": "string: closed, reopened, new, moved, slower, faster or one-way",
                        "edge": "integer: edge of the clean map",
                        "forward": "boolean: direction concerned",
                        "since": "number: seconds of the first sign",
                        "evidence": "number: nats",
                        "agents": "integer: observations",
                        "factor": "number|null: travel time now over that before",
                    },
                    optional=_POSITION,
                ),
                "those with the most evidence",
            ),
        },
        "changes of the map",
    ),
    "unusual": _or_null(
        {
            "trips": "integer: trips that were scored",
            "left_out": "integer: those before since",
            "usual": "integer: those of very many that a first look found to be usual",
            "rows": _list(
                _object(
                    {
                        "track": "string: the track",
                        "start": "number: seconds",
                        "end": "number: seconds",
                        "score": "number: bits",
                        "reason": "string: what is unusual",
                    },
                    optional=_POSITION,
                ),
                "the most unusual trips",
            ),
        },
        "unusual trips",
    ),
    "rounds": _or_null(
        {
            "edges": "integer: edges of the usual round",
            "length": "number: its metres",
            "duration": "number|null: median seconds",
            "regularity": "number: share of travel that it tells",
            "rounds": "integer: rounds",
            "complete": "integer: those that cover it",
            "durations": _list(
                _object(
                    {
                        "seconds": "number|null: duration",
                        "complete": "boolean: whether it covers the usual round",
                    }
                ),
                "the latest rounds",
            ),
            "rows": _list(
                _object(
                    {
                        "track": "string: the track",
                        "round": "integer: number of the round",
                        "start": "number|null: seconds",
                        "share": "number: share of the usual round",
                        "late_s": "number|null: seconds longer than the median",
                        "missed": _list("integer: an edge", "edges that it misses"),
                    }
                ),
                "rounds that cover least",
            ),
        },
        "rounds of a patrol",
    ),
    "prediction": _or_null(
        {
            "decisions": "integer: decisions at crossings",
            "right": "number: share of them whose likeliest edge was taken",
            "bits": "number: mean bits of the edge that was taken",
        },
        "how well the next edge is foreseen",
    ),
    "cannot_tell": _table("string: the reason", "parts that can't be told"),
}

#: What gpszip report says.
_REPORT: Fields = {
    **_OUTPUT,
    "bytes": "integer: size of the page",
    "name": "string: title of the page",
    **_REPORT_TOTALS,
    **_REPORT_PARTS,
    "read": _USAGE["read"],
}

#: What gpszip diff says of one track.
_TRACK_DIFFERENCE: Fields = {
    "id": "string: the track",
    "compared_at": "string|null: whose times were compared",
    "distances": _object(_DISTANCES, "distances at one time"),
    "at": "number|null: time of the largest distance in seconds",
    "hausdorff": "number|null: Hausdorff distance of the lines in metres",
    "frechet": "number|null: Fréchet distance in metres",
    "discrete_frechet": "number|null: discrete Fréchet distance in metres",
    "within": "number: by how much both may be off, in metres",
    "discrete_within": "number: by how much the discrete one may be off, in metres",
    "lengths": _list("number: metres", "length of A and of B"),
    "durations": _list("number: seconds", "duration of A and of B without gaps"),
    "unmatched": _list("integer: samples", "samples of A and of B without counterpart"),
    "alone": _list(
        _list(_list("number: seconds", "begin and end"), "time ranges"),
        "when only A travels, and when only B",
    ),
}

#: A place where A and B are far apart.
_FAR_PLACE: Fields = {
    "id": "string: the track",
    "time": "number: seconds",
    "distance": "number: metres",
    "first": _list("number: a coordinate", "position in A"),
    "second": _list("number: a coordinate", "position in B"),
}

#: What is known after decoding.
_DETAIL: Fields = {
    "nodes": "integer: nodes of the map",
    "edges": "integer: edges of the map",
    "segments": "integer: straight segments of all walks",
    "waypoints": "integer: nodes between which shortest paths give the walks",
    "gaps": "integer: gaps in all tracks",
    "untimed": _list("string: a track", "tracks without times"),
    "t_start": "number|null: first time in seconds; null without times",
    "t_end": "number|null: last time in seconds; null without times",
    "bounds": _table("array: smallest and largest value", "extent of the map by coordinate"),
}

_MATCH: Fields = {
    "points": "integer: samples",
    "tracks": "integer: tracks",
    "matched": "number|null: share of the samples on a road",
    "pieces": "integer: unbroken pieces of routes",
    "length": "number: length of all routes in metres",
    "error": "number|null: typical distance to the roads in metres",
    "sigma": "number|null: scale of the distance to the roads in metres",
    "beta": "number|null: scale of how much longer paths are than straight lines, in metres",
    "heading": "number|null: spread of headings in degrees; null if they are not used",
    "headings_ignored": _list("string: a track", "tracks whose headings don't follow the roads"),
    "breaks": _table("integer: breaks", "why routes break"),
    "unmatched": _table("integer: samples", "why samples are on no road"),
    "one_way": _list("string: a road", "roads that samples travel the wrong way"),
    "seconds": "number: time on the clock",
    **_READ,
}

_PATCH: Fields = {
    "points": "integer: samples of the log",
    "tracks": "integer: tracks",
    "gap": "number|null: longer intervals, in seconds, are gaps",
    "gaps": "integer: gaps",
    "filled": "integer: gaps that were filled",
    "added": "integer: points that were added",
    "open": _list(
        _object(
            {
                "track": "string: the track",
                "from": "number: time at which the gap begins, in seconds",
                "seconds": "number: its length",
                "reason": "string: why it is open",
            }
        ),
        "gaps that were left open",
    ),
    "seconds": "number: time on the clock",
    **_READ,
}

_MERGE: Fields = {
    "archives": _list(
        _object(
            {
                "name": "string: the file",
                "moved_rms": "number: root mean square by which its tracks were moved, in metres",
                "moved_max": "number: largest distance by which they were moved, in metres",
            }
        ),
        "what was merged",
    ),
    "tracks": "integer: tracks",
    "segments": "integer: straight segments of all walks",
    "nodes": "integer: nodes of the new map",
    "edges": "integer: edges of the new map",
    "nodes_in": "integer: nodes of all maps before",
    "edges_in": "integer: edges of all maps before",
    "bytes_in": "integer: size of all archives before",
    "bytes_out": "integer: size of the new archive",
    "allowed": "number: how far tracks might be moved, in metres",
    "allowed_kind": {"enum": ["rms", "max"], "description": "what allowed bounds"},
    **_BOUND,
    "seconds": "number: time on the clock",
    **_NOTES,
    "left_out": _table("string: why", "archives that can't be read"),
}

#: A place, as a row of trips --places. Hours and weekdays are missing where times are no dates.
_PLACE = {
    "type": "object",
    "description": "lat and lon, or x, y and z; h00 to h23 and mon to sun are seconds spent there",
    "properties": {
        "place": _field("integer: number, by the time spent there"),
        "spread": _field("number: root mean square distance of its stays in metres"),
        "visits": _field("integer: stays"),
        "dwell_s": _field("number: seconds of all stays"),
        "first": _field("number|null: begin of the first stay"),
        "last": _field("number|null: end of the last stay"),
        "departures": _field("integer: trips from there"),
        "arrivals": _field("integer: trips to there"),
        "role": _field("string: home, work or empty, by the hours of stays"),
        "evidence": _field("string: the counts behind the role"),
        "usual_hours": _field("string: local hours such as 0-7, 18-24"),
    },
    "required": ["place", "spread", "visits", "dwell_s", "first", "last", "role", "evidence"],
    "additionalProperties": _field("number: a coordinate, or seconds of an hour or weekday"),
}

#: What gpszip trips found.
_TRIPS: Fields = {
    "output": "string|null: file of stays and trips; - is standard output",
    "places_output": "string|null: file of places; - is standard output",
    "trips": "integer: trips",
    "stays": "integer: stays",
    "length": "number: metres of all trips",
    "moving_s": "number: seconds in motion of all trips",
    "unseen": "integer: changes of place in gaps, which are no trips",
    "doubtful": "integer: single fixes far off between gaps, which are left out",
    "timezone": "string|null: time zone of local hours; null where times are no dates",
    "timezone_from": {
        "enum": ["option", "place", "default", None],
        "description": "who said the time zone",
    },
    "places": _list(_PLACE, "places, by the time spent there"),
    "matrix": _list(
        _object(
            {
                "from": "integer: number of a place",
                "to": "integer: number of a place",
                "trips": "integer: trips from the one to the other",
                "median_s": "number: median of their durations in seconds",
            }
        ),
        "trips between places, most frequent first",
    ),
    "read": {
        "anyOf": [_object(_READ), {"type": "null"}],
        "description": "what reading the log lost and repaired; null for an archive",
    },
}

_CORESET: Fields = {
    "samples": "integer: samples of the log",
    "tracks": "integer: tracks",
    "blocks": "integer: blocks of the coreset",
    "points": "integer|null: weighted points that were written; null for a coreset",
    "rmse": "number: RMSE of the best line of each block, in metres",
    "largest": "number: largest cost of a block's best line, in square metres",
    "k": "integer|null: segments for which eps holds",
    "eps_asked": "number|null: the eps that was asked for",
    "eps": "number|null: share by which the cost of k segments is known; null if nothing is",
    "least_cost": "number|null: least cost of any k segments, in square metres",
    "uneven_blocks": "integer: blocks of uneven times",
    **_READ,
}

_SEGMENTS: Fields = {
    "k": "integer: parts",
    "m": "integer: segments that they share",
    "points": "integer: samples of the logs",
    "tracks": "integer: tracks",
    "runs": "integer: tracks, and pieces between gaps",
    "gap": "number|null: longer intervals, in seconds, are gaps; null for none",
    "cost": "number: fitting cost in square metres; of a coreset, its estimate",
    "cost_bounds": {
        "type": ["array", "null"],
        "items": {"type": "number"},
        "description": "bounds on the cost by the coreset; null without one",
    },
    "least_cost": "number|null: bound on the cost of any k segments; null without a coreset",
    "rmse": "number: root mean square error in metres; at most that for a coreset alone",
    "max_error": "number|null: largest error of any sample in metres; null for a coreset alone",
    "log_likelihood": "number: natural logarithm of the likelihood under the Markov model",
    "log_likelihood_transitions": "number: share of it of the transitions between segments",
    "log_likelihood_samples": "number: share of it of the samples about the segments",
}

_NETWORK: Fields = {
    "bytes": "integer: size of the file",
    "seconds": "number: time on the clock",
    "roads": "integer: roads",
    "nodes": "integer: nodes",
    "length": "number: length of all roads in metres",
    "one_way": "integer: roads that may be travelled one way only",
    "with_speed": "integer: roads with a speed",
    "components": "integer: connected components",
    "geographic": "boolean: whether coordinates are latitude and longitude",
    **_REPAIRS,
}

_FORMATS: Fields = {
    "logs": _list(
        _object(
            {
                "name": "string: for --format",
                "suffixes": _list("string: such as .csv", "suffixes of its files"),
                "about": "string: what is read",
                "write": "boolean: whether it can be written",
                "batches": "boolean: whether it is read in batches, and so may exceed the memory",
                "extra": "string: extra that it needs; empty if it needs none",
            }
        ),
        "formats of logs",
    ),
    "maps": _list("string: a suffix", "formats of maps that can be written"),
    "networks": _list("string: a suffix", "formats of roads that can be read"),
}

_PLOT: Fields = {
    "kind": "string: what was drawn",
    "width_mm": "number: width of the picture",
    "height_mm": "number: height of the picture",
}

#: Of a log that was read as well, what that lost. Without a log, these fields are missing.
_VIEW_LOG: Fields = {
    "points": "integer: samples of the log",
    "points_drawn": "integer: samples that the page holds",
    **_READ,
}

_ARCHIVE: Fields = {
    **_OUTPUT,
    "tracks": "integer: tracks in it",
    "bytes": "integer: its size",
}

#: What select and split wrote.
_PARTS: Fields = {
    "tracks": "integer: tracks of the whole archive",
    "parts": _list(_object(_ARCHIVE), "archives that were written"),
}

#: What was appended to archives.
_ROLLED = _object(
    {
        "fixes": "integer: fixes of the journal, without repeats",
        "known": "integer: those of them that archives held already",
        "late": "integer: those in further tracks, as they came late or after a break",
        "damaged": "integer: records that can't be read",
        "segments": "integer: segments that were deleted",
        "waiting": "integer: segments that were kept, as their events are not found yet",
        "archives": _list("string: a file", "archives that were written"),
    }
)

_PLAN_ON_ROADS: Fields = {
    "dry_run": {"const": True, "description": "nothing was written"},
    "output": "string: the file that would be written",
    "bytes_in": "integer: size of the logs as stored",
    "points": "integer: samples of the log",
    "tracks": "integer: its tracks",
    "roads": "integer: roads near the log",
    "roads_read": "integer: roads of the network",
    **_READ,
}

_MATCH_PLAN: Fields = {
    "sampled": "integer: samples at the starts of tracks that were matched for the estimate",
    "matched": "integer: how many of these are on roads",
    "error": "number: scale of their distance to the roads in metres",
    "cpu_seconds": "number: CPU time to match all samples, estimated",
}

_PATCH_PLAN: Fields = {
    "gap": "number|null: longer intervals, in seconds, are gaps; null for none",
    "gaps": "integer: gaps that would be filled or left open",
    "seconds": "number: all of them together",
}

_MERGE_PLAN: Fields = {
    "dry_run": {"const": True, "description": "nothing was written"},
    "output": "string: the file that would be written",
    "archives": _list(
        _object(
            {
                "name": "string: the archive",
                "bytes": "integer: its size",
                "tracks": "integer: its tracks",
            }
        ),
        "the archives",
    ),
    "bytes_in": "integer: size of all archives",
    "allowed": "number: metres by which tracks may be moved",
    "allowed_kind": "string: rms or max",
    "bound_at_most_m": "number|null: about the largest error bound in metres that the result may "
    "state; null if that is not known before",
    **_NOTES,
    "left_out": {"type": "object", "description": "archives that were left out, and why"},
}

#: Fields of each command's output, and those that may be missing.
_OUTPUTS: dict[str, tuple[Fields, Fields]] = {
    "compress": ({**_OUTPUT, **_COMPRESSION}, {}),
    "compress --dry-run": (_DRY_RUN, {}),
    "match --dry-run": ({**_PLAN_ON_ROADS, **_MATCH_PLAN}, {}),
    "patch --dry-run": ({**_PLAN_ON_ROADS, **_PATCH_PLAN}, {}),
    "merge --dry-run": (_MERGE_PLAN, {}),
    "compress --stream": ({**_OUTPUT, **_STREAM}, {}),
    "decompress": (
        {
            **_OUTPUT,
            "pieces": "integer: pieces of tracks, or tracks",
            "points": "integer: positions that were written",
        },
        {},
    ),
    "map": ({**_OUTPUT, "edges": "integer: edges that were written"}, {}),
    "plot": ({**_OUTPUT, **_PLOT}, _READ),
    "coreset": ({**_OUTPUT, **_CORESET}, {}),
    "segments": ({**_OUTPUT, **_SEGMENTS}, _READ),
    "network": ({**_OUTPUT, **_NETWORK}, {}),
    "match": ({**_OUTPUT, **_MATCH}, {}),
    "patch": ({**_OUTPUT, **_PATCH}, {}),
    "trips": (_TRIPS, {}),
    "merge": ({**_OUTPUT, **_MERGE}, {}),
    "view": ({**_OUTPUT, "bytes": "integer: size of the page"}, _VIEW_LOG),
    "join": (_ARCHIVE, {}),
    "select": (_PARTS, {}),
    "split": (_PARTS, {}),
    "usage": (_USAGE, {}),
    "route": (_PLAN, {}),
    "rounds": (_ROUNDS, {}),
    "report": (_REPORT, {}),
    "changes": (_CHANGES, {}),
    "predict": (_PREDICT, {}),
    "unusual": (_UNUSUAL, {}),
    "diff": (
        {
            "a": "string: the first file",
            "b": "string: the second file",
            "total": _object(_DISTANCES, "all tracks together"),
            "tracks": _list(_object(_TRACK_DIFFERENCE), "tracks of both"),
            "missing": _list(_list("string: a track", "tracks"), "what A lacks, and what B lacks"),
            "worst": _list(_object(_FAR_PLACE), "places where both are farthest apart"),
            "read": {
                "type": "array",
                "items": {"anyOf": [_object(_READ), {"type": "null"}]},
                "description": "what reading A and B lost and repaired; null for an archive",
            },
        },
        {},
    ),
    "diff --exact": (
        {
            "archive": "string: the file",
            "equal": {"const": True, "description": "a difference is an error"},
            "logs": "integer: logs compared",
            "bytes": "integer: bytes compared",
        },
        {},
    ),
    "decompress --exact": (
        {"output": "string|null: file or folder", "logs": "integer: logs written, or read"},
        {
            "rows": "integer: rows written; with --track or --columns",
            "bytes": "integer: bytes written; with --track or --columns",
        },
    ),
    "listen": (
        {
            "journal": "string: folder of the journal",
            "stored": "integer: fixes stored",
            "counts": _table("integer: how often", "what else happened, such as repeats"),
            "archived": {
                "anyOf": [{"type": "null"}, _ROLLED],
                "description": "what was appended to archives; null without --archive",
            },
        },
        {},
    ),
    "replay": (
        {
            "to": "string: where it was sent",
            "tracks": "integer: tracks",
            "points": "integer: points",
            "messages": "integer: messages with them",
            "repeated": "integer: messages sent again, since their answer did not come",
            "lag_s": "number: seconds by which the latest message was late",
        },
        {},
    ),
    "info": (_INFO, _DETAIL),
    "verify": (
        {
            "archive": "string: the file",
            "whole": {"const": True, "description": "a corrupt archive is an error"},
            "bytes": "integer: its size",
            "tracks": "integer: tracks",
            "knots": "integer: knots of all walks",
        },
        {},
    ),
    "recover": (
        {
            **_OUTPUT,
            "tracks": "integer: tracks that were saved",
            "lost": _list("string: a part", "what could not be saved"),
        },
        {},
    ),
    "warm": ({"seconds": "number: time on the clock"}, {}),
    "demo": (
        {
            "folder": "string: where the files are",
            "written": _list("string: a file", "what was written"),
            **_COMPRESSION,
        },
        {},
    ),
    "experiment": (
        {
            "folder": "string: where the files are",
            "written": _list("string: a file", "what was written"),
        },
        {},
    ),
    "formats": (_FORMATS, {}),
}

#: Schema of what an error prints on standard error.
ERROR: Schema = {
    "$schema": _DRAFT,
    "title": "gpszip: an error",
    **_object(
        {
            "error": _object(
                {
                    "kind": "string: name of the exception",
                    "message": "string: where, what is wrong, and what to do",
                    "exit_code": "integer: exit code of the command",
                }
            )
        }
    ),
}

#: Schema of a line of ``gpszip listen -o``, an event.
EVENT: Schema = {
    "$schema": _DRAFT,
    "title": "gpszip listen -o: an event",
    **_object(
        {
            "kind": "string: what happened, such as stay.start",
            "id": "string: 16 hexadecimal digits; the same log gives the same ids",
            "agent": "string: whom it is about; empty for the map",
            "time": "number: when it happened, in seconds since 1970 or the agent's own zero",
            "received": "number: when the fix was received that told it",
            "seq": "integer: number among all events of the journal, from 1",
        },
        "",
        {
            "revises": "string: id of the event that this one replaces",
            "withdrawn": {
                "const": True,
                "description": "the event that this one replaces did not happen",
            },
            "edge": "integer: edge of the map",
            "forward": "boolean|null: whether it is travelled from its start to its end",
            "offset": "number|null: metres from its start",
            "lat": "number: degrees",
            "lon": "number: degrees",
            "x": "number: metres",
            "y": "number: metres",
            "z": "number: metres",
            "confidence": "number|null: probability that it is true",
            "why": "string: the evidence, for a person",
            "details": {"type": "object", "description": "more facts, by the kind of event"},
        },
    ),
}

#: Schema of what each command prints, by its name.
SCHEMAS: dict[str, Schema] = {
    name: {"$schema": _DRAFT, "title": f"gpszip {name} --json", **_object(fields, "", optional)}
    for name, (fields, optional) in _OUTPUTS.items()
}
