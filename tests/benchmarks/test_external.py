"""Rows of external programs: known by the fingerprint of their weights, and computed only with a checkout."""

import sys

import pytest

from motion_gym.benchmarks import running
from motion_gym.benchmarks.identity import windows_identity
from motion_gym.benchmarks.objects import Benchmark, External, Part
from motion_gym.benchmarks.own_rows import best_row
from motion_gym.benchmarks.row_specs import domain
from motion_gym.benchmarks.store import Store
from motion_gym.contract import SpecError

WRAPPER = """
from pathlib import Path
import numpy as np
from motion_gym.contract import SpecError

class Outside:
    selection = "published"
    def __init__(self, repo, weights="one"):
        path = Path(repo) / f"{weights}.txt"
        if not path.is_file():
            raise SpecError(f"`repo={repo}` has no weights `{weights}`")
        self.fingerprint = path.read_text()
        self.gain = float(self.fingerprint)
    def predict(self, observation, samples=1, seed=0):
        step = self.gain * (observation.xy[:, -1:] - observation.xy[:, -2:-1])
        return (observation.xy[:, -1:] + np.arange(1, 13)[:, None] * step)[:, None].astype(np.float32)
"""
COLUMNS = {"first": "orca:d=0.3,scenes=10", "second": "orca:d=0.6,scenes=10"}


@pytest.fixture
def program(tmp_path, monkeypatch):
    """A checkout with two weights, beside the module of its wrapper."""
    (tmp_path / "outside_program.py").write_text(WRAPPER)
    (tmp_path / "checkout").mkdir()
    (tmp_path / "checkout" / "one.txt").write_text("0.5")
    (tmp_path / "checkout" / "two.txt").write_text("1")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    sys.modules.pop("outside_program", None)


def made():
    row = External(
        "Outside",
        "outside_program:Outside:repo=checkout",
        {"first": "one", "second": "two"},
        {"one": "0.5", "two": "1"},
    )
    return Benchmark("outside", "t", (Part("t", COLUMNS, ("constant_velocity",), samples=1, external=(row,)),))


def rows(results):
    part, runs = results.parts[0]
    return {(run["predictor"], part.column_of(run)): run["metrics"]["ADE"]["mean"] for run in runs}


def test_an_external_row_has_other_weights_in_each_column_and_is_shown_without_its_checkout(program):
    first = running.run(made(), folder=program / "out")
    assert not first.runner.missing and len(rows(first)) == 4
    one, two = (f"outside_program:Outside:repo=checkout,weights={name}" for name in ("one", "two"))
    # With a gain of 1 the wrapper is constant velocity.
    assert rows(first)[two, "second"] == pytest.approx(rows(first)["constant_velocity", "second"], abs=1e-5)
    assert rows(first)[one, "first"] > rows(first)["constant_velocity", "first"]
    (program / "outside_program.py").unlink()
    (program / "checkout" / "one.txt").unlink()
    sys.modules.pop("outside_program")

    def nothing(done, total, label):
        raise AssertionError(label)

    again = running.run(made(), folder=program / "out", report=nothing)
    assert rows(again) == rows(first)


def test_a_checkout_with_other_weights_is_refused_and_the_stored_row_stays(program):
    first = running.run(made(), folder=program / "out")
    (program / "checkout" / "one.txt").write_text("0.7")
    again = running.run(made(), folder=program / "out", fresh=True)
    (reason,) = again.runner.unwritten
    assert "have the fingerprint 0.7, and those of the stored row 0.5: check out the commit" in reason
    assert rows(again) == rows(first)
    (program / "out").rename(program / "elsewhere")
    missing = running.run(made(), folder=program / "out").runner.missing
    assert list(missing) == [("t", "outside_program:Outside:repo=checkout")]


def test_the_fingerprint_is_a_part_of_the_identity_and_the_session_is_not(program):
    part = made().parts[0]
    predictor = "outside_program:Outside:repo=checkout,weights=one"
    identity = part.identity(predictor, "first", "a session")
    assert identity["weights"] == {predictor: "0.5"} and identity["session"] is None
    store = Store("outside")
    store.take([{"identity": {**identity, "weights": {predictor: "0.7"}}}])
    assert store.find(identity) is None


def test_a_user_s_row_is_not_compared_with_an_external_one(program):
    part, runs = running.run(made(), folder=program / "out").parts[0]
    assert best_row(part, runs, "second") == "constant_velocity"


def test_a_parameter_weights_of_a_user_s_own_class_names_no_shipped_weights(program):
    """So that a wrapper may call its argument ``weights``, whatever its value is."""
    spec = "outside_program:Outside:repo=checkout,weights=two"
    identity = windows_identity(spec, domain(COLUMNS["first"]), session="s")
    assert identity["weights"] == {} and identity["session"] == "s"
    results = running.run(made(), [spec.replace("two", "one")], folder=program / "out")
    assert not results.runner.missing
    with pytest.raises(SpecError, match="have no `linear`"):
        windows_identity("linear:weights=two", domain(COLUMNS["first"]))
