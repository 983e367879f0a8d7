"""Output for programs: JSON in place of tables, and progress where there is no terminal."""

import json
import shlex
import subprocess
import sys

import pytest

from motion_gym import catalog
from motion_gym.cli import output
from motion_gym.cli.main import main
from tests.cli.command_line import call, fail


def parsed(capsys, line):
    main(shlex.split(line))
    return json.loads(capsys.readouterr().out)


def test_scores_are_printed_as_json(capsys, folder):
    printed = parsed(capsys, "score linear --domain orca:scenes=30 --json --out o")
    table = call(capsys, "score linear --domain orca:scenes=30")

    assert [run["predictor"] for run in printed] == ["constant_velocity", "linear", "orca_oracle"]
    assert all(f"{run['metrics']['ADE']['mean']:.3f}".lstrip("0") in table for run in printed)
    stored = [json.loads(path.read_text()) for path in (folder / "o").glob("*.json")]
    assert sorted(run["predictor"] for run in stored) == sorted(run["predictor"] for run in printed)


def test_adaptation_is_printed_as_json(capsys):
    streams = "--stream orca:d=0.3,scenes=40 --stream orca:d=0.6,scenes=40 --frames 300"
    runs = parsed(capsys, f"adapt constant_velocity --adapter hedge {streams} --json")

    assert [run["row"] for run in runs] == ["constant_velocity", "none", "hedge"]
    assert all(run["segments"][0]["ade"]["mean"] > 0 for run in runs)


def test_listings_are_printed_as_json(capsys):
    printed = parsed(capsys, "ls --json")
    assert {"name": "eth", "id": "ETH-v0", "description": catalog.DOMAINS["eth"].summary} in printed["domains"]
    assert [row["name"] for row in printed["predictors"]] == list(catalog.PREDICTORS)

    (explained,) = parsed(capsys, "ls linear --json")
    assert (explained["kind"], explained["name"]) == ("predictor", "linear") and explained["description"]
    assert explained["signature"] == "(sigma: bool | str = False, ridge: float = 1.0)"
    assert [entry["kind"] for entry in parsed(capsys, "ls style --json")] == ["adapter", "benchmark"]


@pytest.mark.parametrize(("word", "meant"), [("scor", "score"), ("Score", "score"), ("chekc", "check")])
def test_a_misspelt_command_is_corrected(capsys, word, meant):
    assert f"There is no command `{word}`. Did you mean `{meant}`?" in fail(capsys, f"{word} eth").err


@pytest.mark.parametrize(("seconds", "lines"), [(0.0, 10), (1e9, 0)])
def test_progress_without_a_terminal_is_a_line_now_and_then(capsys, monkeypatch, seconds, lines):
    monkeypatch.setattr(output, "SECONDS_BETWEEN_LINES", seconds)
    with output.progress_bar() as progress:
        report = output.reporter(progress, "training")
        for done in range(10):
            report(done, 10, "epochs")

    printed = capsys.readouterr().err.splitlines()
    assert printed == [f"{done} of 10 done: epochs" for done in range(lines)]


def test_a_predictor_that_prints_leaves_the_json_alone(folder, monkeypatch):
    (folder / "chatty.py").write_text(
        "import motion_gym\n"
        "class Chatty:\n"
        "    def predict(self, observation, samples=1, seed=0):\n"
        "        print('hello')\n"
        "        return observation.xy[:, None, -1:].repeat(12, axis=2)\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "motion_gym", "score", "chatty:Chatty", "--domain", "orca:scenes=20", "--json"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(done.stdout) and "hello" in done.stderr
