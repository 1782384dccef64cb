"""Sections of a report as HTML: a sentence with the numbers that matter, then a table or a picture.

What can't be told is said in a sentence. All text from data is escaped.
"""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from gpszip.history.calendar import Calendar
from gpszip.model.text import count_phrase, count_text
from gpszip.view.report.charts import Bar, draw_bars, draw_speeds, draw_week
from gpszip.view.report.texts import (
    bytes_text,
    duration_text,
    join_words,
    length_text,
    share_text,
    speed_text,
    time_text,
)

__all__ = ["Section", "summarise", "write_sections"]

#: Metres a second from which speeds are told in kilometres an hour.
_FAST = 3.0

#: Days of the week.
_DAYS = ("Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday", "Sunday")

#: Seconds by which a round is neither late nor early.
_ON_TIME = 0.5

#: Busiest hours that a sentence names.
_BUSIEST = 3

Numbers = dict[str, Any]


@dataclass(frozen=True)
class Section:
    """A part of the report.

    Parameters
    ----------
    id : str
        Its anchor.
    title : str
        Its heading, as text.
    body : str
        HTML.
    """

    id: str
    title: str
    body: str


def summarise(numbers: Numbers, calendar: Calendar) -> str:
    """What there is, in a few sentences."""
    sentences = [_tell_period(numbers, calendar), _tell_travel(numbers), _tell_archive(numbers)]
    return _paragraph(" ".join(each for each in sentences if each), "lead")


def _tell_period(numbers: Numbers, calendar: Calendar) -> str:
    """From when to when the log is."""
    period = numbers["period"]
    tracks = count_text(numbers["archive"]["tracks"], "track")
    if period is None:
        return f"The archive holds {_strong(tracks)} without times: nothing here has an hour."
    if not calendar.name:
        span = duration_text(period["end"] - period["start"])
        return f"The archive holds {_strong(tracks)} of {_strong(span)}; its times are no dates."
    first, last = (time_text(period[end], calendar, date_only=True) for end in ("start", "end"))
    days = f" to {_strong(last)}" if last != first else ""
    moved = ""
    if period["days"] > 1:
        moved = f", with travel on {period['days_with_travel']:,} of {period['days']:,} days"
    return f"The archive holds {_strong(tracks)}, {_strong(first)}{days}{moved}."


def _tell_travel(numbers: Numbers) -> str:
    """How far, how long and how often somebody travelled."""
    travel, trips = numbers["travel"], numbers["trips"]
    if travel is None:
        return "Nothing moves in it."

    # Distance, time and trips, as far as they are known.
    text = f"{_strong(length_text(travel['metres']))} were travelled"
    if travel["moving_s"]:
        text += f" in {_strong(duration_text(travel['moving_s'], in_days=False))} of motion"
        text += f", {speed_text(travel['speed'], fast=_is_fast(numbers))} on average"
    if trips is not None and trips["trips"]:
        made = count_text(trips["trips"], "trip")
        text += f", on {_strong(made)} between {count_text(trips['places'], 'place')}"
    text += "."

    # How much of it is known.
    if travel["repeated"] is not None and travel["metres"]:
        share = share_text(travel["repeated"])
        text += (
            f" The map has {length_text(travel['network_metres'])} of edges; {_strong(share)} of "
            "the way was on edges that were travelled before."
        )
    return text


def _tell_archive(numbers: Numbers) -> str:
    archive = numbers["archive"]
    size = _strong(bytes_text(archive["bytes"]))
    if archive["points"] is None:
        return f"All this takes {size}." if archive["bytes"] else ""
    return f"All this takes {size} for {count_text(archive['points'], 'point')}."


def write_sections(numbers: Numbers, calendar: Calendar, remarks: Sequence[str]) -> list[Section]:
    """Write all sections.

    Parameters
    ----------
    numbers : dict
        As :func:`gpszip.view.report.numbers.collect_numbers` returns them.
    calendar : Calendar
        Whose hours are told.
    remarks : sequence of str
        What reading the log repaired and left out.
    """
    return [
        Section("places", "Places", _write_places(numbers)),
        Section("activity", "When", _write_activity(numbers, calendar)),
        Section("edges", "Edges and speeds", _write_edges(numbers)),
        Section("changes", "Changes", _write_changes(numbers, calendar)),
        Section("unusual", "Unusual trips", _write_unusual(numbers, calendar)),
        Section("rounds", "Rounds", _write_rounds(numbers, calendar)),
        Section("prediction", "Prediction", _write_prediction(numbers)),
        Section("doubt", "Data and doubt", _write_doubt(numbers, calendar, remarks)),
    ]


def _write_places(numbers: Numbers) -> str:
    """Places with the time spent there, and trips between them."""
    trips, places = numbers["trips"], numbers["places"]
    if trips is None or not places:
        return _cannot(numbers, "trips", "no stay of five minutes or more was found")

    # The place where most time is spent, and roles with their evidence.
    first, seen = places[0], _strong(count_text(trips["places"], "place"))
    text = f"{seen}, where trips begin or end; nobody stayed."
    if trips["stays"]:
        text = (
            f"{seen} with {count_text(trips['stays'], 'stay')}; "
            f"{_strong(duration_text(first['dwell_s']))} were spent at place {first['place']}, in "
            f"{count_text(first['visits'], 'visit')}."
        )
    roles = [place for place in places if place["role"]]
    for place in roles:
        evidence = html.escape(place["evidence"])
        text += f" Place {place['place']} is perhaps {_strong(place['role'])}: {evidence}."
    if trips["trips"]:
        pair = trips["pairs"][0]
        text += (
            f" A trip is {length_text(trips['median_length'])} long and takes "
            f"{duration_text(trips['median_duration'])} (medians); the most frequent one leads "
            f"from place {pair['from']} to place {pair['to']}, {count_text(pair['trips'], 'time')}."
        )
    else:
        text += " No trip from one place to another was seen."

    # The table.
    rows = [
        [
            str(place["place"]) + (f", {place['role']}?" if place["role"] else ""),
            _position(place),
            f"{place['visits']:,}",
            duration_text(place["dwell_s"]),
            place["usual"] and f"{place['usual']} h",
            f"{place['arrivals']:,}",
        ]
        for place in places
    ]
    head = ["Place", "Position", "Visits", "Time spent", "Usual hours", "Trips to it"]
    return _paragraph(text) + _table(head, rows, left=(0, 1)) + _more(trips["places"], len(rows))


def _write_activity(numbers: Numbers, calendar: Calendar) -> str:
    """Trips or kilometres by period, and hours of the week."""
    activity, hours = numbers["activity"], numbers["hours"]
    if activity is None or hours is None:
        return _cannot(numbers, "usage", "tracks without times have no hours")

    # Bars: trips where there are any, else the way travelled.
    unit, trips = activity["unit"], activity["trips"]
    values = trips or activity["metres"]
    tell = _count_trips if trips else length_text
    bars = [
        Bar(value, label, f"{label}: {tell(value)}")
        for value, label in zip(values, activity["starts"], strict=True)
    ]
    busiest = max(bars, key=lambda bar: bar.value)
    is_day = unit in {"hour", "day"} or not calendar.name
    what = "Trips" if trips else "Way travelled"
    text = f"All travel is within one {unit}."
    if len(bars) > 1:
        text = (
            f"{what} by {unit}: the busiest {unit} {'is' if is_day else 'begins with'} "
            f"{_strong(busiest.label)}, with {_strong(tell(busiest.value))}."
        )
    top = f"{max(values):,}" if trips else length_text(max(values))
    picture = draw_bars(bars, _plain(text), top) if len(bars) > 1 else ""

    if numbers["period"]["days"] < 2:
        return _paragraph(text) + picture
    return _paragraph(text) + picture + _write_week(hours, calendar)


def _write_week(hours: list[float], calendar: Calendar) -> str:
    """Way travelled in each hour of the week; of seven days, where times are no dates."""
    names = _DAYS if calendar.name else [f"Day {i + 1}" for i in range(7)]
    titles = [
        f"{names[i // 24]}, {i % 24} to {i % 24 + 1} h: {length_text(value)}"
        for i, value in enumerate(hours)
    ]
    order = sorted(range(len(hours)), key=lambda i: -hours[i])[:_BUSIEST]
    most = join_words([f"{names[i // 24]} {i % 24} h" for i in order if hours[i] > 0])
    which = "week" if calendar.name else "seven days from the log's zero, and of the next seven"
    text = f"Way travelled by hour of the {which}: most at {most}, up to {length_text(max(hours))}."
    labels = [name[:3] if calendar.name else name for name in names]
    return _paragraph(html.escape(text)) + draw_week(hours, text, titles, labels)


def _count_trips(count: float) -> str:
    return count_text(int(count), "trip")


def _write_edges(numbers: Numbers) -> str:
    """The most travelled edges, and speeds by hour."""
    edges, speeds, travel = numbers["edges"], numbers["speeds"], numbers["travel"]
    if not edges or travel is None:
        return _cannot(numbers, "usage", "nothing moves in the log")

    # The busiest edge in a sentence, and others in a table.
    fast = _is_fast(numbers)
    first = edges[0]
    passes = first["forward"] + first["backward"]
    text = (
        f"The most travelled of {_strong(count_text(travel['edges'], 'edge'))} is edge "
        f"{first['edge']}, {length_text(first['length'])} long, with "
        f"{_strong(count_text(passes, 'traversal'))}."
    )
    rows = [
        [
            str(edge["edge"]),
            _position(edge),
            length_text(edge["length"]),
            f"{edge['forward'] + edge['backward']:,}",
            f"{edge['forward']:,} / {edge['backward']:,}",
            speed_text(edge["speed"], fast=fast),
        ]
        for edge in edges
    ]
    head = ["Edge", "Middle", "Length", "Traversals", "Forward / backward", "Median speed"]
    table = _table(head, rows, left=(1,))
    note = _more(travel["edges"], len(rows))
    return _paragraph(text) + table + note + _write_speeds(speeds, fast=fast)


def _write_speeds(speeds: list[Numbers] | None, *, fast: bool) -> str:
    """Speeds by hour; of a log within an hour there is nothing to compare."""
    if not speeds:
        return _paragraph("Speeds by hour are unknown, as the tracks have no times.")
    if len(speeds) < 2:
        middle = speed_text(speeds[0]["speed"], fast=fast)
        return _paragraph(f"All travel is in one hour of the day, at a median of {middle}.")

    # The extremes in a sentence, and all hours in a picture.
    fastest = max(speeds, key=lambda each: each["speed"])
    slowest = min(speeds, key=lambda each: each["speed"])
    high, low = (speed_text(each["speed"], fast=fast) for each in (fastest, slowest))
    text = "Speeds by hour, without standing: dots are medians, bars hold half of all travel. "
    if high == low:
        text += f"All hours have a median of {high}."
    else:
        text += (
            f"Fastest is {fastest['hour']} h with {high}, slowest {slowest['hour']} h with {low}."
        )
    top = max(each["speed_q3"] for each in speeds)
    picture = draw_speeds(
        [each["hour"] for each in speeds],
        [(each["speed_q1"], each["speed"], each["speed_q3"]) for each in speeds],
        text,
        speed_text(top, fast=fast),
    )
    return _paragraph(text) + picture


def _write_changes(numbers: Numbers, calendar: Calendar) -> str:
    """What has changed on the map, and how many false alarms are to be expected."""
    changes = numbers["changes"]
    if changes is None:
        return _cannot(numbers, "changes", "there is too little history")

    # How much was compared, and what chance would tell.
    since = _strong(time_text(changes["since"], calendar))
    expected = max(changes["expected_false"], 0.01)
    alarms = (
        f"About {expected:.2g} false alarms of closures are to be expected in this time; "
        f"{duration_text(changes['days'] * 86_400)} were compared with the time before."
    )
    if not changes["rows"]:
        return _paragraph(
            f"{_strong('No change')} of the map was found since {since}. {alarms} Nothing is "
            "claimed where nobody came by."
        )

    # How many of each kind; where there are very many, of those with most evidence.
    kinds = Counter(change["kind"] for change in changes["rows"])
    what = _strong(join_words([f"{count:,} {kind}" for kind, count in kinds.items()]))
    if changes["changes"] > len(changes["rows"]):
        what = f"{_strong(count_text(changes['changes'], 'change'))}, the surest being {what}"
    text = f"Since {since}: {what}. {alarms}"
    rows = [
        [
            change["kind"] + (f" ×{change['factor']:.2f}" if change["factor"] else ""),
            str(change["edge"]),
            "forward" if change["forward"] else "backward",
            _position(change),
            time_text(change["since"], calendar),
            count_text(change["agents"], "observation"),
            f"{change['evidence']:.1f}",
        ]
        for change in changes["rows"]
    ]
    head = ["Change", "Edge", "Direction", "Middle", "Since", "Seen", "Evidence, nats"]
    table = _table(head, rows, left=(0, 2, 3, 4))
    return _paragraph(text) + table + _more(changes["changes"], len(rows))


def _write_unusual(numbers: Numbers, calendar: Calendar) -> str:
    """Trips by how surprising they are."""
    unusual, period = numbers["unusual"], numbers["period"]
    if unusual is None or period is None:
        return _cannot(numbers, "unusual", "there are too few trips to tell what is usual")

    # What was compared.
    text = (
        f"{_strong(count_text(unusual['trips'], 'trip'))} were compared with what others did: "
        "each bit of a score is a factor of two in probability."
    )
    if unusual["usual"]:
        text += f" At a first look, {count_text(unusual['usual'], 'further trip')} went as usual."
    if unusual["left_out"]:
        text += f" Not scored: {count_text(unusual['left_out'], 'earlier trip')}."
    if not unusual["rows"]:
        return _paragraph(text + " None of them has anything unusual.")

    # The ranking.
    first = unusual["rows"][0]
    text += f" The most unusual one: {_strong(html.escape(first['reason']))}."
    rows = [
        [
            str(i + 1),
            f"{trip['score']:.0f}",
            trip["track"],
            time_text(trip["start"], calendar),
            trip["reason"],
            _position(trip),
        ]
        for i, trip in enumerate(unusual["rows"])
    ]
    head = ["", "Bits", "Track", "Begins", "Reason", "Where"]
    return _paragraph(text) + _table(head, rows, left=(2, 3, 4, 5))


def _write_rounds(numbers: Numbers, calendar: Calendar) -> str:
    """The usual round of a patrol, and the rounds that differ most from it."""
    rounds = numbers["rounds"]
    if rounds is None:
        return _cannot(numbers, "rounds", "travel doesn't repeat in rounds")
    complete = f"{rounds['complete']:,} of {rounds['rounds']:,}"
    text = (
        f"The usual round is {_strong(length_text(rounds['length']))} long"
        + (f" and takes {_strong(duration_text(rounds['duration']))}" if rounds["duration"] else "")
        + f"; it tells {share_text(rounds['regularity'])} of all travel. "
        f"{_strong(complete)} rounds are complete."
    )
    bars = [
        Bar(
            each["seconds"],
            str(i + 1),
            f"round {i + 1}: {duration_text(each['seconds'])}",
            not each["complete"],
        )
        for i, each in enumerate(rounds["durations"])
        if each["seconds"] is not None
    ]
    picture = ""
    if len(bars) > 1:
        longest = duration_text(max(bar.value for bar in bars))
        says = "Durations of the rounds; those that miss something have another colour."
        picture = _paragraph(says) + draw_bars(bars, says, longest)

    # Those that cover least, then those that are late.
    rows = [
        [
            each["track"],
            str(each["round"]),
            time_text(each["start"], calendar),
            share_text(each["share"]),
            _late(each["late_s"]),
            ", ".join(map(str, each["missed"][:8])) or "none",
        ]
        for each in rounds["rows"]
    ]
    head = ["Track", "Round", "Begins", "Covered", "Late", "Missed edges"]
    return (
        _paragraph(text)
        + picture
        + _table(head, rows, left=(0, 2, 5))
        + _more(rounds["rounds"], len(rows))
    )


def _late(seconds: float | None) -> str:
    if seconds is None:
        return "unknown"
    if abs(seconds) < _ON_TIME:
        return "0 s"
    sign = "\u2212" if seconds < 0 else "+"
    return f"{sign}{duration_text(abs(seconds))}"


def _write_prediction(numbers: Numbers) -> str:
    """How well the archive foresees what comes next."""
    found = numbers["prediction"]
    if found is None:
        return _cannot(numbers, "unusual", "there are too few crossings to tell")
    right = share_text(found["right"])
    return _paragraph(
        f"Where there are two ways on or more, the edge that is taken next is the likeliest one in "
        f"{_strong(right)} of {count_text(found['decisions'], 'decision')} of trips "
        f"from which nothing was learned; {found['bits']:.2f} bits tell which edge it is."
    )


def _write_doubt(numbers: Numbers, calendar: Calendar, remarks: Sequence[str]) -> str:
    """What was repaired, left out and assumed."""
    # The archive.
    archive, trips = numbers["archive"], numbers["trips"]
    notes = []
    if archive["error_bound"]:
        bound = html.escape(archive["error_bound"])
        notes.append(f"Positions are those of the archive, whose error is bounded: {bound}.")
    if archive["gaps"]:
        notes.append(
            f"{count_text(archive['gaps'], 'gap')} of the tracks: no travel is claimed there."
        )

    # Jumps, hours, trips, and what the log lost.
    travel = numbers["travel"]
    if travel is not None and travel["jumps"]:
        limit = speed_text(travel["max_speed"], fast=_is_fast(numbers))
        count = count_text(travel["jumps"], "traversal")
        notes.append(
            f"Jumps of the receiver have no speed: {count} faster than {limit}, four times the "
            "speed that 95 % of travel keeps."
        )
    if numbers["period"] is not None:
        said = calendar.describe()
        notes.append(f"{html.escape(said[:1].upper() + said[1:])}.")
    if trips is not None and trips["unseen"]:
        notes.append(
            f"In gaps, {count_text(trips['unseen'], 'change')} of place happened without a trip "
            "that was seen."
        )
    if trips is not None and trips["doubtful"]:
        notes.append(
            f"{count_phrase(trips['doubtful'], 'fixes far off between gaps are left out')}."
        )
    notes += [f"{html.escape(each)}." for each in remarks]
    notes.append("Home, work and reasons are inferences from numbers, not facts.")
    return "<ul>" + "".join(f"<li>{note}</li>" for note in notes) + "</ul>"


# Parts of HTML.


def _is_fast(numbers: Numbers) -> bool:
    speed = (numbers["travel"] or {}).get("speed")
    return speed is not None and speed > _FAST


def _strong(text: str) -> str:
    return f"<strong>{html.escape(text)}</strong>"


def _paragraph(text: str, kind: str = "") -> str:
    return f'<p class="{kind}">{text}</p>' if kind else f"<p>{text}</p>"


def _plain(text: str) -> str:
    """Text of a sentence without the marks of strong words."""
    return html.unescape(text.replace("<strong>", "").replace("</strong>", ""))


def _cannot(numbers: Numbers, part: str, otherwise: str) -> str:
    """Say why a part can't be told."""
    reason = numbers["cannot_tell"].get(part, otherwise)
    return _paragraph(f"This can't be told: {html.escape(reason)}.", "none")


def _more(total: int, shown: int) -> str:
    rest = total - shown
    return _paragraph(f"and {rest:,} more", "none") if rest > 0 else ""


def _position(row: Numbers) -> str:
    """Latitude and longitude, or x and y."""
    if "lat" in row:
        return f"{row['lat']:.5f}, {row['lon']:.5f}"
    return f"{row['x']:,.0f}, {row['y']:,.0f} m"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], left: Sequence[int] = ()) -> str:
    """A table; columns of numbers are aligned at the right."""
    # Texts are at the left, numbers at the right.
    kinds = ['class="left"' if i in left else "" for i in range(len(head))]
    cells = "".join(
        f'<th scope="col" {kind}>{html.escape(text)}</th>'
        for text, kind in zip(head, kinds, strict=True)
    )

    # One row for each.
    body = "".join(
        "<tr>"
        + "".join(
            f"<td {kind}>{html.escape(text)}</td>" for text, kind in zip(row, kinds, strict=True)
        )
        + "</tr>"
        for row in rows
    )
    return (
        f'<div class="scroll"><table><thead><tr>{cells}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )
