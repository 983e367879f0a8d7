"""The benchmarks that ship: their rows, their stored runs, and the weights that they use."""

import dataclasses
import functools
import random
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import motion_gym
from motion_gym import catalog
from motion_gym.benchmarks import running
from motion_gym.benchmarks.identity import canonical, question
from motion_gym.benchmarks.jobs import Runner
from motion_gym.benchmarks.reports import pages
from motion_gym.benchmarks.store import SHIPPED, Store
from motion_gym.contract import SpecError
from motion_gym.data.windows import digest, pick_scenes
from motion_gym.metrics.errors import score
from motion_gym.predictors.adapters.transfer import Transfer
from motion_gym.predictors.stand_still import StandStill
from motion_gym.training import plans as training_plans
from motion_gym.training import weight_files
from tests import traffic
from tests.added_weights import lacks_weights

WITH_WEIGHTS = {p.parent.relative_to(weight_files.SHIPPED).as_posix() for p in weight_files.SHIPPED.rglob("*.json")}
WEIGHTS = "*.safetensors"
PARTS = [part for name in running.BENCHMARKS for part in running.benchmark(name).parts]
TOLERANCE = 1e-4
"""Metres between a stored score and one of another processor: float32 forecasts add up in another order."""


def small(plan):
    """A plan with less traffic, since the full splits take minutes to simulate; other plans as they are."""
    if not plan.domain.startswith("highway"):
        return plan
    traffic.needs_highway_env()
    return dataclasses.replace(plan, domain=f"{plan.domain},runs=1,seconds=20")


def test_every_training_has_shipped_weights():
    assert training_plans.trainings().keys() == WITH_WEIGHTS


def test_crossed_trainings_have_every_alpha_at_every_place():
    assert len(set(training_plans.training("spurious/crossed").names())) == 16


def test_every_row_is_a_predictor_and_every_column_a_domain():
    for part in PARTS:
        for row in (*part.plain, *part.trained):
            if lacks_weights(row):
                continue
            predictor = catalog.predictor(row)
            # A table says what is tuned, be it the default or not.
            assert getattr(predictor, "name", row) == row or isinstance(predictor, Transfer)
        for spec in part.domains.values():
            catalog.domain(spec)
        assert not part.trained or part.weights in training_plans.trainings()


def test_unknown_names_are_refused():
    with pytest.raises(SpecError, match="Did you mean `spurious`"):
        training_plans.training("spurios")
    with pytest.raises(SpecError, match="no benchmark `spurios`"):
        motion_gym.benchmark("spurios")


@pytest.mark.parametrize("name", running.BENCHMARKS)
def test_every_run_is_stored_and_is_of_the_present_weights_data_and_versions(name):
    def nothing(done, total, label):
        raise AssertionError(f"{label} is missing in the packed runs")

    results = running.run(name, report=nothing)
    assert not results.runner.missing
    chosen = running.benchmark(name)
    assert len(results.parts) == len(chosen.parts) and len(results.studies) == len(chosen.studies)
    assert all(run["provenance"]["commit"] for run in results.runner.store.runs.values())


def test_all_that_is_stored_is_small():
    files = [path for path in SHIPPED.rglob("*") if path.is_file()]
    assert len(files) < 62 and sum(path.stat().st_size for path in files) < 9e6


@pytest.mark.parametrize("name", ["baselines", "original", "published", "spurious", "style"])
def test_a_random_sample_of_stored_runs_is_computed_again(eth_ucy, name):
    rng = random.Random()
    jobs = [(part, *run) for part in running.benchmark(name).parts for run in part.runs() if "univ" not in part.title]
    part, predictor, column = rng.choice([job for job in jobs if job[1] not in job[0].fingerprints])
    stored = Store(name).find(part.identity(predictor, column))
    card = motion_gym.evaluate(predictor, part.domain(column), **part.options(column))
    for metric in ("ADE", "FDE"):
        assert card.metrics[metric].mean == pytest.approx(stored["metrics"][metric]["mean"], abs=TOLERANCE), predictor


def test_files_of_a_benchmark_are_written_and_are_the_same_again(tmp_path):
    results = running.run("style")
    written = pages.write(results, tmp_path)
    assert {path.name for path in written} == {"tables.md", "ade.svg", "references.svg"}
    for path in written:
        if path.suffix == ".svg":
            ElementTree.parse(path)
    first = {path.name: path.read_bytes() for path in written}
    assert first["tables.md"] == (SHIPPED / "style" / "tables.md").read_bytes()
    assert {path.name: path.read_bytes() for path in pages.write(results, tmp_path)} == first


def test_a_row_is_left_out_and_named_where_a_run_is_missing(tmp_path, monkeypatch):
    part = running.benchmark("baselines").parts[0]
    full = Store("baselines")
    key = question(canonical(part.identity("linear", "d = 0.6")))
    monkeypatch.delitem(full.runs, key)
    full.pack(tmp_path)
    monkeypatch.setattr(running, "Store", lambda name, folder: Store(name, folder, shipped=tmp_path))
    results = running.run("baselines", only=["stand_still"])
    assert list(results.runner.missing) == [("Simulated crowds", "linear")]
    rows = [row[0] for row in pages.short(results)[0].rows]
    assert "linear" not in rows and "constant_velocity" in rows


@pytest.mark.parametrize("name", sorted(n for n in WITH_WEIGHTS if any((weight_files.SHIPPED / n).glob(WEIGHTS))))
def test_shipped_weights_forecast_better_than_standing_still(name, eth_ucy):
    plan = training_plans.training(name)
    sources = catalog.domain(small(plan).domain).sources(**plan.sources)
    splits = {"validation": [source.windows("val") for source in sources]}
    if not name.startswith("factors"):  # 70,000 starts, simulated by the same engine as those of validation
        splits["train"] = [source.windows("train") for source in sources]
    validation = splits["validation"]

    @functools.cache
    def first(kind, number, scenes):
        return digest(pick_scenes(splits[kind][number], slice(0, scenes)))

    still = np.concatenate([score(StandStill().predict(t.observation), t)["ADE"] for t in validation]).mean()
    for path in sorted((weight_files.SHIPPED / name).glob(WEIGHTS)):
        _, card = weight_files.read(path)
        assert card["seeds"] == [0, 1, 2, 3, 4] and "validation windows of the sources" in card["selection"], path
        options = plan.options_of(catalog.predictor(card["predictor"]))
        # What they were trained and selected on is the data that is here; of traffic only a part is simulated.
        for kind, truths in splits.items() if small(plan) is plan else ():
            used = card["training"][kind]
            assert used == [first(kind, number, part["scenes"]) for number, part in enumerate(used)], path
            most = 2 * options.get("most", 9000)
            assert all(p["agent_windows"] in (len(t.future), most) for p, t in zip(used, truths, strict=True)), path
        assert card["trained_on"] == plan.names(), path
        for option, value in options.items():
            if option == "most":
                continue  # the digests of the data show it
            # What is turned off may be left out.
            stated = card["training"].get(option) or None
            assert stated == ((list(value) if option == "epochs" else value) or None), (path, option)
        assert max(card["validation_ade"]) < 0.9 * still, path


def test_what_to_do_is_said_once():
    runner = Runner(Store("style"))
    runner.missing = {
        ("a",): "x.txt is missing. Run `fetch`, or name a folder.",
        ("b",): "y.txt is missing. Run `fetch`, or name a folder.",
        ("c",): "no weights",
    }
    assert runner.not_shown().splitlines() == [
        "Not shown: a: x.txt is missing. Run `fetch`, or name a folder.",
        "Not shown: b: y.txt is missing.",
        "Not shown: c: no weights",
    ]
