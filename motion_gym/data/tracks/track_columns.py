"""Which columns of a table hold the frame or time, the id, x and y."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from motion_gym.contract import DataError, SpecError
from motion_gym.data.tracks.column_names import FLAGS, LENGTHS, ROLES, TIME_UNITS, plain_name, role_of, time_unit
from motion_gym.data.tracks.tables import Table, short
from motion_gym.specs import suggest

HOW = "Say which columns hold frame (or time), id, x and y"
OBSMAT = ("frame", "id", "x", "z", "y", "vx", "vz", "vy")


@dataclass(frozen=True)
class Columns:
    """Where the values of a track are in a table.

    Attributes:
        time: Column of the frame number or the time.
        agent: Column of the id; None if the table is of one person.
        x: Column of x.
        y: Column of y.
        stated: Whether the user named them.
        how: How they were found, in words.
    """

    time: int
    agent: int | None
    x: int
    y: int
    stated: bool
    how: str

    def said(self, table: Table) -> str:
        """The columns in words."""
        agent = "no id (one person)" if self.agent is None else f"id {table.title(self.agent)}"
        return (
            f"frame or time {table.title(self.time)}, {agent}, x {table.title(self.x)}, y {table.title(self.y)} "
            f"({self.how})"
        )


def length_unit(table: Table, column: int) -> str | None:
    """The unit of length that a column's name says."""
    return LENGTHS.get(plain_name(table.names[column])[1]) if table.names else None


def unknown_unit(table: Table, column: int) -> str:
    """What a column's name says in the place of a unit, if it is no unit of length that is known; else empty."""
    word = plain_name(table.names[column])[1] if table.names else ""
    return "" if word in LENGTHS else word


def parse_columns(columns: Any) -> tuple[str | int, ...]:
    """The parameter ``columns`` as names and numbers.

    >>> parse_columns("frame id x 'pos y'"), parse_columns((0, 1, 2, 4)), parse_columns("0 1 2 4")
    (('frame', 'id', 'x', 'pos y'), (0, 1, 2, 4), (0, 1, 2, 4))

    Raises:
        SpecError: it is neither text nor a sequence of text and whole numbers.
    """
    try:
        parts = shlex.split(columns) if isinstance(columns, str) else list(columns)
    except (TypeError, ValueError):
        parts = []
    if not parts or not all(isinstance(p, (str, int)) and not isinstance(p, bool) for p in parts):
        raise SpecError(
            f"columns={columns!r} must be names or numbers (from 0) of columns: 'frame id x y', '0 1 2 4' or "
            "(0, 1, 2, 4)."
        )
    return tuple(int(p) if isinstance(p, str) and re.fullmatch(r"\d{1,4}", p) else p for p in parts)


def find_columns(table: Table, columns: Sequence[str | int] | None, timed: bool = False) -> Columns:
    """Which columns of a table hold frame or time, id, x and y.

    Args:
        table: The table.
        columns: Names or numbers, as ``parse_columns`` gives them; None to find them by the header, or by the width of
            a table without a header.
        timed: Whether ``fps`` or ``dt`` is given, so that a frame number is preferred to a time.

    Raises:
        SpecError: a name or a number is not of the table, or says another role than its place.
        DataError: the columns cannot be found without ``columns``.
    """
    if columns is not None and table.names is not None:
        return _by_header(table, _named(table, columns))
    if columns is not None:
        return _by_layout(table, columns)
    return _guessed_by_header(table, timed) if table.names is not None else _guessed_by_width(table)


def _named(table: Table, columns: Sequence[str | int]) -> list[str | int]:
    """The columns; a number that is a name of the header becomes that name."""
    names = table.names or ()
    return [str(c) if isinstance(c, int) and str(c) in names else c for c in columns]


def _by_header(table: Table, columns: Sequence[str | int]) -> Columns:
    names = table.names or ()
    if len(columns) not in (3, 4):
        raise SpecError(
            f"columns={_text(columns)!r} names {len(columns)} columns: name four of the header of {table.path}, with "
            "spaces between them (on the command line in quotes), in the order frame (or time), id, x, y; or three, "
            f"without id, for a file of one person. {_header(table)}"
        )
    places = [_number(table, c) if isinstance(c, int) else _position(table, c) for c in columns]
    if len(set(places)) < len(places):
        raise SpecError(f"columns={_text(columns)!r} names a column of {table.path} twice. {_header(table)}")
    said = [role_of(names[c]) for c in places]
    kinds = ["time" if role == "frame" else role for role in said]
    expected = ["time", "id", "x", "y"] if len(places) == 4 else ["time", "x", "y"]
    wrong = next((i for i, kind in enumerate(kinds) if kind is not None and kind != expected[i]), None)
    if wrong is None:
        return _columns_at(places, True, "as stated")
    if sorted(map(str, kinds)) == sorted(expected):
        return _columns_at(
            [places[kinds.index(kind)] for kind in expected], True, "as stated, put in order by their names"
        )
    place = {"time": "the frame or time", "id": "the id"}.get(expected[wrong], expected[wrong])
    raise SpecError(
        f"columns={_text(columns)!r}: `{names[places[wrong]]}` stands at the place of {place}, and its name says "
        f"{said[wrong]}. The order is frame (or time), id, x, y (three columns: without id). "
        f"{_header(table)}"
    )


def _by_layout(table: Table, columns: Sequence[str | int]) -> Columns:
    width = len(table.columns)
    if all(isinstance(c, int) for c in columns):
        if len(columns) not in (3, 4) or len(set(columns)) < len(columns):
            raise SpecError(
                f"columns={_text(columns)!r} must be four different column numbers, counted from 0: those of frame (or "
                "time), id, x and y; or three, without id, for a file of one person."
            )
        return _columns_at([_number(table, int(c)) for c in columns], True, "as stated")
    if any(isinstance(c, int) for c in columns):
        raise SpecError(f"columns={_text(columns)!r} mixes names and numbers, and {table.path} has no header.")
    if len(columns) != width:
        raise SpecError(
            f"columns={_text(columns)!r} names {len(columns)} columns, and {table.path} has {width} and no header: "
            "name all of them from left to right, with - for those that are not needed (as 'frame id x y - -'), or "
            f"give the four numbers of frame, id, x and y, counted from 0. Its first row is {short(table.row(0))}."
        )
    roles = [role_of(str(name)) for name in columns]
    by_role: dict[str, int] = {}
    time: int | None
    for column, role in enumerate(roles):
        if role is None:
            continue
        if role in by_role:
            raise SpecError(
                f"columns={_text(columns)!r} names two columns {role}: `{columns[by_role[role]]}` and "
                f"`{columns[column]}`. Write - for the one that is not needed."
            )
        by_role[role] = column
    time = by_role.get("frame", by_role.get("time"))
    missing = [role for role in ("x", "y") if role not in by_role] + (["frame or time"] if time is None else [])
    if time is None or missing:
        raise SpecError(
            f"columns={_text(columns)!r} has no {' and no '.join(missing)}: name the columns of {table.path} from left "
            "to right, as 'frame id x y', with - for those that are not needed."
        )
    return Columns(time, by_role.get("id"), by_role["x"], by_role["y"], True, "as stated, from left to right")


def _guessed_by_header(table: Table, timed: bool) -> Columns:
    names = table.names or ()
    by_role: dict[str, list[int]] = {role: [] for role in ROLES}
    for column, name in enumerate(names):
        if role := role_of(name):
            by_role[role].append(column)
    x, y = _pair(table, by_role["x"], by_role["y"])
    frame, time, agent = (_single(table, by_role[role], role) for role in ("frame", "time", "id"))
    when = time if frame is None else frame
    if time is not None and frame is not None and not timed:
        fine = TIME_UNITS.get(time_unit(names[time]) or "", 0) >= 1000
        if fine or table.is_dates(time) or table.whole_numbers(time) is None:
            when = time  # a time that says its unit needs no fps
    if agent is None and when is not None and x is not None and y is not None:
        _refuse_other_ids(table, {when, x, y})
    if x is not None and y is not None and (names[x].strip().lower(), names[y].strip().lower()) == ("x", "y"):
        _refuse_box(table)
    one_person = agent is None and when is not None and len(set(table.texts(when))) == len(table)
    missing = {"frame or time": when is None, "id": agent is None and not one_person, "x and y": x is None or y is None}
    if x is None or y is None or when is None or any(missing.values()):
        words = {plain_name(name)[0] for name in names}
        box = " If they are boxes, write the centre or the foot point of each box as x and y." if (
            words & {"xmin", "x_min", "x1", "left", "bb_left", "bbox_left"} and x is None
        ) else ""  # fmt: skip
        degrees = " Longitude and latitude are degrees: convert them to metres first, as UTM." if (
            words & {"lat", "latitude"} and x is None
        ) else ""  # fmt: skip
        raise DataError(
            f"{table.path} has a header in which no name plainly says {', '.join(k for k, v in missing.items() if v)}. "
            f"{_header(table)}{degrees}{box} {HOW}: columns='FRAME ID X Y', with names of the header."
        )
    return Columns(when, agent, x, y, False, "by the names in the header")


def _refuse_other_ids(table: Table, used: set[int]) -> None:
    """Raise DataError if another column of text or whole numbers repeats values, so that it may be the id."""
    names, candidates = table.names or (), []
    for column, name in enumerate(names):
        if column in used or role_of(name) or plain_name(name)[0] in FLAGS:
            continue
        whole = table.whole_numbers(column)
        if whole is None and table.is_numeric(column):
            continue
        different = len(set(table.texts(column) if whole is None else whole.tolist()))
        if 1 < different < len(table):
            candidates.append(name)
    if candidates:
        told = ", ".join(f"`{name}`" for name in candidates)
        raise DataError(
            f"{table.path} has a header in which no name plainly says id, and {told} may be it: values repeat. "
            f"{_header(table)} {HOW}: columns='FRAME ID X Y', with names of the header; or columns='FRAME X Y' if the "
            "file is of one person."
        )


def _refuse_box(table: Table) -> None:
    """Raise DataError if x and y are followed by a width and a height, as of the corner of a box."""
    words = {plain_name(name)[0] for name in table.names or ()}
    sizes = next(({a, b} for a, b in (("w", "h"), ("width", "height")) if {a, b} <= words), None)
    if sizes and not words & {"z", "length", "l"}:
        raise DataError(
            f"{table.path} has a header of boxes: x, y, {' and '.join(sorted(sizes, reverse=True))}. It does not say "
            "which point of the box x and y are, and a corner moves if the size changes. Write a file with the centre "
            "or the foot point, x + w/2 and y + h; or, if x and y are such a point, say so: columns='FRAME ID X Y'. "
            f"{_header(table)}"
        )


def _guessed_by_width(table: Table) -> Columns:
    width = len(table.columns)
    if width == 8 and all(map(table.is_numeric, range(8))) and all(_constant(table, c) for c in (3, 6)):
        return Columns(0, 1, 2, 4, False, f"an obsmat, {' '.join(OBSMAT)}: columns 3 and 6 are constant")
    shown = f"Its first row is {short(table.row(0))}."
    if width > 20 > len(table):
        raise DataError(
            f"{table.path} has {len(table)} lines of {width} columns, so that it seems to be transposed: write a line "
            f"for each person and frame, frame id x y. {shown}"
        )
    if width != 4:
        raise DataError(
            f"{table.path} has {width} columns and no header, so that it is not known what they hold. {HOW}, counted "
            f"from 0: columns='0 1 2 3'; or name all from left to right, as columns='frame id x y"
            f"{' -' * max(width - 4, 0)}'. {shown}"
        )
    if not (table.is_numeric(0) or table.is_dates(0)) or not table.is_numeric(2) or not table.is_numeric(3):
        raise DataError(
            f"{table.path} has four columns and no header, but its columns are not frame (or time), id, x and y: "
            f"{'column 0 is not a number' if not table.is_numeric(0) else 'columns 2 and 3 are not both numbers'}. "
            f"{HOW} from left to right, as columns='id frame x y'. {shown}"
        )
    return Columns(0, 1, 2, 3, False, "four columns without a header: frame, id, x, y")


def _columns_at(places: Sequence[int], stated: bool, how: str) -> Columns:
    time, *agent, x, y = places
    return Columns(time, agent[0] if agent else None, x, y, stated, how)


def _position(table: Table, name: str) -> int:
    names = table.names or ()
    for form in (str, str.lower, lambda text: plain_name(text)[0]):
        matching = [i for i, other in enumerate(names) if form(name) and form(other) == form(name)]
        if len(matching) == 1:
            return matching[0]
        if matching and form(name):
            raise SpecError(f"`{name}` of `columns` is {len(matching)} columns of {table.path}. {_header(table)}")
    raise SpecError(f"{table.path} has no column `{name}`.{suggest(name, filter(None, names))}")


def _number(table: Table, column: int) -> int:
    width = len(table.columns)
    if not 0 <= column < width:
        raise SpecError(
            f"{table.path} has {width} columns, 0 to {width - 1}, and `columns` names {column}. Its first row is "
            f"{short(table.row(0))}."
        )
    return column


def _single(table: Table, candidates: Sequence[int], role: str) -> int | None:
    """The one column of a role; of several, the one whose name is the role itself."""
    names = table.names or ()
    plain = [c for c in candidates if names[c].strip().lower() == role]
    if len(candidates) > 1 and len(plain) != 1:
        _several(table, candidates, role)
    return next(iter(plain or candidates), None)


def _pair(table: Table, xs: Sequence[int], ys: Sequence[int]) -> tuple[int | None, int | None]:
    """The columns of x and y: those of these names, or the one pair whose names are alike."""
    exact = [name.strip().lower() for name in table.names or ()]
    if exact.count("x") == exact.count("y") == 1:
        return exact.index("x"), exact.index("y")
    words = [plain_name(name)[0] for name in table.names or ()]
    like = {words[y].replace("y", "x").replace("north", "east"): y for y in ys}
    pairs = [(x, like[words[x]]) for x in xs if words[x] in like]
    if len(pairs) > 1:
        _several(table, [x for x, _ in pairs], "x")
    return next(iter(pairs), (None, None))


def _several(table: Table, candidates: Sequence[int], role: str) -> NoReturn:
    named = ", ".join(f"`{(table.names or ())[c]}`" for c in candidates)
    raise DataError(
        f"{table.path} has several columns that may be the {role}: {named}. {HOW}: columns='FRAME ID X Y', with names "
        f"of the header. {_header(table)}"
    )


def _constant(table: Table, column: int) -> bool:
    values = table.numbers(column)
    return bool((values == values[0]).all())


def _header(table: Table) -> str:
    return f"The header is: {', '.join(table.names or ())}."


def _text(columns: Sequence[str | int]) -> str:
    return " ".join(map(str, columns))
