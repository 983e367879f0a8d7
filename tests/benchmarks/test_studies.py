"""Studies: what they compute, and that tables and figures show what is stored."""

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import motion_gym
from motion_gym import catalog
from motion_gym.benchmarks.identity import facts_of
from motion_gym.benchmarks.objects import Part
from motion_gym.benchmarks.reports import curves, figures, seed_tables, study_tables
from motion_gym.benchmarks.studies import network_studies
from motion_gym.contract import SpecError
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.training import pretraining
from motion_gym.predictors.training.heatmap_training import HeatmapTransfer
from motion_gym.predictors.training.transfer_training import TransferProgram
from motion_gym.stepping.harness import ask
from motion_gym.training import plans as training_plans
from motion_gym.training.plans import Training

RIGHT, WRONG = "orca:d=0.6,scenes=200", "orca:d=0.1,scenes=200"


def stored(study):
    """The study as it comes back from the store."""
    return json.loads(json.dumps(study, allow_nan=False))


def drawn(curves_of):
    return lambda study, path: figures.draw(curves_of(study), path)


def drawn_twice(draw, study, folder):
    """Bytes of a figure, drawn twice."""
    for name in ("a.svg", "b.svg"):
        draw(study, folder / name)
        ElementTree.parse(folder / name)
    return (folder / "a.svg").read_bytes(), (folder / "b.svg").read_bytes()


def test_errors_fall_with_reference_scenes(tmp_path, monkeypatch):
    monkeypatch.setattr(network_studies, "COUNTS", (0, 4, 64))
    study = stored(network_studies.by_references(["modular_invariant"], "style", {"0.6": RIGHT}))
    assert (study["counts"], study["seeds"], study["unit"]) == ([0, 4, 64], [0, 1, 2, 3, 4], "m")
    errors = np.array(study["ade"]["0.6"]["modular_invariant"])
    assert errors.shape == (3, 5) and (errors[2] < 0.8 * errors[0]).all()
    table = study_tables.by_references(study)
    mean = f"{errors[0].mean():.3f}".removeprefix("0")
    assert table.rows[0][:2] == ["modular_invariant", "0.6"] and table.rows[0][2].startswith(f"{mean} ± ")
    first, second = drawn_twice(drawn(curves.by_references), study, tmp_path)
    assert first == second


def test_no_reference_scene_is_the_mean_style_of_training(monkeypatch):
    monkeypatch.setattr(network_studies, "COUNTS", (0,))
    study = network_studies.by_references(["modular_invariant"], "style", {"0.6": RIGHT})
    card = motion_gym.evaluate("modular_invariant:weights=style,seed=2", RIGHT, references=0)
    assert study["ade"]["0.6"]["modular_invariant"][0][2] == pytest.approx(card.metrics["ADE"].mean, abs=1e-4)


def test_two_agents_are_drawn_as_they_are_refined(tmp_path):
    study = stored(network_studies.two_agents("modular_invariant", "style", RIGHT, WRONG))
    assert np.shape(study["history"]) == (2, 8, 2) and np.shape(study["future"]) == (2, 12, 2)
    towards_right, towards_wrong = study["panels"].values()
    assert list(towards_right) == [f"{n} steps" for n in network_studies.STEPS]
    assert towards_right["0 steps"] == towards_wrong["0 steps"]
    future = np.array(study["future"])
    off = [np.abs(np.array(panel["30 steps"]) - future).mean() for panel in (towards_right, towards_wrong)]
    assert off[0] < off[1]
    first, second = drawn_twice(figures.two_agents, study, tmp_path)
    assert first == second


def test_one_scene_shows_the_forecasts_of_each_row(eth_ucy, tmp_path):
    rows = ["constant_velocity", "erm", "erm:sigma=relative"]
    study = stored(network_studies.one_scene("eth", (1, 64), rows, "spurious"))
    assert list(study["panels"]) == ["alpha = 1", "alpha = 64"]
    near, far = study["panels"].values()
    assert list(near) == rows and near["constant_velocity"] == far["constant_velocity"] and near["erm"] != far["erm"]
    agents = len(study["history"])
    assert 3 <= agents <= 6 and np.shape(near["erm"]) == (agents, 12, 2)
    windows = catalog.domain("eth", alpha=1).windows("test")
    scene = next(
        n for n in range(windows.observation.scenes)
        if np.allclose(np.shape(pick_scenes(windows, [n]).future), (agents, 12, 2))
        and np.allclose(pick_scenes(windows, [n]).future, study["future"], atol=1e-3)
    )  # fmt: skip
    predictor = catalog.predictor("erm:weights=spurious")
    forecast = ask(predictor, pick_scenes(windows, [scene]).observation).most_likely()
    np.testing.assert_allclose(near["erm"], forecast, atol=1e-3)
    first, second = drawn_twice(figures.one_scene, study, tmp_path)
    assert first == second


def test_relative_sigma_is_chosen_on_the_sources_alone(eth_ucy):
    place = catalog.domain("eth:alpha=1")
    place.windows = None  # the domain itself must not be looked at
    study = stored(network_studies.left_out(("linear:sigma=true", "linear:sigma=relative"), place))
    assert study["ade"]["linear:sigma=relative"]["mean"] == pytest.approx(0.435, abs=0.002)
    assert study["ade"]["linear:sigma=true"]["mean"] == pytest.approx(0.512, abs=0.002)
    assert study["chosen"] == "linear:sigma=relative"
    first, second = study_tables.left_out(study).rows
    assert len(first) == 1 + 5 + 1 and first[-1] == "" and second[-1] == "chosen" and second[5] == ".435"


def test_a_domain_without_a_scene_to_draw_is_refused():
    with pytest.raises(SpecError, match="No scene of 3 to 6 agents to draw"):
        network_studies._scene_with_turns(catalog.domain(RIGHT).windows("test"))


def test_a_schedule_table_marks_the_best_of_each_row():
    part = Part("Held out", {"1": RIGHT, "2": RIGHT}, (), (), "style", shots={"1": 64, "2": 128})
    tried = {"all": {(10, 1e-4): 0.2, (30, 1e-3): 0.11}, "style": {(10, 1e-4): 0.12, (30, 1e-3): 0.3}}
    rows = {f"transfer:parts={p},epochs={e},rate={r:g}": ade for p, by in tried.items() for (e, r), ade in by.items()}
    rows["modular_invariant"] = 0.3
    identity = {"domain": facts_of(catalog.domain(RIGHT)).spec, "scoring_version": 2}
    results = [
        {
            "predictor": f"{row}:seed={seed}" if ":" not in row else f"{row},seed={seed}",
            "identity": {**identity, "shots": shots},
            "domain": {"unit": "m", "dt": 0.4},
            "oracle": False,
            "selection": "the last epoch",
            "metrics": {"ADE": {"mean": ade + seed / 100}},
        }
        for row, ade in rows.items()
        for shots in (64, 128)
        for seed in (-1, 1)
    ]
    table = seed_tables.schedules([(part, results)])
    assert list(table.columns) == ["tuned", "10 epochs, 0.0001", "30 epochs, 0.001"]
    assert [list(map(str, row)) for row in table.rows] == [["all", ".200", ".110"], ["style", ".120", ".300"]]
    assert [[type(cell).__name__ for cell in row[1:]] for row in table.rows] == [["str", "Strong"], ["Strong", "str"]]
    assert "Without tuning it is .300" in table.caption


def test_pretraining_is_watched(tmp_path, monkeypatch):
    small = Training("orca:d=0.4,scenes=200")
    monkeypatch.setattr(training_plans, "training", lambda name: small)
    monkeypatch.setattr(pretraining, "WATCHED", ("orca:d=0.1,scenes=200", "orca:d=0.7,scenes=200"))
    monkeypatch.setattr(pretraining, "VARIANTS", {"pre-trained": (1, 1, 1, 3), "not pre-trained": (1, 0, 1, 3)})
    seen = []
    study = stored(pretraining.curves(lambda *where: seen.append(where)))
    assert seen[-1] == (11, 11, "not pre-trained: forecast in style")
    shapes = {domain: {name: np.shape(v) for name, v in by.items()} for domain, by in study["ade"].items()}
    assert shapes == dict.fromkeys(pretraining.WATCHED, dict.fromkeys(pretraining.VARIANTS, (3, 5)))
    table = study_tables.pretraining(study)
    assert list(table.columns) == ["domain", "variant", "1", "3"]
    assert [row[1] for row in table.rows] == ["pre-trained", "not pre-trained", "p"] * 2
    first, second = drawn_twice(drawn(curves.pretraining), study, tmp_path)
    assert first == second


@pytest.mark.parametrize("program", [TransferProgram, HeatmapTransfer])
def test_everything_that_can_be_tuned_has_a_schedule(program):
    assert set(program.schedules) == set(program.tunable)
