"""A predictor that was trained on the people of the scored file is declared, whatever the file is called."""

import pytest

import motion_gym
from motion_gym import domain
from motion_gym.data.overlap import trained_on_scored
from tests.walks import walk_rows, write_rows

ROWS = walk_rows(people=6, frames=3000, every=5)
COPIES = {
    "copy": (lambda f, a, x, y: (f, a, x, y), {}),
    "frames shifted and ids renamed": (lambda f, a, x, y: (f + 1003, f"p{9 - a}", x, y), {}),
    "irregular": (lambda f, a, x, y: (f / 24 + 3, a, x, y), {"header": "time,id,x,y"}),
}


def leaks(path, other, **keywords):
    return motion_gym.evaluate("linear", domain("tracks", path=path, sources=str(other), **keywords)).leaks


@pytest.mark.parametrize("form", COPIES)
def test_a_copy_of_the_scored_file_is_declared(tmp_path, form):
    change, options = COPIES[form]
    timed = {} if "header" in options else {"fps": 25}
    rows = [change(*row) for row in ROWS]
    path = write_rows(tmp_path / "a.csv", ROWS if timed else [(f - 3, *row) for f, *row in rows], **options)
    other = write_rows(tmp_path / "b.csv", rows, **options)
    (leak,) = leaks(path, other, **timed)
    assert "the weights were trained on windows of" in leak and "b.csv" in leak


def test_a_link_and_a_part_of_other_phase_are_declared(tmp_path):
    path = write_rows(tmp_path / "a.csv", ROWS)
    (tmp_path / "link.csv").symlink_to(path)
    assert leaks(path, tmp_path / "link.csv", fps=25)
    dense = walk_rows(people=6, frames=3000)
    whole = write_rows(tmp_path / "whole.csv", dense)
    part = write_rows(tmp_path / "part.csv", [row for row in dense if row[0] % 10 == 3 or row[0] % 10 == 4])
    assert trained_on_scored(
        domain("tracks", path=part, fps=25, split="0.8 0.2 0"), domain("tracks", path=whole, fps=25, split="0 0 1"),
        "test",
    )  # fmt: skip


def test_other_people_of_whole_pixels_are_not_accused(tmp_path):
    first, second = ([(f, a, round(4 * x), round(4 * y)) for f, a, x, y in walk_rows(people=20, frames=3000, seed=s)]
                     for s in (1, 2))  # fmt: skip
    path = write_rows(tmp_path / "a.csv", first)
    other = write_rows(tmp_path / "b.csv", second)
    assert not leaks(path, other, fps=25, unit="px")


def test_another_part_of_a_copy_is_no_leak(tmp_path):
    path, other = write_rows(tmp_path / "a.csv", ROWS), write_rows(tmp_path / "b.csv", ROWS)
    parts = [domain("tracks", path=p, fps=25, split=split) for p, split in ((other, "0.5 0 0.5"), (path, "0.5 0 0.5"))]
    assert not trained_on_scored(*parts, "test") and trained_on_scored(*parts, "train")
