"""Scores do not depend on the coordinates of a place: positions are relative to a float64 origin."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import motion_gym
from motion_gym import catalog
from motion_gym.contract import Recording
from motion_gym.data.domains import RecordedDomain
from tests.added_weights import needs_weights

SHARED = Path(os.environ.get("MOTION_GYM_SHARED", Path(__file__).resolve().parents[3] / "shared"))
SHIFTS = (1e4, 4e5, 4e6, 1e7)
METRES = 1e-3
WEIGHTS = {
    **dict.fromkeys(("erm", "counterfactual"), "spurious"),
    **dict.fromkeys(("style_erm", "modular", "ego_erm", "ego_modular"), "style"),
    **dict.fromkeys(("erm_no_sigma", "modular_stgat"), "style/crowd"),
    "modular_factors": "factors",
}
SPECIAL = ("transfer", "refine", "orca_oracle", "idm_oracle")
"""Predictors that need scenes of another domain, an adapter, and oracles, which need scenes of one domain."""
SAME_NETWORK = ("invariant", "vrex", "group_dro", "style_invariant", "modular_invariant")
"""Predictors with other weights of a tested network."""
PREDICTORS = [name for name in catalog.PREDICTORS if name not in SPECIAL + SAME_NETWORK]


class Walkers(RecordedDomain):
    """Pairs of people who walk straight, or nearly, each at its own pace; to a millimetre, as in a file."""

    name = "walkers"

    def __init__(self, east: float = 0.0, north: float = 0.0, sigma: bool = False):
        self.east, self.north, self.sigma = east, north, sigma
        self.feature_names = ("sigma",) if sigma else ()

    def features(self, history):
        return np.linalg.norm(np.gradient(history, axis=1), axis=2, keepdims=True)

    def sources(self):
        return [self]

    def recordings(self, split):
        rng = np.random.default_rng(self.splits.index(split))
        steps, pairs = 26, 4
        rows = []
        for pair in range(pairs):
            for member in range(2):
                start, velocity, bend = rng.uniform(-5, 5, 2), rng.normal(0, 0.4, 2), rng.normal(0, 0.01, 2)
                time = np.arange(steps)[:, None]
                path = np.round(start + velocity * time + bend * time**2 / 2, 3) + np.array([self.east, self.north])
                rows += [(pair * 40 + t, 2 * pair + member, *xy) for t, xy in enumerate(path)]
        frame, agent, x, y = (np.array(column) for column in zip(*sorted(rows), strict=True))
        return [Recording(frame, agent, np.stack([x, y], axis=1), 0.4, "walkers")]


def scores(predictor: str, shift: float) -> dict[str, float]:
    folder = WEIGHTS.get(predictor)
    domain = Walkers(shift, -shift, sigma=folder == "spurious")
    card = motion_gym.evaluate(f"{predictor}:weights={folder}" if folder else predictor, domain, k=3, verify=False)
    return {name: summary.mean for name, summary in card.metrics.items()}


def online(predictor: str, shift: float, adapter: str | None = None) -> float:
    learner = predictor if adapter is None else motion_gym.adapter(adapter, predictor)
    return motion_gym.evaluate_online(learner, Walkers(shift, -shift)).ade.mean


@pytest.mark.parametrize("predictor", PREDICTORS)
def test_every_metric_is_the_same_anywhere_on_the_windows_clock(predictor):
    needs_weights(predictor)
    if predictor in WEIGHTS:
        pytest.importorskip("torch", reason="trained predictors need PyTorch")
    near = scores(predictor, 0.0)
    assert near["ADE"] > 0.01
    for shift in (4e6,) if predictor in WEIGHTS else SHIFTS:
        assert scores(predictor, shift) == pytest.approx(near, abs=METRES, nan_ok=True)


@pytest.mark.parametrize("predictor", [name for name in PREDICTORS if name not in WEIGHTS])
def test_errors_are_the_same_anywhere_on_the_stream_clock(predictor):
    needs_weights(predictor)
    near = online(predictor, 0.0)
    for shift in SHIFTS:
        assert online(predictor, shift) == pytest.approx(near, abs=METRES)


@pytest.mark.parametrize("adapter", [name for name in catalog.ADAPTERS if name not in ("style", "refine")])
def test_adapters_learn_the_same_anywhere(adapter):
    pytest.importorskip("torch", reason="adapters need PyTorch")
    near = online("style_erm:weights=style", 0.0, adapter)
    assert online("style_erm:weights=style", 4e6, adapter) == pytest.approx(near, abs=METRES)


@pytest.mark.parametrize("adapter", ["style", "refine"])
def test_adapters_that_read_a_style_read_the_same_anywhere(adapter):
    pytest.importorskip("torch", reason="adapters need PyTorch")
    near = online("modular:weights=style", 0.0, adapter)
    assert online("modular:weights=style", 4e6, adapter) == pytest.approx(near, abs=METRES)


def test_constant_velocity_on_utm_coordinates():
    path = SHARED / "cases" / "utm_s.txt"
    if not path.exists():
        pytest.skip(f"{path} is not here; set MOTION_GYM_SHARED")

    class File(RecordedDomain):
        name = "utm"

        def recordings(self, split):
            return [motion_gym.read_recording(path)] if split == "test" else []

    # The file rounds to a millimetre, and a walker turns nowhere.
    assert motion_gym.evaluate("constant_velocity", File()).metrics["ADE"].mean < METRES
    assert File().recordings("test")[0].origin.tolist() == [388_000, 3_949_000]


def test_what_an_environment_shows_is_relative_to_the_origin_of_the_recording():
    for clock in ("windows", "stream"):
        near, far = (motion_gym.parallel_env(Walkers(shift, -shift), clock=clock) for shift in (0.0, 1e7))
        one, other = near.reset()[0], far.reset()[0]
        assert list(one) == list(other)
        for agent in one:
            np.testing.assert_allclose(one[agent], other[agent], atol=1e-6)
    assert Walkers(1e7, -1e7).recordings("test")[0].origin.tolist() == [1e7, -1e7]
