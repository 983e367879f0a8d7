"""Insert tables into a user's file: only the text between two markers changes."""

from __future__ import annotations

import os
import re
from pathlib import Path

from motion_gym.contract import DataError
from motion_gym.data.storage import atomic_file, exclusive

BEGIN, END = "<!-- results: {name} -->", "<!-- results end -->"


def insert(path: Path, name: str, text: str) -> bool:
    """Replace the text between ``<!-- results: name -->`` and ``<!-- results end -->``, at each place in a file.

    Line ends, permissions and links do not change. A marker inside the text is escaped.

    Returns:
        Whether the file changed.

    Raises:
        DataError: the file has no such markers, or cannot be read.
    """
    check_markers(path, name)
    target = path.resolve()  # a link stays a link
    with exclusive(target.parent):
        content, pattern = check_markers(path, name)
        newline = "\r\n" if "\r\n" in content else "\n"
        lines = text.replace("<!-- results", "&lt;!-- results").splitlines()
        block = newline.join([BEGIN.format(name=name), *lines, END])
        new = pattern.sub(lambda _: block, content)
        if new != content:
            with atomic_file(target) as file:
                os.chmod(file.name, target.stat().st_mode & 0o7777)
                file.write(new.encode())
    return new != content


def check_markers(path: Path, name: str) -> tuple[str, re.Pattern[str]]:
    """The text of a file, and the pattern of its block; DataError if the file has no such block."""
    begin = BEGIN.format(name=name)
    try:
        content = path.read_bytes().decode()
    except (OSError, ValueError) as error:
        raise DataError(f"{path} cannot be read: {error}. Name a text file to put the table into.") from None
    pattern = re.compile(re.escape(begin) + r"\r?\n(?:(?!<!-- results: ).)*?" + re.escape(END), re.DOTALL)
    if not pattern.search(content):
        raise DataError(f"{path} has no lines `{begin}` and `{END}` to put the table between: add them.")
    return content, pattern
