"""The Kalman filter of a last layer against its closed form, and the extended one where that is exact."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.checks.predictor_trials import partly_known, synthetic
from motion_gym.contract import FUTURE
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.adapters.ekf import STEPS
from motion_gym.stepping.snapshot import changed, snapshot
from tests.taped import fitted_linear

PAIR, STGAT = "modular_invariant", "erm_no_sigma:weights=original/zara2"
SOURCES = ["linear", PAIR, STGAT]


def scenes(number, seed=3, size=2):
    """Scenes of people that walk anyhow, one by one."""
    whole = synthetic([*[size] * number, 1], 2, seed)
    return [pick_scenes(whole, [scene]) for scene in range(number)]


def adapter(name, of, **parameters):
    return mg.adapter(name, fitted_linear() if of == "linear" else of, memory=0, **parameters)


def ridge_solution(adapted, revealed, ridge, forgetting):
    """Weights that minimise the sum that the class says, by least squares."""
    layers = [adapted.inner.last_layer(truth.observation) for truth in revealed]
    rows = [layer.known_rows(truth.known) for layer, truth in zip(layers, revealed, strict=True)]
    later = np.cumsum([kept.any() for kept in rows][::-1])[::-1] - [kept.any() for kept in rows]
    inputs, outputs = [np.sqrt(ridge) * np.eye(len(layers[0].weight))], [np.sqrt(ridge) * layers[0].weight]
    for layer, truth, kept, since in zip(layers, revealed, rows, later, strict=True):
        weight = np.sqrt(forgetting**since)
        inputs.append(weight * layer.inputs[kept])
        outputs.append(weight * layer.outputs(truth.future.astype(np.float64))[kept])
    return np.linalg.lstsq(np.concatenate(inputs), np.concatenate(outputs), rcond=None)[0]


@pytest.mark.parametrize(("ridge", "forgetting"), [(10.0, 1.0), (0.5, 0.8)])
@pytest.mark.parametrize("of", SOURCES)
def test_the_kalman_filter_equals_a_ridge_regression(of, ridge, forgetting):
    adapted = adapter("kalman", of, ridge=ridge, forgetting=forgetting)
    revealed = [partly_known(one) if number % 3 == 2 else one for number, one in enumerate(scenes(8))]
    for truth in revealed:
        adapted.observe(truth)
    expected = ridge_solution(adapted, revealed, ridge, forgetting)
    np.testing.assert_allclose(adapted.mean, expected, rtol=1e-6, atol=1e-8)
    seen = scenes(1, seed=9)[0].observation
    layer = adapted.inner.last_layer(seen)
    np.testing.assert_allclose(
        adapted.predict(seen).positions[:, 0], layer.positions(layer.inputs @ expected), atol=1e-4
    )


@pytest.mark.parametrize("of", SOURCES)
def test_step_by_step_labels_give_the_same_weights(of):
    at_once, by_steps = (adapter("kalman", of, ridge=1.0, forgetting=0.9) for _ in range(2))
    one, other = scenes(2)
    at_once.observe(one)
    for steps in range(1, FUTURE + 1):
        by_steps.observe(dataclasses.replace(one, known=one.known & (np.arange(FUTURE) < steps)))
    np.testing.assert_allclose(by_steps.mean, at_once.mean, rtol=1e-9)
    for adapted in (at_once, by_steps):
        adapted.observe(other)
    np.testing.assert_allclose(by_steps.mean, at_once.mean, rtol=1e-9)
    np.testing.assert_allclose(by_steps.count, at_once.count)


def test_before_the_first_update_forecasts_are_those_of_the_predictor():
    seen = scenes(1)[0].observation
    for of in SOURCES:
        adapted = adapter("kalman", of)
        np.testing.assert_allclose(adapted.predict(seen).positions, adapted.inner.predict(seen).positions, atol=1e-4)
        assert (adapted.variance(seen) == 0).all()
        np.testing.assert_array_equal(adapted.predict(seen, 3).positions[:, 1], adapted.predict(seen).positions[:, 0])


@pytest.mark.parametrize("of", SOURCES)
def test_samples_follow_the_predictive_distribution(of):
    adapted = adapter("kalman", of)
    for truth in scenes(6):
        adapted.observe(truth)
    seen = scenes(1, seed=9)[0].observation
    drawn, again, other = (adapted.predict(seen, 4000, seed).positions for seed in (3, 3, 4))
    np.testing.assert_array_equal(drawn, again)
    np.testing.assert_array_equal(drawn[:, 0], adapted.predict(seen).positions[:, 0])
    np.testing.assert_array_equal(drawn[:, 0], other[:, 0])
    assert not np.array_equal(drawn[:, 1], other[:, 1])
    off = (drawn[:, 1:] - drawn[:, :1]).astype(np.float64)
    np.testing.assert_allclose(off.mean(axis=1), 0, atol=0.1 * np.sqrt(adapted.variance(seen).max()))
    np.testing.assert_allclose(off.var(axis=1), np.repeat(adapted.variance(seen)[..., None], 2, axis=2), rtol=0.12)
    direction = off / np.linalg.norm(off, axis=-1, keepdims=True)
    np.testing.assert_allclose(direction[:, :, :1] * np.ones((12, 1)), direction, atol=1e-2)


def test_the_predictive_variance_is_computed_from_residuals_before_each_update():
    adapted = adapter("kalman", "linear", forgetting=1.0)
    squares, count = np.zeros(FUTURE), 0
    for truth in scenes(5):
        layer = adapted.inner.last_layer(truth.observation)
        residual = adapted.predict(truth.observation).positions[:, 0] - truth.future
        precision = 10.0 * np.eye(layer.inputs.shape[1]) + (adapted.precision if len(adapted.precision) else 0)
        uncertainty = np.einsum("rc,cd,rd->r", layer.inputs, np.linalg.inv(precision), layer.inputs)
        squares += ((residual**2).sum(axis=-1) / 2 / (1 + uncertainty)[:, None]).sum(axis=0)
        count += len(truth.future)
        adapted.observe(truth)
    seen = scenes(1, seed=9)[0].observation
    inputs = adapted.inner.last_layer(seen).inputs
    uncertainty = np.einsum(
        "rc,cd,rd->r", inputs, np.linalg.inv(10.0 * np.eye(len(adapted.precision)) + adapted.precision), inputs
    )
    np.testing.assert_allclose(adapted.variance(seen), squares / count * (1 + uncertainty)[:, None], rtol=1e-4)


def test_the_kalman_filter_returns_to_the_trained_weights_without_measurements():
    adapted = adapter("kalman", "linear", ridge=1.0, forgetting=0.5)
    trained, one, still = adapted.inner.weight, scenes(1)[0], scenes(40, seed=7)
    adapted.observe(one)
    off = np.abs(adapted.mean - trained).max()
    for truth in still:
        # All agents stand still, as forecast: only the bias is measured.
        seen = dataclasses.replace(truth.observation, history=np.zeros_like(truth.observation.history))
        adapted.observe(dataclasses.replace(truth, observation=seen, future=np.zeros_like(truth.future)))
    assert np.abs(adapted.mean - trained)[:-1].max() < 1e-6 < off


def measured(adapted, truth):
    """Slope and innovation of the last layer of the network for two agents, from its inputs alone."""
    layer = adapted.inner.last_layer(truth.observation)
    (phi,) = layer.inputs
    off = truth.future - layer.positions(layer.inputs @ layer.weight)
    rows, innovation = [], []
    for agent in range(2):
        for step in STEPS:
            for axis in range(2):
                to = np.zeros((2, FUTURE, 2))
                to[agent, : step + 1, axis] = 1  # a position is the sum of the displacements up to it
                rows.append(np.outer(phi, to.ravel()))
                innovation.append(off[agent, step, axis])
    return np.array(rows), np.array(innovation)


@pytest.mark.parametrize("agents", [2, 4])
def test_the_extended_filter_of_a_last_layer_equals_a_ridge_regression(agents):
    spread, noise = 0.1, 0.3
    adapted = adapter("ekf", PAIR, spread=spread, noise=noise, drift=0, average=0, gate=1e6, agents=agents)
    revealed = scenes(5)
    trained = adapted.inner.last_layer(revealed[0].observation).weight
    slopes, innovations = zip(*(measured(adapted, truth) for truth in revealed), strict=True)
    slope, innovation = np.concatenate(slopes).reshape(-1, trained.size), np.concatenate(innovations)
    for truth in revealed:
        adapted.observe(truth)
    total = slope @ slope.T + (noise / spread) ** 2 * np.eye(len(slope))
    change = (slope.T @ np.linalg.solve(total, innovation)).reshape(trained.shape)
    weight = adapted.inner.last_layer(revealed[0].observation).weight
    np.testing.assert_allclose(weight - trained, change, atol=2e-3 * np.abs(change).max())
    assert np.abs(change).max() > 0.01 and adapted.updates == 5 and adapted.outliers == 0


def test_forecasts_use_averaged_weights():
    one, other = scenes(2)
    filtered, averaged = (adapter("ekf", PAIR, average=share) for share in (0, 0.75))
    trained = averaged.inner.tensors
    expected = {name: trained[name] for name in averaged.tuned}
    for truth in (one, other):
        for adapted in (filtered, averaged):
            adapted.observe(truth)
        torch.testing.assert_close(filtered.state, averaged.state)
        expected = {n: 0.25 * filtered.inner.tensors[n] + 0.75 * mean for n, mean in expected.items()}
        for name, mean in expected.items():
            torch.testing.assert_close(averaged.inner.tensors[name], mean)


def test_outliers_are_skipped_and_no_scene_counts_twice():
    adapted, crowd = adapter("ekf", PAIR), mg.domain("orca:d=0.3,scenes=4").windows("test")
    likely, other, later = (pick_scenes(crowd, [scene]) for scene in range(3))
    jump = np.where(np.arange(FUTURE)[:, None] > 5, np.float32(300), np.float32(0))
    adapted.observe(likely)
    before = snapshot(adapted)
    adapted.observe(dataclasses.replace(other, future=other.future + jump))
    adapted.observe(likely)
    assert changed(before, snapshot(adapted)) == ["outliers"]
    adapted.observe(later)
    assert (adapted.outliers, adapted.rolled_back, adapted.updates) == (1, 0, 2)


def test_measurements_shrink_the_covariance_and_drift_increases_it():
    adapted, drifting = adapter("ekf", PAIR, drift=0), adapter("ekf", PAIR, drift=0.01)
    for truth in scenes(3):
        for one in (adapted, drifting):
            one.observe(truth)
    initial = torch.eye(len(adapted.state)) * adapted.spread**2
    assert float(torch.linalg.eigvalsh(initial - adapted.covariance)[0]) > -1e-6
    assert float(adapted.covariance.trace()) < float(initial.trace())
    assert float(drifting.covariance.trace()) > float(adapted.covariance.trace())
    torch.testing.assert_close(adapted.covariance, adapted.covariance.T, atol=1e-7, rtol=1e-3)


def test_scenes_need_enough_known_steps():
    adapted = adapter("ekf", STGAT, least=6, agents=1)
    one = scenes(1, size=3)[0]
    known = np.arange(FUTURE) < np.array([[3], [12], [7]])
    adapted.observe(dataclasses.replace(one, known=known & (np.arange(FUTURE) < 5)))
    assert adapted.updates == 0
    adapted.observe(dataclasses.replace(one, known=known))
    assert adapted.updates == 1
    # Only the agent with the most known steps is measured.
    other, moved = adapter("ekf", STGAT, least=6, agents=1), one.future.copy()
    moved[[0, 2]] += 1
    other.observe(dataclasses.replace(one, known=known, future=moved))
    assert snapshot(other.inner.tensors) == snapshot(adapted.inner.tensors)


@pytest.mark.parametrize("name", ["kalman:ridge=0.1", "ekf"])
def test_filters_learn_a_new_crowd(name):
    crowd = mg.domain("orca:d=0.6,scenes=60").windows("test")
    adapted = adapter(name, PAIR)
    for scene in range(40):
        adapted.observe(pick_scenes(crowd, [scene]))
    later = pick_scenes(crowd, slice(40, None))
    errors = [
        np.linalg.norm(predictor.predict(later.observation).positions[:, 0] - later.future, axis=-1).mean()
        for predictor in (mg.predictor(PAIR), adapted)
    ]
    assert errors[1] < 0.85 * errors[0]
