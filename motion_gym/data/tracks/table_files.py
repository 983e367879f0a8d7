"""Files to tables: delimiter and header of text, and Parquet and TrajNet++ ndjson."""

from __future__ import annotations

import csv
import json
import os
import re
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from motion_gym.contract import EXACT, DataError, SpecError
from motion_gym.data.tracks.column_names import role_of
from motion_gym.data.tracks.file_content import content_of, decoded, decompressed
from motion_gym.data.tracks.tables import DATE, DECIMAL_COMMA, DELIMITERS, NUMBER, Table, short

SAMPLE = 1000
"""Lines from which the delimiter is found."""
SHARE = 0.9
"""Share of the lines, and of the fields of a numeric column, that must agree for a delimiter to be taken."""
_SKIPPED = re.compile(r"\s*([#%]|$)").match


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read the rows of a text, Parquet or TrajNet++ ndjson file.

    Compression is found by the first bytes, never by the name. The encoding is that of the byte order mark, else
    UTF-8, else Latin-1. The delimiter is the first one of tab, semicolon, comma and spaces that gives almost all lines
    one width of three or more. Blank lines and comments (``#``, ``%``) are skipped; the last comment before the rows,
    or the first row, is the header if it has as many fields as the rows, none of them a number.

    Args:
        path: The file.

    Raises:
        DataError: the file is missing, empty, damaged, no table, or a line has another width; the message names the
            first such line.
        SpecError: ``path`` is no text.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise SpecError(
            f"path={path!r} is not text: give the name of a file, and quote it in a spec where it looks like a number, "
            "as in \"path='2024'\"."
        )
    path = Path(path)
    content, compression = decompressed(path, content_of(path))
    if content[:4] == b"PAR1":
        return _parquet(path)
    text, encoding = decoded(path, content)
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if text.lstrip()[:1] == "{":
        return _ndjson(path, text, encoding, compression)
    return _text_table(path, text, encoding, compression)


def _text_table(path: Path, text: str, encoding: str, compression: str) -> Table:
    complete = text.endswith("\n")
    lines = text.removesuffix("\n").split("\n")
    numbers: Sequence[int] = range(1, len(lines) + 1)
    skipped = {n: line for n, line in enumerate(lines, 1) if _SKIPPED(line)}
    if skipped:
        lines = [line for n, line in enumerate(lines, 1) if n not in skipped]
        numbers = [n for n in numbers if n not in skipped]
    comments = [(n, line.strip().lstrip("#% \t")) for n, line in skipped.items() if line.strip()]
    if not lines:
        raise DataError(f"{path} is empty but for comments. Expected a row for each person and frame: frame id x y.")
    delimiter = _delimiter(path, lines, numbers)
    first = _split(path, lines[:1], numbers, delimiter)[0]
    names = None if any(map(_is_value, first)) else tuple(first)
    body, where = (lines, numbers) if names is None else (lines[1:], numbers[1:])
    columns: Sequence[Sequence[str] | np.ndarray] | None = _numeric_columns(body, delimiter)
    if columns is None:
        columns = _text_columns(path, body, where, delimiter, complete)
        named = names is not None and len(names) == len(columns) and names[-1] != ""
        if len(columns) > 3 and not named and not any(columns[-1]):
            columns = columns[:-1]  # each line ends with a delimiter
    width = len(columns)
    if names is not None and len(names) == width + 1 and not names[-1]:
        names = names[:-1]
    if names is not None and len(names) == width - 1:
        names = ("", *names)  # as R writes tables: the row names have no header
    if names is not None and len(names) != width:
        raise DataError(
            f"{path}, line {numbers[0]}: the header has {len(names)} columns and the rows have {width}: "
            f"{short(lines[0])}. Give the header a name for each column."
        )
    if names is None and comments:
        names = _commented_header([comment for number, comment in comments if number < where[0]], delimiter, width)
    return Table(
        path,
        names,
        columns,
        np.array(where, np.int64),
        encoding=encoding,
        delimiter=DELIMITERS[delimiter],
        compression=compression,
        comments=tuple(comment for _, comment in comments),
        complete=complete,
        source=text,
    )


LEADING_ZERO = re.compile(r"(?:^|[\s,;|])[+-]?0\d", re.MULTILINE)
"""A field such as 01, which may be another id than 1."""


def _numeric_columns(lines: Sequence[str], delimiter: str) -> Sequence[np.ndarray] | None:
    """[R] float64 for each column, by numpy's parser, which is fast; None if a field is more than such a number."""
    if LEADING_ZERO.search("\n".join(lines)):
        return None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            table = np.loadtxt(lines, delimiter=delimiter if delimiter != " " else None, comments=None, ndmin=2)
    except (ValueError, UserWarning):
        return None
    return list(table.T) if not (np.abs(table) >= EXACT).any() else None


def _text_columns(
    path: Path, lines: Sequence[str], numbers: Sequence[int], delimiter: str, complete: bool
) -> Sequence[list[str]]:
    """The fields of each column."""
    rows = _split(path, lines, numbers, delimiter)
    width = Counter(map(len, rows)).most_common(1)[0][0]
    bad = next((row for row, fields in enumerate(rows) if len(fields) != width), None)
    if bad is not None:
        fault, remedy = f"{len(rows[bad])} columns where the other lines have {width}", "Correct or delete the line."
        if bad == len(rows) - 1 and not complete:
            fault = f"the file ends in the middle of this line, after {len(rows[bad])} of {width} columns"
            remedy = "It was probably truncated: get it again, or delete the line."
        raise DataError(f"{path}, line {numbers[bad]}: {fault}: {short(lines[bad])}. {remedy}")
    return [list(column) for column in zip(*rows, strict=True)]


def _delimiter(path: Path, lines: Sequence[str], numbers: Sequence[int]) -> str:
    """The delimiter of a table, from its first lines; the first one may be a header."""
    begin = 1 if len(lines) > 1 else 0
    sample, where = lines[begin : SAMPLE + 1], numbers[begin : SAMPLE + 1]
    fallback = damage = None
    for delimiter in DELIMITERS:
        try:
            rows = _split(path, sample, where, delimiter)
        except DataError as error:  # a quote that is not closed, or a field that is far too long
            damage = error
            continue
        (width, count), *_ = Counter(map(len, rows)).most_common(1)
        regular = [row for row in rows if len(row) == width]
        numeric = sum(sum(map(_is_value, column)) >= SHARE * count for column in zip(*regular, strict=True))
        if width < 3 or numeric < 2:
            continue
        if count >= SHARE * len(rows):
            return delimiter
        if fallback is None and 2 * count >= len(rows):
            fallback = delimiter
    if fallback is None and damage is not None:
        raise damage
    if fallback is None and len(lines) == 1 and _is_header(path, lines, numbers):
        raise DataError(
            f"{path} has a header, {short(lines[0])}, and no rows. Expected a row for each person and frame: "
            "frame id x y."
        )
    if fallback is None:
        raise DataError(
            f"{path} is not a table of numbers: its lines do not have three or more columns separated by tabs, "
            f"semicolons, commas or spaces. It begins with {short(lines[0])}. Expected a row for each person and "
            "frame: frame id x y."
        )
    return fallback


def _is_header(path: Path, lines: Sequence[str], numbers: Sequence[int]) -> bool:
    """Whether a single line is a header: three or more fields, none of them a number, and names of x and y."""
    for delimiter in DELIMITERS:
        fields = _split(path, lines, numbers, delimiter)[0]
        if len(fields) > 2 and not any(map(_is_value, fields)) and {"x", "y"} <= set(map(role_of, fields)):
            return True
    return False


def _split(path: Path, lines: Sequence[str], numbers: Sequence[int], delimiter: str) -> list[list[str]]:
    """The fields of each line; DataError if a quoted field does not end in its line."""
    quoted = any('"' in line for line in lines)
    if delimiter == " " and not quoted:
        return [line.split() for line in lines]
    if delimiter == " ":
        lines = [" ".join(line.split()) for line in lines]
    rows: list[list[str]] = []
    reader = csv.reader([*lines, ""], delimiter=delimiter)  # the empty line shows whether the last one is complete
    try:
        for row in reader:
            rows.append(row)
            if reader.line_num > len(rows):
                raise DataError(
                    f"{path}, line {numbers[len(rows) - 1]}: a quoted field does not end in this line: "
                    f"{short(lines[len(rows) - 1])}. Close or delete the quote; a field must not hold a line break."
                )
    except csv.Error as error:
        raise DataError(f"{path}, line {numbers[len(rows)]}: {error}. Correct the line.") from None
    rows.pop()
    if any(" " in line or "\t" in line for line in lines):
        rows = [[field.strip() for field in row] for row in rows]
    return rows


def _is_value(field: str) -> bool:
    """Whether a field is a number or a date, as no name of a column is."""
    field = field.strip()
    return any(pattern.fullmatch(field) for pattern in (NUMBER, DECIMAL_COMMA, DATE)) and field.lower() != "nan"


def _commented_header(comments: Sequence[str], delimiter: str, width: int) -> tuple[str, ...] | None:
    """Names from the last comment before the rows, if it names as many columns as there are."""
    for separator in dict.fromkeys((delimiter, "\t", ";", ",", None)):
        names = [name.strip().strip('"') for name in (comments or [""])[-1].strip().split(separator)]
        if separator == " ":
            names = [name for name in names if name]
        if len(names) == width and not any(map(_is_value, names)):
            return tuple(names)
    return None


def _ndjson(path: Path, text: str, encoding: str, compression: str) -> Table:
    """Tracks of a TrajNet++ file; rows with a prediction number are forecasts, and are left out."""
    rows, where, rates = [], [], set()
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        try:
            entry = json.loads(line)
            track = entry.get("track")
            if track is not None and track.get("prediction_number") is None:
                rows.append((track["f"], track["p"], track["x"], track["y"]))
                where.append(number)
            elif track is None and entry.get("scene", {}).get("fps"):
                rates.add(float(entry["scene"]["fps"]))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise DataError(
                f"{path}, line {number}: {error!r} in {short(line)}. Expected TrajNet++ rows, as "
                '{"track": {"f": 0, "p": 1, "x": 0.5, "y": 1.5}}.'
            ) from None
    if not rows:
        raise DataError(f'{path} has no rows {{"track": ...}} of ground truth: it is no TrajNet++ file of tracks.')
    if len(rates) > 1:
        raise DataError(f"{path} has scenes of several fps, {sorted(rates)}: make one file for each.")
    columns = [["" if value is None else str(value) for value in column] for column in zip(*rows, strict=True)]
    names = ("frame", "id", "x", "y")
    fps = rates.pop() if rates else None
    lines = np.array(where, np.int64)
    return Table(
        path, names, columns, lines, "TrajNet++ ndjson", encoding, compression=compression, fps=fps, source=text
    )


def _parquet(path: Path) -> Table:
    try:
        import pyarrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise DataError(
            f"{path} is a Parquet file, which needs pyarrow: pip install 'motion-gym[parquet]'. Or save it as csv."
        ) from None
    try:
        table = parquet.read_table(path)
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise DataError(f"{path} is a Parquet file that cannot be read ({error}). Get it again.") from None
    if not table.num_rows:
        raise DataError(f"{path} has no rows. Expected a row for each person and frame: frame id x y.")
    columns = [column.to_numpy() for column in table.columns]
    return Table(path, tuple(table.column_names), columns, np.arange(1, table.num_rows + 1), "Parquet")
