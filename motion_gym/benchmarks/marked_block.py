"""A table between two markers in a text file, such as a README."""

from __future__ import annotations

import re
from pathlib import Path

from motion_gym.contract import DataError
from motion_gym.data.storage import write_atomic

BEGIN, END = "<!-- results: {name} -->", "<!-- results end -->"


def insert(path: Path, name: str, text: str) -> bool:
    """Replace what stands between the markers ``<!-- results: name -->`` and ``<!-- results end -->``.

    Returns:
        Whether the file changed.

    Raises:
        DataError: the file has no such markers, or cannot be read.
    """
    old, pattern = check_markers(path, name)
    begin = BEGIN.format(name=name)
    new = pattern.sub(lambda _: f"{begin}\n{text}\n{END}", old, count=1)
    if new != old:
        write_atomic(path, new.encode())
    return new != old


def check_markers(path: Path, name: str) -> tuple[str, re.Pattern[str]]:
    """The text of a file, and what finds the part between the markers in it; DataError if it has none."""
    begin = BEGIN.format(name=name)
    try:
        old = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise DataError(f"{path} cannot be read: {error}. Name a text file to put the table into.") from None
    pattern = re.compile(re.escape(begin) + r"\n(?:(?!<!-- results: ).)*?" + re.escape(END), re.DOTALL)
    if not pattern.search(old):
        raise DataError(f"{path} has no lines `{begin}` and `{END}` to put the table between: add them.")
    return old, pattern
