"""Tables between markers in a file: nothing but the block changes."""

import os
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_gym.benchmarks.reports import marked_block
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


def test_line_ends_and_permissions_stay(tmp_path):
    path = tmp_path / "README.md"
    path.write_bytes(b"a\r\n<!-- results: b -->\r\nold\r\n<!-- results end -->\r\nz\r\n")
    path.chmod(0o640)
    assert marked_block.insert(path, "b", "one\ntwo")
    assert path.read_bytes() == b"a\r\n<!-- results: b -->\r\none\r\ntwo\r\n<!-- results end -->\r\nz\r\n"
    assert path.stat().st_mode & 0o777 == 0o640
    assert not marked_block.insert(path, "b", "one\ntwo")


def test_a_link_stays_a_link(tmp_path):
    path, link = tmp_path / "real.md", tmp_path / "README.md"
    path.write_text("<!-- results: b -->\n<!-- results end -->\n")
    link.symlink_to("real.md")
    assert marked_block.insert(link, "b", "new")
    assert link.is_symlink() and os.readlink(link) == "real.md" and "new" in path.read_text()


def test_every_block_of_a_name_is_updated(tmp_path):
    path = tmp_path / "README.md"
    block = "<!-- results: b -->\nold\n<!-- results end -->\n"
    path.write_text(f"{block}between\n{block}")
    assert marked_block.insert(path, "b", "new")
    assert path.read_text() == f"{block}between\n{block}".replace("old", "new")


@given(st.text(st.sampled_from("a<!- results:end>\n"), max_size=60), st.integers(0, 3))
def test_a_marker_inside_the_text_is_escaped_and_the_file_does_not_grow(tmp_path_factory, text, place):
    marker = ["", "<!-- results end -->", "<!-- results: b -->", "<!-- results: c -->"][place]
    path = tmp_path_factory.mktemp("marked") / "README.md"
    path.write_text("before\n<!-- results: b -->\n<!-- results end -->\nafter\n")
    marked_block.insert(path, "b", f"{text}{marker}\n{text}")
    first = path.read_text()
    assert not marked_block.insert(path, "b", f"{text}{marker}\n{text}")
    assert path.read_text() == first and first.startswith("before\n") and first.endswith("\nafter\n")


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
