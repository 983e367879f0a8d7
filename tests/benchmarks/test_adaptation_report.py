"""Benchmarks of transfer, refinement and pre-training: what they run, and what they show."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from motion_gym.benchmarks import adaptation_report, benchmark_report, pretraining_report, seed_tables
from motion_gym.benchmarks import shipped as benchmarks
from motion_gym.benchmarks.shipped import BENCHMARKS, TRIED, TUNED, Part
from motion_gym.predictors.adapters import transfer
from motion_gym.predictors.training import pretraining
from motion_gym.predictors.training.transfer_training import PARTS
from motion_gym.training import plans as training_plans
from motion_gym.training.plans import Training

CROWD = "orca:d=0.6,scenes=200"
SHOTS = Part(
    "By shots",
    {"0": CROWD, "1": CROWD},
    ("constant_velocity",),
    ("modular_invariant", "transfer:parts=last_layer,epochs=1"),
    "style",
    references=0,
    shots={"1": 64},
)


def test_columns_of_one_domain_differ_in_shots(tmp_path, monkeypatch):
    monkeypatch.setitem(BENCHMARKS, "small", (SHOTS,))
    ((part, results),) = benchmarks.run("small", tmp_path)
    assert benchmarks.read("small", tmp_path) == [(part, results)]
    values = seed_tables.over_seeds(part, results, "ADE")
    assert set(values) == {(row, n) for row in (*part.plain, *part.trained) for n in ("0", "1")}
    assert values["constant_velocity", "0"] == values["constant_velocity", "1"]
    # The style is read from the scenes, and the tuned one begins where the untuned one does.
    untuned, tuned = part.trained
    assert (values[untuned, "1"] < 0.8 * values[untuned, "0"]).all()
    assert np.array_equal(values[untuned, "0"], values[tuned, "0"])
    assert not np.array_equal(values[untuned, "1"], values[tuned, "1"])
    assert "scenes of the domain's training split that rows learn from: 0, 64" in seed_tables.markdown(part, results)


def test_the_best_schedule_is_marked_and_another_default_is_named(monkeypatch):
    part = Part("Held out", {"1": CROWD}, (), (), "style")
    errors = {f"transfer:parts={p},epochs={e},rate={r:g}": 0.2 for p in TUNED for e, r in TRIED}
    errors["modular_invariant"] = 0.3
    monkeypatch.setitem(transfer.SCHEDULES, "all", TRIED[1])
    monkeypatch.setitem(transfer.SCHEDULES, "style", TRIED[2])
    best = (("all", 1, 0.11), ("style", 1, 0.12), ("modulator", 0, 0.1), ("last_layer", 3, 0.13))
    for parts, place, error in best:
        errors[f"transfer:parts={parts},epochs={TRIED[place][0]},rate={TRIED[place][1]:g}"] = error
    monkeypatch.setattr(
        adaptation_report,
        "over_seeds",
        lambda *_: {(row, "1"): np.array([error - 0.01, error + 0.01]) for row, error in errors.items()},
    )
    lines = adaptation_report.schedules(part, []).splitlines()
    assert "Without tuning it is .300" in lines[2]
    assert lines[6].startswith("| all | .200 | **.110** | .200")
    epochs, rate = TRIED[2]
    assert lines[7].startswith(f"| style (`transfer` takes {epochs} epochs, {rate:g}) | .200 | **.120** |")


def test_everything_that_can_be_tuned_is_in_the_tables():
    assert set(TUNED) == set(PARTS)


def test_two_agents_are_drawn_the_same_each_time(tmp_path):
    part = Part("x", {"0.6": CROWD, "0.1": "orca:d=0.1,scenes=200"}, (), ("refine",), "style")
    texts = []
    for name in ("a.svg", "b.svg"):
        adaptation_report.two_agents(part, tmp_path / name)
        ElementTree.parse(tmp_path / name)
        texts.append((tmp_path / name).read_bytes())
    assert texts[0] == texts[1]


def test_pretraining_is_watched_and_kept(tmp_path, monkeypatch):
    small = Training("orca:d=0.4,scenes=200")
    monkeypatch.setattr(training_plans, "training", lambda name: small)
    monkeypatch.setattr(pretraining, "WATCHED", ("orca:d=0.1,scenes=200", "orca:d=0.7,scenes=200"))
    monkeypatch.setattr(pretraining, "VARIANTS", {"pre-trained": (1, 1, 1, 3), "not pre-trained": (1, 0, 1, 3)})
    monkeypatch.setattr(pretraining_report, "EPOCHS", (1, 3))
    seen = []
    written = benchmark_report.write("pretraining", [], tmp_path, lambda *where: seen.append(where))
    assert {path.name for path in written} == {"tables.md", "orca_0.1.svg", "orca_0.7.svg"}
    assert seen[-1] == (11, 11, "not pre-trained: forecast in style")
    found = pretraining.curves(tmp_path, lambda *_: pytest.fail("trained again"))
    shapes = {domain: {name: values.shape for name, values in table.items()} for domain, table in found.items()}
    assert shapes == dict.fromkeys(pretraining.WATCHED, dict.fromkeys(pretraining.VARIANTS, (3, 5)))
    text = benchmark_report.short("pretraining", [], tmp_path)
    assert "| not pre-trained |" in text and "| p |" in text
