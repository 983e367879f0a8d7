"""Tables from files: the fields of every row, column by column, with the number of each line.

``table_files`` reads them, and ``track_columns`` decides what a column means.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np

from motion_gym.contract import EXACT, DataError

NUMBER = re.compile(r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.ASCII | re.IGNORECASE)
DECIMAL_COMMA = re.compile(r"[+-]?(\d+,\d*|,\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
DATE = re.compile(r"\d{4}[-/]\d{1,2}[-/]\d{1,2}([T ].*)?|\d{1,2}:\d{2}:\d{2}([.,]\d+)?", re.ASCII)
MISSING = frozenset(("", "na", "n/a", "nan", "null", "none", "-", "?"))
"""Fields, in lower case, that stand for a value that is not there."""
DELIMITERS = {"\t": "tab", ";": "semicolon", ",": "comma", " ": "spaces"}
"""What columns are separated by, in the order in which it is tried."""


@dataclass(frozen=True, eq=False)
class Table:
    """The rows of a file.

    Attributes:
        path: The file.
        names: Names of the columns as the header has them; None where the file has no header.
        columns: Fields by column: text as in the file, or numbers of a Parquet or ndjson file.
        lines: [R] int64, number of each row's line, from 1; of the row in a Parquet file.
        format: ``text``, ``Parquet`` or ``TrajNet++ ndjson``.
        encoding: Encoding of a text file.
        delimiter: What separates the columns of a text file, in words.
        compression: ``gzip``, ``bzip2``, ``xz`` or nothing.
        comments: Comment lines, without their first character.
        complete: Whether the last line ends with a newline.
        fps: Rows per second and person, where the file says it (TrajNet++).
        source: The text, for messages.
    """

    path: Path
    names: tuple[str, ...] | None
    columns: Sequence[Sequence[str] | np.ndarray]
    lines: np.ndarray
    format: str = "text"
    encoding: str = ""
    delimiter: str = ""
    compression: str = ""
    comments: tuple[str, ...] = ()
    complete: bool = True
    fps: float | None = None
    source: str = ""

    def __len__(self) -> int:
        return len(self.lines)

    def title(self, column: int) -> str:
        """A column in words: its number, and its name if it has one."""
        name = self.names[column] if self.names else ""
        return f"column {column} `{name}`" if name else f"column {column}"

    def numbers(self, column: int) -> np.ndarray:
        """[R] float64, the numbers of a column; NaN where a field is empty.

        Raises:
            DataError: a field is not a number; the message names the first line.
        """
        fields = self.columns[column]
        if isinstance(fields, np.ndarray) and fields.dtype.kind in "iufb":
            return fields.astype(np.float64)
        texts = self.texts(column)
        if not any(map(_ODD.search, texts)):  # float() also takes 1_000 and digits of other scripts
            try:
                return np.array(list(map(float, texts)))
            except ValueError:
                pass
        texts = ["nan" if text.lower() in MISSING else text for text in texts]
        commas = [text for text in texts if "," in text]
        if commas and self.delimiter != DELIMITERS[","] and not any("." in text for text in texts):
            texts = [text.replace(",", ".") if DECIMAL_COMMA.fullmatch(text) else text for text in texts]
        bad = next((row for row, text in enumerate(texts) if not NUMBER.fullmatch(text)), None)
        if bad is not None:
            fault = f"{self.title(column)} is {self.texts(column)[bad]!r}, not a number"
            if commas and self.delimiter != DELIMITERS[","]:
                remedy = "Write all numbers of the column with a decimal point, or all with a decimal comma."
            else:
                remedy = "Correct or delete the line, or say with `columns` which columns to read."
            self.refuse(bad, fault, remedy)
        return np.array(list(map(float, texts)))

    def is_numeric(self, column: int) -> bool:
        """Whether every field of a column is a number or empty, and at least one is a number."""
        try:
            return bool((~np.isnan(self.numbers(column))).any())
        except DataError:
            return False

    def whole_numbers(self, column: int) -> np.ndarray | None:
        """[R] int64, exact, if every field of a column is a whole number below 2**63 (2**53 for 1.0); else None."""
        fields = self.columns[column]
        if isinstance(fields, np.ndarray) and fields.dtype.kind in "iu":
            return fields.astype(np.int64) if (fields <= np.iinfo(np.int64).max).all() else None
        texts = self.texts(column)
        try:
            return None if any(map(_ODD.search, texts)) else np.array(list(map(int, texts)), np.int64)
        except (ValueError, OverflowError):
            pass
        try:
            values = self.numbers(column)
        except DataError:
            return None
        whole = np.isfinite(values) & (np.abs(values) < EXACT)
        whole[whole] &= values[whole] == np.rint(values[whole])
        return values.astype(np.int64) if whole.all() else None

    def texts(self, column: int) -> Sequence[str]:
        """The fields of a column as text, without blanks around them; an empty text for a missing value."""
        fields = self.columns[column]
        if isinstance(fields, np.ndarray):
            return ["" if value is None or value != value else str(value).strip() for value in fields.tolist()]
        return fields

    def is_dates(self, column: int) -> bool:
        """Whether a column holds dates or times of the day."""
        fields = self.columns[column]
        if isinstance(fields, np.ndarray) and fields.dtype.kind == "M":
            return True
        return bool(len(self)) and all(map(DATE.fullmatch, self.texts(column)))

    def row(self, row: int) -> str:
        """The line of a row, for messages."""
        if self.source:
            return self.source.split("\n")[self.lines[row] - 1].strip()
        return " | ".join(str(fields[row]) for fields in self.columns)

    def refuse(self, row: int, fault: str, remedy: str) -> NoReturn:
        """Raise DataError that names the line of a row, what is wrong and what to do."""
        raise DataError(f"{self.path}, line {self.lines[row]}: {fault}: {short(self.row(row))}. {remedy}")


_ODD = re.compile(r"_|[^\x00-\x7f]")


def short(text: str) -> str:
    """The text in quotes, cut after 100 characters."""
    return repr(text if len(text) <= 100 else text[:100] + "...")
