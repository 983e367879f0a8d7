"""Constant acceleration, constant turn rate, and the oracle of the traffic domain."""

import numpy as np
import pytest

import motion_gym
from motion_gym.contract import Observation, PredictorError, SpecError
from tests.traffic import SMALL, needs_highway_env

STEP = np.arange(20)


def seen(path):
    """An observation of the first 8 steps of one agent's path [20, 2]."""
    return Observation(path[None, :8].astype(np.float32), np.array([0, 1]), np.array([0]), 0.4)


def error(spec, path):
    """Largest error of the forecast of a path, metres."""
    forecast = motion_gym.predictor(spec).predict(seen(path)).positions[0, 0]
    return float(np.abs(forecast - path[8:]).max())


def along(x):
    """A path along the direction (0.6, 0.8)."""
    return np.outer(x, (0.6, 0.8)) + np.array([5, -3])


@pytest.mark.parametrize("steps", [2, 3, 4, 7])
def test_constant_acceleration_continues_a_change_of_speed(steps):
    path = along(10 * STEP + 0.5 * 0.3 * STEP**2)
    assert error(f"constant_acceleration:steps={steps}", path) < 1e-3
    assert error("constant_velocity", path) > 10


def test_an_agent_that_slows_down_stops_and_does_not_turn_back():
    speed = np.maximum(2.0 - 0.2 * STEP, 0.0)
    path = along(np.cumsum(speed))
    assert error("constant_acceleration", path) < 1e-4
    standing = along(np.zeros(20))
    assert error("constant_acceleration", standing) < 1e-6 and error("constant_turn", standing) < 1e-6


@pytest.mark.parametrize("steps", [2, 3, 4, 7])
@pytest.mark.parametrize("angle", [0.1, -0.2, 0.0])
def test_constant_turn_continues_on_the_circle(steps, angle):
    heading = 1.0 + angle * STEP
    path = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=-1) * 4, axis=0)
    assert error(f"constant_turn:steps={steps}", path) < 1e-3


def test_an_agent_that_hardly_moves_does_not_turn():
    heading = 0.5 * STEP
    path = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=-1) * 0.1, axis=0)
    slow = motion_gym.predictor("constant_turn").predict(seen(path)).positions[0, 0]
    assert np.abs(slow - (path[7] + np.outer(np.arange(1, 13), path[7] - path[6]))).max() < 1e-5
    assert error("constant_turn:slowest=0.2", path) < 1e-3


@pytest.mark.parametrize(
    "spec",
    [
        "constant_acceleration:steps=1",
        "constant_acceleration:steps=8",
        "constant_turn:steps=0",
        "constant_turn:slowest=-1",
    ],
)
def test_arguments_out_of_range(spec):
    with pytest.raises(SpecError, match=r"`(steps|slowest)=-?\d` (of constant_turn )?must be"):
        motion_gym.predictor(spec)


def ades(predictors, **domain):
    needs_highway_env()
    small = {**SMALL, "stride": 10, **domain}
    return [motion_gym.evaluate(name, "highway", **small).metrics["ADE"].mean for name in predictors]


@pytest.mark.parametrize("scenario", ["merge", "roundabout"])
def test_the_oracle_is_better_than_constant_velocity(scenario):
    oracle, baseline = ades(("idm_oracle", "constant_velocity"), scenario=scenario)
    assert oracle < 0.8 * baseline


def test_mirrored_traffic_is_continued_as_mirrored():
    needs_highway_env()
    right, left = (motion_gym.domain("highway", **SMALL, side=side) for side in ("right", "left"))
    scene = right.windows("test").observation
    history = scene.xy[: scene.scene[1]].astype(float)
    future = right.continued(history)
    assert future.shape == (len(history), 12, 2) and np.abs(future[:, 0] - history[:, -1]).max() < 8
    np.testing.assert_allclose(left.continued(history * (1, -1)), future * (1, -1), atol=1e-9)


def test_the_oracle_refuses_other_domains():
    oracle = motion_gym.predictor("idm_oracle")
    with pytest.raises(PredictorError, match="does not know the domain"):
        oracle.predict(seen(along(STEP)))
    with pytest.raises(PredictorError, match="knows traffic only, not `orca`"):
        oracle.know(motion_gym.domain("orca"))
