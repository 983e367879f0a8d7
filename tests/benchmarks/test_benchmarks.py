"""Benchmarks: their trainings, runs, tables and figures."""

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from motion_gym import catalog
from motion_gym.benchmarks import benchmark_report
from motion_gym.benchmarks import shipped as benchmarks
from motion_gym.benchmarks.shipped import BENCHMARKS, Part
from motion_gym.contract import DataError, PredictorError, SpecError
from motion_gym.data.windows import digest, pick_scenes
from motion_gym.metrics.errors import score
from motion_gym.predictors.adapters.transfer import Transfer
from motion_gym.predictors.stand_still import StandStill
from motion_gym.training import plans as training_plans
from motion_gym.training import weight_files

PART = Part(
    "A small part",
    {"1": "eth:alpha=1", "8": "eth:alpha=8", "64": "eth:alpha=64"},
    ("constant_velocity",),
    ("erm",),
    "spurious",
)


@pytest.fixture(scope="module")
def small(eth_ucy, tmp_path_factory):
    """A part of two rows and three domains, and its results."""
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(BENCHMARKS, "small", (PART,))
        (found,) = benchmarks.run("small", folder)
    return folder, found


SHIPPED = {path.parent.relative_to(weight_files.SHIPPED).as_posix() for path in weight_files.SHIPPED.rglob("*.json")}


@pytest.mark.parametrize("name", sorted(training_plans.trainings().keys() - SHIPPED))
def test_every_training_without_weights_has_data(eth_ucy, name):
    train, validation = training_plans.training(name).data()
    assert len(train) == len(validation) >= 2
    assert all(len(truth.future) for truth in train)


def test_crossed_trainings_have_every_alpha_at_every_place():
    assert len(set(training_plans.training("spurious/crossed").names())) == 16


def test_every_row_is_a_predictor_and_every_column_a_domain():
    for parts in BENCHMARKS.values():
        for part in parts:
            for row in (*part.plain, *part.trained):
                made = catalog.predictor(row)
                # A table says what is tuned, be it the default or not.
                assert getattr(made, "name", row) == row or isinstance(made, Transfer)
            for spec in part.domains.values():
                catalog.domain(spec)
            assert not part.trained or part.weights in training_plans.trainings()


def test_unknown_names_are_refused(tmp_path):
    with pytest.raises(SpecError, match="Did you mean `spurious`"):
        training_plans.training("spurios")
    with pytest.raises(SpecError, match="no benchmark `spurios`"):
        benchmarks.run("spurios", tmp_path)


def test_rows_without_weights_are_named(tmp_path, monkeypatch):
    monkeypatch.setitem(
        BENCHMARKS, "small", (Part("x", {"1": "eth:alpha=1"}, (), ("counterfactual:sigma=relative",), "spurious"),)
    )
    with pytest.raises(
        PredictorError, match=r"have no `counterfactual:sigma=relative`.*motion-gym train counterfactual:s"
    ):
        benchmarks.run("small", tmp_path)
    assert not list(tmp_path.iterdir())


def test_every_seed_is_scored_once_and_found_again(small):
    folder, (part, results) = small
    assert len(list(folder.glob("*.json"))) == len(results) == 3 * (1 + 5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(BENCHMARKS, "small", (part,))
        patch.setattr("motion_gym.benchmarks.results.evaluate", None)  # nothing is run again
        ((_, again),) = benchmarks.run("small", folder)
        ((_, read),) = benchmarks.read("small", folder)
        assert again == read == json.loads(json.dumps(results))
        next(folder.glob("erm*.json")).unlink()
        with pytest.raises(
            DataError, match=r"has no result of erm:weights=spurious,seed=\d on eth:alpha=.*motion-gym run small"
        ):
            benchmarks.read("small", folder)


def test_a_part_may_have_a_k_of_its_own(tmp_path, monkeypatch):
    part = Part("x", {"0.3": "orca:d=0.3,scenes=40"}, ("constant_velocity",), samples=1)
    monkeypatch.setitem(BENCHMARKS, "small", (part,))
    ((_, results),) = benchmarks.run("small", tmp_path)
    assert [result["k"] for result in results] == [1]
    assert benchmarks.read("small", tmp_path) == [(part, results)]


def test_files_of_a_benchmark_are_written_and_are_the_same_again(small, tmp_path):
    _, found = small
    written = benchmark_report.write("spurious", [found], tmp_path)
    assert {path.name for path in written} == {"tables.md", "ade.svg", "jade_20.svg", "scene.svg"}
    first = {path.name: path.read_bytes() for path in written}
    for path in written:
        if path.suffix == ".svg":
            ElementTree.parse(path)
    assert {path.name: path.read_bytes() for path in benchmark_report.write("spurious", [found], tmp_path)} == first


@pytest.mark.parametrize("path", sorted(weight_files.SHIPPED.rglob("*.safetensors")), ids=lambda path: path.stem)
def test_shipped_weights_forecast_better_than_standing_still(path, eth_ucy):
    _, card = weight_files.read(path)
    assert card["seeds"] == [0, 1, 2, 3, 4] and "validation windows of the sources" in card["selection"]
    plan = training_plans.training(path.parent.relative_to(weight_files.SHIPPED).as_posix())
    train, validation = plan.data()
    # What they were trained and selected on is the data that is here.
    for name, truths in (("train", train), ("validation", validation)):
        used = card["training"][name]
        first = [pick_scenes(truth, slice(0, part["scenes"])) for truth, part in zip(truths, used, strict=True)]
        assert used == [digest(truth) for truth in first]
        assert all(len(part.future) in (len(truth.future), 18_000) for part, truth in zip(first, truths, strict=True))
    assert card["trained_on"] == plan.names()
    for name, value in plan.options_of(card["predictor"]).items():
        assert card["training"][name] == (list(value) if name == "epochs" else value)
    still = [score(StandStill().predict(truth.observation), truth)["ADE"] for truth in validation]
    assert max(card["validation_ade"]) < 0.6 * np.concatenate(still).mean()
