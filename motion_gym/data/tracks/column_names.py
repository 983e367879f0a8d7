"""What the name of a column says: its role, and its unit of length or time."""

from __future__ import annotations

import re

_AROUND = "pos|position|est|estimated|coord|coordinate|world|center|centre|c|local|utm|ground|map"
_NUMBERED = "(?:_?(?:id|ids|no|nr|num|number|index|idx|count))?"
_WHO = (
    "agent|ped|pedestrian|person|pers|people|human|track|trajectory|traj|object|obj|target|vehicle|veh|car|subject|"
    "participant|individual|player|robot|actor"
)
TIME_UNITS: dict[str, float] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "msecs", "milli", "millis", "millisecond", "milliseconds"), 1e3),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microsec", "microsecond", "microseconds"), 1e6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecond", "nanoseconds"), 1e9),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 1 / 60),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 1 / 3600),
    **dict.fromkeys(("d", "day", "days"), 1 / 86400),
}
"""How many of a unit of time are a second."""
NO_UNIT = frozenset(("", "utc", "gmt", "unix", "epoch", "posix", "local", "frame", "frames"))
"""What brackets after the name of a time may hold besides a unit."""
_ENDINGS = "|".join(sorted((word for word in TIME_UNITS if len(word) > 1 or word == "s"), key=len, reverse=True))
ROLES = {
    "frame": re.compile(rf"f|(?:frames?|fr|image|img|time_?step|step|tick){_NUMBERED}"),
    "time": re.compile(
        r"(?:(?:unix|epoch|global|ros|recording|elapsed|relative|rel)_?)?"
        r"(?:t|time|times|time_?stamps?|stamp|date_?time|date|epoch)"
        rf"(?:_?(?:{_ENDINGS}|utc)|_[hd])?|s|secs?|seconds|ms|msecs?|milliseconds|us|usecs?|microseconds|ns|nsecs?"
        r"|nanoseconds|minutes|hours"
    ),
    "id": re.compile(rf"ids?|[uptao]id|name|(?:{_WHO})s?{_NUMBERED}(?:_?name)?|id_?(?:{_WHO})"),
    "x": re.compile(rf"(?:(?:{_AROUND})_?)*x(?:_?(?:{_AROUND}))*|east|easting"),
    "y": re.compile(rf"(?:(?:{_AROUND})_?)*y(?:_?(?:{_AROUND}))*|north|northing"),
}
"""What a column's name says, after ``plain_name``."""
_TIME_UNIT = re.compile(rf"(?:^|_)({_ENDINGS}|h|d)$|(?:time|stamp|epoch)((?!s$)(?:{_ENDINGS}))$")
LENGTHS = {
    **{word: "m" for word in ("m", "meter", "meters", "metre", "metres")},
    **{f"{start}{word}": unit for start, unit in (("centi", "cm"), ("milli", "mm"), ("kilo", "km"))
       for word in ("meter", "meters", "metre", "metres")},
    **{"cm": "cm", "mm": "mm", "km": "km", "ft": "ft", "feet": "ft", "foot": "ft", "in": "in", "inch": "in"},
    **{"inches": "in", "yd": "yd", "yds": "yd", "yard": "yd", "yards": "yd", "px": "px", "pix": "px"},
    **{"pxl": "px", "pixel": "px", "pixels": "px"},
}  # fmt: skip
"""Units of length by the words that headers use."""
FLAGS = {
    **dict.fromkeys(
        ("lost", "occluded", "occlusion", "outside", "interpolated", "generated", "is_lost", "is_occluded"), 1
    ),
    **dict.fromkeys(("valid", "visible", "is_valid", "is_visible", "in_view"), 0),
}
"""Names of columns that mark rows, and the value that says that the position was not seen."""


def plain_name(name: str) -> tuple[str, str]:
    """A column's name in lower case with underscores, without its unit; and the unit, in lower case.

    >>> plain_name("xCenter [m]"), plain_name("pos_x_cm"), plain_name("Track ID"), plain_name("timestamp_ms")
    (('x_center', 'm'), ('pos_x', 'cm'), ('track_id', ''), ('timestamp_ms', ''))
    """
    unit, name = "", re.sub("[µμ](?=s)", "u", name)
    if match := re.fullmatch(r"(.*?)\s*(?:[\[({]\s*([^\])}]*?)\s*[\])}]|/\s*([A-Za-z]+))\s*", name):
        name, unit = match[1], (match[2] or match[3] or "").lower()
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name.strip())
    name = re.sub(r"[\W_]+", "_", name.lower()).strip("_")
    first, _, last = name.rpartition("_")
    if first and not unit and last in LENGTHS:
        name, unit = first, last
    if unit in TIME_UNITS and ROLES["time"].fullmatch(name):
        name = f"{name}_{unit}"
    return name, unit


def role_of(name: str) -> str | None:
    """What a column's name plainly says that it holds: frame, time, id, x or y."""
    word, _ = plain_name(name)
    return next((role for role, words in ROLES.items() if words.fullmatch(word)), None)


def time_unit(name: str) -> str | None:
    """The unit of time that a column's name says: a key of ``TIME_UNITS``, an unknown word in brackets, or None.

    >>> time_unit("timestamp_us"), time_unit("time [min]"), time_unit("t [fortnights]"), time_unit("time")
    ('us', 'min', 'fortnights', None)
    """
    if role_of(name) != "time":
        return None
    word, unit = plain_name(name)
    match = _TIME_UNIT.search(word)
    return match[1] or match[2] if match else None if unit in NO_UNIT else unit
