"""The verb that adapts a predictor on a stream, as it is typed."""

from __future__ import annotations

import json
import shlex

import pytest

from motion_gym.cli.main import main

SHORT = "--stream orca:d=0.3,scenes=40 --stream orca:d=0.6,scenes=40 --frames 300"
BROKEN = '''
from tests.bias import Bias


class Breaks(Bias):
    """Learns well for a while."""

    def observe(self, truth):
        super().observe(truth)
        if self.updates > 5:
            raise ValueError("the wheel came off")


class Learns(Bias):
    """Learns from being asked."""

    def predict(self, observation, samples=1, seed=0):
        self.bias = self.bias + 0.1
        return super().predict(observation, samples, seed)


class Counts(Bias):
    """Keeps in a list how often it was asked."""

    def reset(self):
        super().reset()
        self.asked = []

    def predict(self, observation, samples=1, seed=0):
        self.asked.append(observation)
        return super().predict(observation, samples, seed) + 0.001 * len(self.asked)
'''


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    (tmp_path / "broken_adapters.py").write_text(BROKEN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def adapt(capsys, line):
    """What was printed, and the message that it ended with."""
    message = ""
    try:
        main(shlex.split(f"adapt {line}"))
    except SystemExit as stopped:
        assert stopped.code == 2
        message = "ended with"
    captured = capsys.readouterr()
    return captured.out, message and captured.err


def test_a_table_with_the_source_and_constant_velocity(capsys, folder):
    out, message = adapt(capsys, f"linear --adapter kalman {SHORT} --out results")
    assert not message
    for row in ("constant_velocity", "none", "kalman"):
        assert f"  {row} " in out
    assert "no oracle was named" in out
    cards = [json.loads(path.read_text()) for path in (folder / "results").glob("*.json")]
    assert sorted(card["row"] for card in cards) == ["constant_velocity", "kalman", "none"]
    again, _ = adapt(capsys, f"linear --adapter kalman {SHORT} --out results")
    assert again == out  # read from the files, times included


def test_an_own_adapter_is_run_anew_and_shipped_rows_are_reused(capsys, folder):
    line = f"linear --adapter tests.bias:Bias --adapter none {SHORT} --out r"
    adapt(capsys, line)
    paths = {json.loads(path.read_text())["row"]: path for path in (folder / "r").glob("*.json")}
    for path in paths.values():
        path.write_text(json.dumps({**json.loads(path.read_text()), "updates": 12345}))
    adapt(capsys, line)
    updates = {row: json.loads(path.read_text())["updates"] for row, path in paths.items()}
    assert updates.pop("tests.bias:Bias") != 12345
    assert set(updates) == {"constant_velocity", "none"} and set(updates.values()) == {12345}
    assert not list((folder / "r").glob("*.checkpoint"))  # these are in the user's cache


@pytest.mark.parametrize(
    ("own", "said"),
    [
        ("Breaks", "the wheel came off"),
        ("Learns", "learns when it is asked: predict changed bias"),
        ("Counts", "learns when it is asked: predict changed its answer to the same question"),
    ],
)
def test_one_that_fails_leaves_the_others_their_table(capsys, own, said):
    out, message = adapt(capsys, f"linear --adapter broken_adapters:{own} --adapter kalman {SHORT}")
    assert "  kalman " in out and "broken_adapters" not in out
    assert message.startswith(f"error: Not shown: broken_adapters:{own}: ") and said in message


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"linear {SHORT}", "--adapter"),
        ("linear --adapter kalman", "--stream"),
        (f"linear --adapter kalmann {SHORT}", "kalman"),
        (f"linear --adapter style {SHORT}", "reads no style"),
        (f"constant_velocity --adapter kalman {SHORT}", "no linear last layer"),
        (f"linear --adapter kalman {SHORT} --kind suden", "sudden"),
        (f"linear --adapter kalman {SHORT} --cost 0.1", "realtime"),
        ("linear --adapter kalman --stream orca --stream nowhere", "nowhere"),
    ],
)
def test_what_cannot_be_is_said(capsys, line, said):
    out, message = adapt(capsys, line)
    assert said in message and "Traceback" not in message
    assert not out
