"""The commands that make weights."""

import json
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

import motion_gym
from motion_gym.cli import output
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
        ("train erm --benchmark small", "erm needs sigma, but this domain gives only x and y"),
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


PLACE = '''
import numpy as np
import motion_gym


class Walk(motion_gym.RecordedDomain):
    """Walkers with a measurement noise of 0.05."""

    name = "walk"

    def __init__(self, trains=True, people=30, unit="m"):
        self.trains, self.people, self.unit = trains, people, unit

    def recordings(self, split):
        rng = np.random.default_rng(self.splits.index(split))
        time, agent = np.meshgrid(np.arange(24), np.arange(self.people), indexing="ij")
        path = rng.normal(0, 5, (self.people, 2)) + rng.normal(0, 0.4, (self.people, 2)) * time[..., None]
        path = path + rng.normal(0, 0.05, path.shape)
        return [motion_gym.Recording(time.ravel(), agent.ravel(), path.reshape(-1, 2), 0.4)]

    def sources(self):
        return [self] if self.trains else []
'''


def test_train_on_a_domain_of_ones_own(folder, capsys, monkeypatch):
    pytest.importorskip("torch")
    (folder / "places.py").write_text(PLACE)
    monkeypatch.delitem(sys.modules, "places", raising=False)
    line = "train erm_no_sigma --domain places:Walk --seeds 0 --epochs 1 1 2 --out own"
    path = Path("own/places_Walk/erm_no_sigma.safetensors")
    said = call(capsys, line)
    assert f"Written: {path}" in said.replace("\n", "")
    card = json.loads(path.with_suffix(".json").read_text())
    (source,) = card["sources"]
    assert (source["domain"], source["dt"], source["agent_windows"]) == ("walk", 0.4, 150)
    assert source["noise"] == pytest.approx(0.05, rel=0.1) and card["trained_on"] == ["walk"]
    assert card["training"]["joint"] is True and card["training"]["epochs"] == [1, 1, 2]
    call(capsys, f"{line.replace('1 1 2', '1 1 3')} --resume")
    assert len(json.loads(path.with_suffix(".json").read_text())["curve"]) == 5
    call(capsys, f"score erm_no_sigma --weights {path} --domain places:Walk --out runs", "warning: ")
    (run,) = (json.loads(run.read_text()) for run in Path("runs").glob("*erm_no_sigma*.json"))
    assert (
        f"weights {path}: trained on walk, with steps of 0.4 s and a measurement noise of up to 0.0" in run["selection"]
    )
    # Other predictors, and other parameters of the domain in another folder.
    call(capsys, "train ego_erm --domain places:Walk:people=20 --seeds 0 --epochs 1 --out own")
    assert Path("own/places_Walk_people=20/ego_erm.safetensors").exists()


def test_training_without_a_terminal_prints_its_epochs(folder, capsys, monkeypatch):
    pytest.importorskip("torch")
    (folder / "places.py").write_text(PLACE)
    monkeypatch.delitem(sys.modules, "places", raising=False)
    monkeypatch.setattr(output, "SECONDS_BETWEEN_LINES", 0.0)
    call(capsys, "train ego_erm --domain places:Walk --seeds 0 --epochs 2 --out own", "1 of 2 done: forecast: loss ")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("train erm_no_sigma", "either --benchmark style, or --domain my_module:MyDomain"),
        ("train erm_no_sigma --benchmark style --domain orca", "either --benchmark style, or --domain"),
        ("train erm_no_sigma --domain places:Walk:trains=false", "names no domains to train on: define `sources()`"),
        ("train vrex:sigma=false --domain places:Walk", "compares environments, but the training set has one"),
        ("train linear --domain places:Walk", "is not trained in epochs"),
        ("train erm_no_sigma --domain places:Wlk", "Did you mean `Walk`"),
        ("train style_erm --domain places:Walk --epochs 1", "has 5 scenes, and a step takes 64"),
    ],
)
def test_what_cannot_be_trained_is_said(folder, capsys, monkeypatch, line, message):
    pytest.importorskip("torch")
    (folder / "places.py").write_text(PLACE)
    monkeypatch.delitem(sys.modules, "places", raising=False)
    assert message in fail(capsys, f"{line} --out own").err


def test_scores_on_own_data_name_shipped_weights(folder, monkeypatch):
    pytest.importorskip("torch")
    (folder / "places.py").write_text(PLACE)
    monkeypatch.delitem(sys.modules, "places", raising=False)
    monkeypatch.syspath_prepend(str(folder))
    own = motion_gym.evaluate("erm_no_sigma:weights=online/places", "places:Walk").selection
    assert (
        "weights online/places: trained on " in own
        and "with steps of 0.4 s and a measurement noise of up to 0.0" in own
    )
    assert "trained on" not in motion_gym.evaluate("erm_no_sigma:weights=online/places", "orca:scenes=20").selection
    assert "weights" not in motion_gym.evaluate("constant_velocity", "places:Walk").selection.replace("no weights", "")
