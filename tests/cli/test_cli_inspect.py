"""The verb inspect, and the warnings of score and check about files of a user's own."""

from __future__ import annotations

import json

import pytest

from motion_gym.cli.main import main
from tests.walks import walk_rows, walks_file, write_rows


@pytest.fixture
def feet(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = [(f, f"ped{a}", x / 0.3048, y / 0.3048) for f, a, x, y in walk_rows(people=9, frames=1500, fps=10)]
    return write_rows(tmp_path / "my walk,1.csv", rows, ";").name


def test_inspect_prints_a_report_and_json(capsys, feet):
    main(["inspect", feet, "--fps", "10"])
    out = capsys.readouterr().out
    assert "header frame, id, x, y" in out and "every 4th frame number" in out and "unit=ft" in out
    main(["inspect", feet, "--fps", "10", "--unit", "ft", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["warnings"] == [] and found["measured"]["median speed"] == pytest.approx(1.3, rel=0.05)
    main(["inspect", f"tracks:path='{feet}',fps=10,unit=ft", "--json"])
    assert json.loads(capsys.readouterr().out)["measured"] == found["measured"]


def test_a_file_that_cannot_be_read_is_one_message(capsys, feet):
    with pytest.raises(SystemExit):
        main(["inspect", feet])
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ") and "Give fps" in captured.err and "Traceback" not in captured.err


def test_score_prints_warnings_and_which_part_was_scored(capsys, feet):
    main(["score", "linear", "--domain", f"tracks:path='{feet}',fps=10"])
    captured = capsys.readouterr()
    assert "warning: The median speed is 4.2" in captured.err.replace("\n", " ") and "unit=ft" in captured.err
    assert "test 80 to 100 % of the time" in " ".join(captured.out.split())
    main(["score", "linear", "--domain", f"tracks:path='{feet}',fps=10,unit=ft"])
    assert "warning" not in capsys.readouterr().err


def test_score_says_once_that_there_is_no_test_window_and_what_to_write(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = walk_rows(people=9, frames=1500)
    write_rows("walk.csv", [(f, a, x, y) for f, a, x, y in rows if f < 700])
    with pytest.raises(SystemExit):
        main(["score", "linear", "--domain", "tracks:path=walk.csv,fps=25"])
    error = " ".join(capsys.readouterr().err.split())
    assert error.count("has no window: nobody is there") == 1 and "warning" not in error
    assert 'To score the whole file, write --domain "tracks:path=walk.csv,fps=25,split=0 0 1"' in error
    assert "for `inspect`: --split '0 0 1'" in error
    with pytest.raises(SystemExit):
        main(["score", "linear", "--domain", "tracks:path=walk.csv,fps=25,split=0 0 1"])
    error = " ".join(capsys.readouterr().err.split())
    assert "Domain `tracks` has nothing to train on: split=0 0 1 leaves no part of the file for training." in error
    assert '--domain "tracks:path=walk.csv,fps=25,split=0.5 0 0.5", or name another file to train on, sources=' in error


def test_inspect_fits_the_terminal_and_a_whole_rate_is_written_as_such(capsys, feet):
    main(["inspect", feet, "--fps", "10", "--unit", "ft"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "tracks:path='my walk,1.csv',fps=10,unit=ft" and max(map(len, lines)) <= 80


def test_a_misspelt_file_a_rate_that_is_no_number_and_a_file_that_is_no_name(capsys, feet):
    for line, said in (
        (["inspect", "my wlak,1.csv"], "Did you mean `my walk,1.csv`?"),
        (["inspect", feet, "--fps", "abc"], "`fps=abc` of domain `tracks` must be a number"),
        (["check", feet], "It is a file: write `tracks:path='my walk,1.csv'`, with fps=25 or dt=0.4"),
    ):
        with pytest.raises(SystemExit):
            main(line)
        assert said in capsys.readouterr().err


def test_check_accepts_a_file(capsys):
    main(["check", f"tracks:path={walks_file()},fps=25"])
    out = capsys.readouterr().out
    assert "keeps the contract of a domain" in out and out.count("no leak found") == 2
