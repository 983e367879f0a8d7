"""Driven episodes of a benchmark: stored runs, tables, a user's own row, and rank correlations."""

from __future__ import annotations

import numpy as np
import pytest

from motion_gym.benchmarks import drives, own_rows, running
from motion_gym.benchmarks.claims import claims_page
from motion_gym.benchmarks.drives import Drives
from motion_gym.benchmarks.objects import Benchmark
from motion_gym.benchmarks.reports import drive_tables, pages
from motion_gym.contract import SpecError
from tests.traffic import needs_highway_env

COLUMNS = {"normal": "highway:scenario=roundabout,seconds=16"}
ROWS = ("stand_still", "constant_velocity", "oracle")
SMALL = Benchmark("small", "Small", drives=(Drives("Small", COLUMNS, ROWS, others="replay", episodes=2, runs=1),))


class LateSensor:
    """Fails in the first moment at which an episode can begin."""

    def predict(self, observation, samples=1, seed=0):
        if observation.agent[0] < 1000:
            raise RuntimeError("no sensor yet")
        return np.repeat(observation.xy[:, -1:], 12, axis=1)[:, None]


def test_driven_episodes_are_stored_and_shown_with_an_own_row(tmp_path, monkeypatch):
    needs_highway_env()
    for module in (drives, own_rows):
        monkeypatch.setattr(module, "SEEDS", (0, 1))
    results = running.run(SMALL, [LateSensor], tmp_path)
    assert not results.runner.missing
    assert len(list(tmp_path.glob("*.json"))) == 4 * 2
    scores, details, ranks = drive_tables.tables(*results.drives[0])
    assert [row[0] for row in scores.rows] == [
        "stand_still (no forecast)", "constant_velocity", "LateSensor", "oracle (knows the future)"
    ]  # fmt: skip
    assert any("LateSensor failed in" in note and "no sensor yet" in note for note in scores.notes)
    assert len(details.rows) == 4 and [row[0] for row in ranks.rows] == ["ADE", "FDE", "MR_2m"]
    (panel,) = claims_page.panels_of(results)
    assert panel.name == "replay" and panel.columns == ("all", "normal")
    means = [1 - run["metrics"]["score"]["mean"] for run in results.drives[0][1] if run["predictor"] == "oracle"]
    assert panel.errors["oracle", "normal"] == pytest.approx(means) == panel.errors["oracle", "all"]
    written = pages.write(results, tmp_path / "tables")
    assert {path.name for path in written} == {"tables.md", "score_by_error_1.svg"}

    def nothing(done, total, label):
        raise AssertionError(f"{label} is computed again")

    again = running.run(SMALL, folder=tmp_path, report=nothing)
    assert [len(runs) for _, runs in again.drives] == [3 * 2], "the own row is not reused"


def test_an_unknown_row_is_named():
    with pytest.raises(SpecError, match=r"small has no row `standstill`.*Did you mean `stand_still`"):
        running.run(SMALL, only=["standstill"])


def run(row, seed, errors, scores):
    return {
        "predictor": row,
        "seed": seed,
        "values": {"ADE": errors, "score": scores},
        "metrics": {"score": {"mean": float(np.mean(scores))}},
    }


def test_rank_correlations_follow_the_order_of_the_rows():
    rng, cells = np.random.default_rng(0), {}
    for number, row in enumerate("abcde"):
        noise = rng.normal(0, 0.01, (2, 2, 50))
        errors, scores = number + noise[0], 0.9 - 0.1 * number + noise[1]
        errors[0, 0] = np.nan  # nobody was there
        listed = [[None if np.isnan(value) else value for value in seed] for seed in errors]
        cells[row, "x"] = [run(row, seed, listed[seed], scores[seed].tolist()) for seed in (0, 1)]
    assert drive_tables.correlation(cells, list("abcde"), ("x",), "ADE") == pytest.approx((-1, -1, -1))
    same = {key: [run(key[0], r["seed"], r["values"]["ADE"], [0.5] * 50) for r in runs] for key, runs in cells.items()}
    assert drive_tables.correlation(same, list("abcde"), ("x",), "ADE") == (0, 0, 0)
