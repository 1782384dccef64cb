"""Interpret the properties of roads: directions, speed limits, classes and names.

The words are those of OpenStreetMap and of most authorities.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Sequence
from math import isnan, nan
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from gpszip.io.networks.lines import RoadUsers

__all__ = [
    "MAX_ROAD_SPEED",
    "NON_ROAD_CLASSES",
    "Directions",
    "RoadRules",
    "clean_street_name",
    "expected_speed",
    "find_rules",
    "map_distinct",
    "parse_directions",
    "parse_number",
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

#: Metres per second of one km/h.
_KMH = 1 / 3.6

#: Metres per second of other units in which limits are written.
_LIMIT_UNITS = {"mph": 0.44704, "knots": 0.514444}

#: Typical speeds in km/h by class of ``highway``, without stops at lights and crossings.
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

#: Classes without motor traffic.
_NON_MOTOR_CLASSES = frozenset(
    ("cycleway", "bridleway", "pedestrian", "footway", "path", "corridor", "steps")
)

#: Classes where nobody walks.
_MOTOR_CLASSES = frozenset(("motorway", "motorway_link"))


class Directions(NamedTuple):
    """Whether a road may be travelled along its line, and against it."""

    forward: bool
    backward: bool


_BOTH = Directions(True, True)
_FORWARD = Directions(True, False)
_BACKWARD = Directions(False, True)
_CLOSED = Directions(False, False)

#: Words for directions, as OpenStreetMap, authorities and vendors of road data write them.
_DIRECTION_WORDS = {
    _FORWARD: "yes true 1 t y ft f forward oneway one_way one-way with from-to fwd",
    _BACKWARD: "-1 reverse tf backward against to-from bwd",
    _BOTH: "no false 0 n b both twoway two_way two-way bi 2",
    _CLOSED: "closed none",
}

#: Directions by word; an empty text says nothing.
_DIRECTIONS = {
    word: directions for directions, words in _DIRECTION_WORDS.items() for word in words.split()
} | {"": _BOTH}

#: Words for speed limits, with what they mean in most countries, in km/h.
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

#: Speeds in m/s from here on are mistakes: 360 km/h.
MAX_ROAD_SPEED = 100.0

#: Characters of a text beyond which it is not parsed as a list of names.
_MAX_LIST_LETTERS = 10_000

#: Speed driven as a share of the limit; traffic, bends and crossings take the rest.
_DRIVEN_SHARE = 0.85

#: Speed driven where a limit is far above what a class of roads allows, relative to its typical
#: speed.
_MAX_CLASS_EXCESS = 1.5


class RoadRules(NamedTuple):
    """What the properties of a road say.

    Parameters
    ----------
    forward, backward : bool
        Whether it may be travelled along its line, and against it.
    speed : float
        Expected speed in m/s; NaN if unknown.
    users : RoadUsers
        Who uses it.
    """

    forward: bool
    backward: bool
    speed: float
    users: RoadUsers


def find_rules(
    *, road: str | None, oneway: str | None, junction: str | None, limit: str | None
) -> RoadRules:
    """Interpret the properties of a road together.

    Parameters
    ----------
    road : str or None
        Class of the road, ``highway`` of OpenStreetMap.
    oneway, junction : str or None
        See :func:`parse_directions`.
    limit : str or None
        See :func:`parse_speed_limit`.
    """
    forward, backward = parse_directions(oneway, junction=junction, road=road)
    speed = expected_speed(parse_speed_limit(limit), road_class_speed(road))
    return RoadRules(forward, backward, speed, road_class_users(road))


def parse_directions(
    oneway: str | None, *, junction: str | None = None, road: str | None = None
) -> Directions:
    """Find out in which directions a road may be travelled.

    Parameters
    ----------
    oneway : str or None
        What the source says; ``-1`` is against the line. Other words, such as ``reversible``, count
        as both directions.
    junction : str or None
        ``junction`` of OpenStreetMap: a roundabout is one-way unless ``oneway`` says otherwise.
    road : str or None
        ``highway`` of OpenStreetMap: so is a motorway.

    Examples
    --------
    >>> parse_directions("yes")
    Directions(forward=True, backward=False)
    >>> parse_directions("-1")
    Directions(forward=False, backward=True)
    >>> parse_directions(None, junction="roundabout")
    Directions(forward=True, backward=False)
    >>> parse_directions("no", road="motorway")
    Directions(forward=True, backward=True)
    """
    # What the source says counts, even an unknown word. Without it, junction and class decide.
    if oneway is not None:
        return _DIRECTIONS.get(oneway.strip().lower(), _BOTH)
    is_implied = junction in ("roundabout", "circular") or road == "motorway"
    return _FORWARD if is_implied else _BOTH


def parse_number(text: str | None) -> float:
    """Return the number that a text is; NaN if it is none.

    Examples
    --------
    >>> parse_number("8.5"), parse_number("fast"), parse_number(None)
    (8.5, nan, nan)
    """
    try:
        return float(text or "nan")
    except ValueError:
        return nan


def parse_speed_limit(text: str | None) -> float:
    """Return the speed limit of a road in m/s.

    Parameters
    ----------
    text : str or None
        Such as ``50``, ``30 mph`` or ``DE:urban``; of several, separated by ``;``, ``|`` or ``,``,
        the lowest counts.

    Returns
    -------
    float
        NaN if the text has no limit.

    Examples
    --------
    >>> parse_speed_limit("36"), parse_speed_limit("signals")
    (10.0, nan)
    >>> round(parse_speed_limit("30 mph"), 2), round(parse_speed_limit("RO:urban"), 2)
    (13.41, 13.89)
    """
    # osmnx writes several limits as the text of a Python list: "['50', '30']".
    plain = (text or "").strip(" []").replace("'", "").replace('"', "")
    limits = [_parse_one_limit(item) for item in re.split(r"[;|,]", plain)]
    return min((limit for limit in limits if not isnan(limit)), default=nan)


def _parse_one_limit(text: str) -> float:
    plain = text.strip().lower()
    number = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(mph|knots|km/h|kmh|kph)?", plain)
    if number is not None:
        limit = float(number[1]) * _LIMIT_UNITS.get(number[2], _KMH)
        return limit if 0 < limit < MAX_ROAD_SPEED else nan
    word = plain.split(":")[-1]  # the country comes before
    return _NAMED_LIMITS_KMH[word] * _KMH if word in _NAMED_LIMITS_KMH else nan


def clean_street_name(name: str | None, ref: str | None = None) -> str | None:
    """Return the name of a street, or its number if it has no name.

    Parameters
    ----------
    name, ref : str or None
        What the source says. Several names, which osmnx writes as the text of a Python list, are
        joined by ``; ``.

    Returns
    -------
    str or None
        None if neither says anything.

    Examples
    --------
    >>> clean_street_name(" Main St "), clean_street_name(None, "B 2")
    ('Main St', 'B 2')
    >>> clean_street_name("['Oak St', 'Elm St']"), clean_street_name("", "nan")
    ('Oak St; Elm St', None)
    """
    # A dict drops repeated names and keeps their order. pandas writes "nan" for a missing name.
    for text in (name, ref):
        names = dict.fromkeys(" ".join(item.split()) for item in _parse_list(text or ""))
        known = [item for item in names if item and item.lower() not in {"nan", "none", "null"}]
        if known:
            return "; ".join(known)
    return None


def _parse_list(text: str) -> list[str]:
    """Return the members of a list that was written as text, or the text itself."""
    plain = text.strip()
    if plain.startswith("{"):
        return []  # a JSON object is no name
    if not (plain.startswith("[") and plain.endswith("]") and len(plain) <= _MAX_LIST_LETTERS):
        return [plain]
    # literal_eval runs no code of the file. A name in brackets that is no list stays as it is.
    try:
        members = ast.literal_eval(plain)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return [plain]
    return [str(member) for member in members if member is not None]


def road_class_speed(road: str | None) -> float:
    """Return the typical speed in m/s on a class of OpenStreetMap; NaN for other classes.

    Examples
    --------
    >>> road_class_speed("secondary") > road_class_speed("residential"), road_class_speed("A3")
    (True, nan)
    """
    return _CLASS_SPEEDS_KMH.get(_normalise_class(road), nan) * _KMH


def expected_speed(limit: float, typical_speed: float) -> float:
    """Return the speed in m/s that is driven on a road.

    The limit decides, but a limit far above what roads of this class allow does not.

    Parameters
    ----------
    limit : float
        Speed limit in m/s; NaN if unknown.
    typical_speed : float
        Typical speed on roads of this class in m/s; NaN if unknown.

    Examples
    --------
    >>> expected_speed(10.0, float("nan")), expected_speed(float("nan"), 7.0)
    (8.5, 7.0)
    >>> expected_speed(28.0, 4.0)
    6.0
    """
    if isnan(limit):
        return typical_speed
    driven = _DRIVEN_SHARE * limit
    return driven if isnan(typical_speed) else min(driven, _MAX_CLASS_EXCESS * typical_speed)


def road_class_users(road: str | None) -> RoadUsers:
    """Return who uses a class of roads of OpenStreetMap."""
    plain = _normalise_class(road)
    if plain in _NON_MOTOR_CLASSES:
        return RoadUsers.NON_MOTOR
    return RoadUsers.MOTOR_ONLY if plain in _MOTOR_CLASSES else RoadUsers.ANYBODY


def map_distinct(
    texts: Sequence[str | None] | Iterable[str | None], rule: Callable[[str | None], T], dtype: Any
) -> NDArray[Any]:
    """Apply a rule to texts, once to each distinct text.

    Parameters
    ----------
    texts : iterable of str or None
        Texts that repeat often.
    rule : callable
        The rule.
    dtype : data type
        Type of the answers.

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
    return np.array(answers, dtype=dtype)


def _normalise_class(road: str | None) -> str:
    """Return the first class of a list, in lower case."""
    first = (road or "").strip(" []'\"").split(",")[0].split(";")[0]
    return first.strip(" '\"").lower()
