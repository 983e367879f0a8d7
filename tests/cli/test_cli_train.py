"""The commands that make weights."""

import json
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

from motion_gym.training import plans as training_plans
from tests.cli.command_line import call, fail


@pytest.fixture
def small_training(monkeypatch):
    """A benchmark that is trained for in seconds, on simulated crowds."""
    small = training_plans.Training("orca:scenes=70", options={"epochs": (1, 1, 2)})
    monkeypatch.setattr(training_plans, "trainings", lambda: {"small": small})


def test_train_then_score(small_training, capsys):
    again = "train erm_no_sigma --benchmark small --seeds 0,2 --every 1 --out own"
    said = call(capsys, again)
    path = Path("own/small/erm_no_sigma.safetensors")
    assert f"Written: {path}\n2 seeds in" in said and "validation ADE" in said
    card = json.loads(path.with_suffix(".json").read_text())
    assert card["seeds"] == [0, 2] and len(card["validation_ade"]) == 2 and card["training"]["epochs"] == [1, 1, 2]
    assert all(len(part["sha256"]) == 64 for part in card["training"]["train"])
    assert "erm_no_sigma" in call(capsys, f"score erm_no_sigma --weights {path} --domain orca:scenes=40")
    # Weights are not replaced, even where their checkpoint is gone.
    path.with_suffix(".checkpoint").rename("kept")
    assert f"{path} is there already" in fail(capsys, again).err
    Path("kept").rename(path.with_suffix(".checkpoint"))
    # A finished training goes on where it ended.
    assert "is there already: add --resume to go on" in fail(capsys, again).err
    call(capsys, f"{again} --resume --epochs 1 1 3")
    assert json.loads(path.with_suffix(".json").read_text())["curve"][-1]["epoch"] == 5
    other = fail(capsys, f"{again} --resume --epochs 2 1 3").err
    assert "another configuration (epochs_before: [1, 1], now [2, 1])" in other


def test_a_second_training_of_the_same_weights_is_refused_until_the_first_ends(small_training, capsys):
    code = """
import sys
from motion_gym.training import plans
plans.trainings = lambda: {"small": plans.Training("orca:scenes=70")}
from motion_gym.cli.main import main
main(sys.argv[1:])
"""
    line = "train erm_no_sigma --benchmark small --out own"
    lock = Path("own/small/erm_no_sigma.lock")
    long = f"{line} --seeds 0 --epochs 9999 1 1 --every 99999"
    with subprocess.Popen([sys.executable, "-c", code, *shlex.split(long)], stderr=subprocess.PIPE) as first:
        try:
            while not (lock.exists() and lock.read_text()):
                assert first.poll() is None, first.stderr.read()
                time.sleep(0.05)
            message = fail(capsys, f"{line} --seeds 1").err
            assert f"own/small/erm_no_sigma is being trained by process {first.pid} on" in message
        finally:
            first.kill()
    assert lock.exists()  # a killed process leaves the file, and locks nothing
    call(capsys, f"{line} --seeds 1")
    assert json.loads(lock.with_suffix(".json").read_text())["seeds"] == [1]
    assert not lock.exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("train linear --benchmark small", "is not trained in epochs"),
        ("train constant_velocity --benchmark small", "is not trained in epochs"),
        ("score vrexx --weights spurious --domain eth", "There is no predictor `vrexx`"),
        ("train erm --benchmark small", "erm is given sigma, and this domain has x and y alone"),
        ("train erms --benchmark small", "Did you mean `erm`"),
        ("train erm --benchmark smal", "Did you mean `small`"),
        ("train erm_no_sigma --benchmark small --seeds 0-x", "cannot be read: write 0-4"),
        ("train erm_no_sigma --benchmark small --seeds 1,1", "each once"),
        ("train erm_no_sigma --benchmark small --seeds 4-1", "at least one seed"),
        (
            "train motion_gym.predictors.stgat:Invariant:penalty=-1 --benchmark small",
            "`penalty=-1` must be a number, 0 or more",
        ),
        ("train erm:sigma=maybe --benchmark small", "must be true, false or relative"),
        ("train erm_no_sigma --benchmark small --epochs 1 1 0", "at least one epoch"),
        ("train erm_no_sigma --benchmark small --seeds 0-99999999999", "names more than 1000 seeds"),
        ("train erm_no_sigma --benchmark small --epochs 3", "must be a list of 3 for erm_no_sigma"),
        ("train ego_erm --benchmark small --epochs 1 1", "must be a list of 1 for ego_erm"),
        ("train style_erm --benchmark small", "must be a list of 1 for style_erm"),
        ("import-weights none.pth.tar --predictor vrex", "has no weights of the released program"),
        ("train erm_no_sigma --benchmark small --every 0", "`every=0` must be a whole number"),
        ("run spurios", "Did you mean `spurious`"),
        ("score linear --weights spurious --domain eth", "none of linear has weights"),
        ("score erm --weights spurios --domain eth:alpha=8", "Did you mean `spurious`"),
        ("score erm --weights a.safetensors --domain eth:alpha=8", "There is no file a.safetensors"),
        ("import-weights none.pth.tar --predictor linear", "has no weights of the released program"),
        ("import-weights none.pth.tar --predictor erm", "There is no file none.pth.tar"),
        ("import-weights a.pth.tar --predictor erm --out a.pt", "must end in .safetensors"),
    ],
)
def test_what_cannot_be_trained_scored_or_imported_is_said(small_training, line, message, capsys, tmp_path):
    folder = tmp_path / "out"
    out = f" --out {folder}" if line.startswith(("train", "run")) else ""
    assert message in fail(capsys, line + out).err
    assert not folder.exists()
