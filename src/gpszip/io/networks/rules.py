"""What the words on roads mean: one-way rules, speed limits and classes, as OpenStreetMap and most authorities write them."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.io.networks.lines import RoadUsers

__all__ = [
    "NON_ROAD_CLASSES",
    "clean_street_name",
    "expected_speed",
    "map_distinct",
    "parse_directions",
    "parse_speed_limit",
    "road_class_speed",
    "road_class_users",
]

T = TypeVar("T")

#: Values of ``highway`` on which nobody travels (yet, any more, or at all).
NON_ROAD_CLASSES = frozenset(
    (
        "proposed",
        "construction",
        "abandoned",
        "razed",
        "platform",
        "no",
        "elevator",
        "emergency_bay",
        "rest_area",
        "services",
        "planned",
    )
)

_KMH = 1 / 3.6

#: Usual speeds in km/h, stops at lights and crossings not counted.
_CLASS_SPEEDS_KMH: dict[str, float] = {
    "motorway": 100,
    "motorway_link": 60,
    "trunk": 85,
    "trunk_link": 50,
    "primary": 60,
    "primary_link": 40,
    "secondary": 50,
    "secondary_link": 35,
    "tertiary": 45,
    "tertiary_link": 30,
    "unclassified": 40,
    "road": 35,
    "residential": 30,
    "busway": 35,
    "living_street": 12,
    "service": 15,
    "track": 15,
    "cycleway": 16,
    "bridleway": 6,
    "pedestrian": 5,
    "footway": 5,
    "path": 5,
    "corridor": 4,
    "steps": 2.5,
}

_NON_MOTOR_CLASSES = frozenset(
    ("cycleway", "bridleway", "pedestrian", "footway", "path", "corridor", "steps")
)
_MOTOR_CLASSES = frozenset(("motorway", "motorway_link"))

_BOTH, _FORWARD, _BACKWARD, _CLOSED = (True, True), (True, False), (False, True), (False, False)

_DIRECTIONS: dict[str, tuple[bool, bool]] = (
    dict.fromkeys(
        (
            "yes",
            "true",
            "1",
            "t",
            "y",
            "ft",
            "f",
            "forward",
            "oneway",
            "one_way",
            "one-way",
            "with",
            "from-to",
            "fwd",
        ),
        _FORWARD,
    )
    | dict.fromkeys(("-1", "reverse", "tf", "backward", "against", "to-from", "bwd"), _BACKWARD)
    | dict.fromkeys(
        ("no", "false", "0", "n", "b", "both", "twoway", "two_way", "two-way", "bi", "2", ""), _BOTH
    )
    | dict.fromkeys(("closed", "none"), _CLOSED)
)

_NAMED_LIMITS_KMH = {
    "none": 130.0,
    "walk": 6.0,
    "urban": 50.0,
    "rural": 90.0,
    "motorway": 120.0,
    "trunk": 100.0,
    "living_street": 10.0,
    "zone30": 30.0,
    "zone20": 20.0,
}

#: A longer text than this many characters is not searched for several names.
_LONGEST_LIST = 10_000

#: What is driven where so much is allowed: traffic, bends and crossings take the rest.
_DRIVEN_SHARE = 0.85


def parse_directions(
    oneway: str | None, *, junction: str | None = None, road: str | None = None
) -> tuple[bool, bool]:
    """Whether a road may be travelled along its line, and against it.

    Parameters
    ----------
    oneway : str or None
        What the source says; ``-1`` is against the line. What nobody understands (``reversible``) counts as both.
    junction, road : str or None
        ``junction`` and ``highway`` of OpenStreetMap: roundabouts and motorways are one-way unless ``oneway`` says otherwise.

    Examples
    --------
    >>> parse_directions("yes"), parse_directions("-1"), parse_directions(None), parse_directions(None, junction="roundabout"), parse_directions("no", road="motorway")
    ((True, False), (False, True), (True, True), (True, False), (True, True))
    """
    if oneway is not None:
        return _DIRECTIONS.get(oneway.strip().lower(), _BOTH)
    implied = junction in ("roundabout", "circular") or road == "motorway"
    return _FORWARD if implied else _BOTH


def parse_speed_limit(text: str | None) -> float:
    """Limit in m/s of a text such as ``50``, ``30 mph`` or ``DE:urban``; the least of several; NaN where it says nothing.

    Examples
    --------
    >>> parse_speed_limit("36"), round(parse_speed_limit("30 mph"), 2), round(parse_speed_limit("RO:urban"), 2), parse_speed_limit("signals")
    (10.0, 13.41, 13.89, nan)
    """
    found = [
        _parse_one_limit(part)
        for part in re.split(r"[;|,]", (text or "").strip(" []").replace("'", "").replace('"', ""))
    ]
    known = [limit for limit in found if limit == limit]  # noqa: PLR0124 (NaN is nothing)
    return min(known) if known else float("nan")


def _parse_one_limit(text: str) -> float:
    plain = text.strip().lower()
    number = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(mph|knots|km/h|kmh|kph)?", plain)
    if number is not None:
        unit = {"mph": 0.44704, "knots": 0.514444}.get(number[2], _KMH)
        value = float(number[1]) * unit
        return value if 0 < value < 100 else float("nan")
    word = plain.split(":")[-1]
    return _NAMED_LIMITS_KMH[word] * _KMH if word in _NAMED_LIMITS_KMH else float("nan")


def clean_street_name(name: str | None, ref: str | None = None) -> str | None:
    """Name of a street as people read it, or its number where it has no name.

    Parameters
    ----------
    name, ref : str or None
        What the source says. Several names, which osmnx writes as the text of a Python list, are joined by ``; ``.

    Returns
    -------
    str or None
        None where neither says anything.

    Examples
    --------
    >>> clean_street_name(" Main St "), clean_street_name(None, "B 2"), clean_street_name("['Oak St', 'Elm St']"), clean_street_name("", "nan")
    ('Main St', 'B 2', 'Oak St; Elm St', None)
    """
    for text in (name, ref):
        several = [" ".join(one.split()) for one in _parse_list(text or "")]
        known = [
            one
            for one in dict.fromkeys(several)
            if one and one.lower() not in {"nan", "none", "null"}
        ]
        if known:
            return "; ".join(known)
    return None


def _parse_list(text: str) -> list[str]:
    """The members of a list that was written as text, or the text itself."""
    plain = text.strip()
    if plain.startswith("{"):
        return []  # an object is no name
    if not (plain.startswith("[") and plain.endswith("]") and len(plain) <= _LONGEST_LIST):
        return [plain]
    try:
        members = ast.literal_eval(plain)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return [plain]
    return [str(one) for one in members if one is not None]


def road_class_speed(road: str | None) -> float:
    """Usual speed in m/s on roads of a class of OpenStreetMap; NaN for classes unknown.

    Examples
    --------
    >>> road_class_speed("secondary") > road_class_speed("residential"), road_class_speed("A3")
    (True, nan)
    """
    return _CLASS_SPEEDS_KMH.get(_normalise_class(road), float("nan")) * _KMH


def expected_speed(limit: float, typical_speed: float) -> float:
    """Speed in m/s that is driven where ``limit`` is allowed on a road of a class that has the usual speed ``usual``.

    A limit says more than a class, except where it is much above what such roads allow.

    Examples
    --------
    >>> expected_speed(10.0, float("nan")), expected_speed(float("nan"), 7.0), expected_speed(28.0, 4.0)
    (8.5, 7.0, 6.0)
    """
    if limit != limit:  # noqa: PLR0124
        return typical_speed
    driven = _DRIVEN_SHARE * limit
    return min(driven, 1.5 * typical_speed) if typical_speed == typical_speed else driven  # noqa: PLR0124


def road_class_users(road: str | None) -> RoadUsers:
    """Who may be met on a class of roads of OpenStreetMap."""
    plain = _normalise_class(road)
    return (
        RoadUsers.NON_MOTOR
        if plain in _NON_MOTOR_CLASSES
        else RoadUsers.MOTOR_ONLY
        if plain in _MOTOR_CLASSES
        else RoadUsers.ANYBODY
    )


def map_distinct(
    texts: Sequence[str | None] | Iterable[str | None], rule: Callable[[str | None], T], kind: Any
) -> NDArray[Any]:
    """Apply a rule to texts of which most are alike, once to each kind.

    Examples
    --------
    >>> map_distinct(["a", "bb", "a"], lambda text: len(text or ""), np.int64).tolist()
    [1, 2, 1]
    """
    known: dict[str | None, T] = {}
    answers = []
    for text in texts:
        if text not in known:
            known[text] = rule(text)
        answers.append(known[text])
    return np.array(answers, dtype=kind)


def _normalise_class(road: str | None) -> str:
    first = (road or "").strip(" []'\"").split(",")[0].split(";")[0]
    return first.strip(" '\"").lower()
