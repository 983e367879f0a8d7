"""Tables between markers in a file."""

import re

import pytest

from motion_gym.benchmarks import marked_block
from motion_gym.contract import DataError


def test_insert_replaces_what_is_between_the_markers(tmp_path):
    path = tmp_path / "README.md"
    before = "# Title\n<!-- results: a -->\nold\n<!-- results end -->\nmiddle\n"
    after = "<!-- results: b -->\n<!-- results end -->\nend \\1 é\n"
    path.write_text(before + after, encoding="utf-8")
    assert marked_block.insert(path, "b", "| new \\g<0> |")
    assert path.read_text(encoding="utf-8") == before + after.replace("-->\n<", "-->\n| new \\g<0> |\n<", 1)
    assert not marked_block.insert(path, "b", "| new \\g<0> |")
    assert marked_block.insert(path, "b", "")


@pytest.mark.parametrize(
    "text",
    [
        "nothing",
        "<!-- results: a -->\nno end",
        "<!-- results end -->\n<!-- results: a -->\n",
        "<!-- results: a -->\nno end\n<!-- results: b -->\n<!-- results end -->\n",
    ],
)
def test_missing_markers_are_named_and_nothing_is_written(tmp_path, text):
    path = tmp_path / "README.md"
    path.write_text(text)
    with pytest.raises(DataError, match=r"<!-- results: a -->.*<!-- results end -->.*add them"):
        marked_block.insert(path, "a", "table")
    assert path.read_text() == text


def test_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x81")
    for path in (tmp_path / "missing.md", tmp_path, tmp_path / "binary"):
        with pytest.raises(DataError, match=f"{re.escape(str(path))} cannot be read"):
            marked_block.insert(path, "a", "table")
