"""The interfaces for adaptation agree with the forecasts of a predictor."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.checks.predictor_trials import synthetic
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.networks.last_layer import Linearised, Tunable, tunable
from tests.taped import fitted_linear

PAIRS = synthetic((2,) * 6, 2, 4)
MIXED = synthetic((1, 2, 5, 3), 3, 4)
PREDICTORS = {
    "style_erm": PAIRS,
    "modular": PAIRS,
    "modular_invariant": PAIRS,
    "modular_factors": PAIRS,
    "modular_stgat": MIXED,
    "erm": MIXED,
    "erm_no_sigma:weights=original/zara2": MIXED,
    "counterfactual": MIXED,
}
every = pytest.mark.parametrize("spec", PREDICTORS)


def prepared(spec):
    """A predictor with a style from a few observed scenes, if it has a style, and scenes to forecast."""
    predictor, truth = mg.predictor(spec), PREDICTORS[spec]
    predictor.fingerprint  # noqa: B018
    if hasattr(predictor, "observe"):
        predictor.observe(pick_scenes(truth, [1, 2]))
    return predictor, truth


@every
def test_offsets_of_the_own_weights_equal_the_forecast(spec):
    predictor, truth = prepared(spec)
    assert isinstance(predictor, Tunable)
    seen = truth.observation
    with torch.no_grad():
        offsets = predictor.offsets(seen, predictor.tensors)
    np.testing.assert_allclose(offsets[0].numpy() + seen.xy[:, -1:], predictor.predict(seen).positions[:, 0], atol=1e-4)


@every
def test_stacked_models_equal_single_models(spec):
    predictor, truth = prepared(spec)
    rng = torch.Generator().manual_seed(0)
    tuned = {
        name: predictor.tensors[name] + 0.02 * torch.randn(predictor.tensors[name].shape, generator=rng)
        for name in tunable(predictor, "all")
    }
    other = {**predictor.tensors, **tuned}
    both = {name: torch.cat([value, other[name]]) for name, value in predictor.tensors.items()}
    with torch.no_grad():
        together = predictor.offsets(truth.observation, both)
        apart = [predictor.offsets(truth.observation, weights)[0] for weights in (predictor.tensors, other)]
    np.testing.assert_allclose(together.numpy(), torch.stack(apart).numpy(), atol=1e-4)
    assert not np.allclose(apart[0], apart[1], atol=1e-3)


@every
def test_forecasts_depend_on_every_part(spec):
    predictor, truth = prepared(spec)
    for part, beginnings in predictor.parts.items():
        assert all(any(name.startswith(beginning) for name in predictor.tensors) for beginning in beginnings), part
        names = tunable(predictor, part)
        free = {name: predictor.tensors[name].clone().requires_grad_() for name in names}
        shown = predictor.whole_scenes(truth) if "style" in beginnings else None
        offsets = predictor.offsets(truth.observation, {**predictor.tensors, **free}, 0, shown)
        slopes = torch.autograd.grad((offsets**2).sum(), list(free.values()), allow_unused=True)
        reached = {name for name, slope in zip(names, slopes, strict=True) if slope is not None and slope.any()}
        assert {name.split(".")[0] for name in reached} == {name.split(".")[0] for name in names}, part
    assert set(tunable(predictor, "last_layer")) < set(tunable(predictor, "all"))


@pytest.mark.parametrize("spec", ["modular_invariant", "modular_stgat"])
def test_the_style_is_read_from_the_shown_scenes(spec):
    predictor, truth = prepared(spec)
    seen, parts = truth.observation, [pick_scenes(truth, [scene]) for scene in (1, 2)]
    with torch.no_grad():
        by_style = [predictor.offsets(seen, predictor.tensors, 0, part) for part in parts]
    assert float((by_style[0] - by_style[1]).abs().max()) > 1e-3


@every
def test_the_last_layer_gives_the_forecast(spec):
    predictor, truth = prepared(spec)
    assert isinstance(predictor, Linearised)
    assert_gives(predictor, truth)


def test_the_last_layer_of_linear_gives_the_forecast():
    assert isinstance(fitted_linear(), Linearised)
    assert_gives(fitted_linear(), MIXED)


def assert_gives(predictor, truth):
    layer, seen = predictor.last_layer(truth.observation), truth.observation
    assert layer.inputs.dtype == np.float64 and (layer.inputs[:, -1] == 1).all()
    positions = layer.positions(layer.inputs @ layer.weight)
    np.testing.assert_allclose(positions, predictor.predict(seen).positions[:, 0], atol=1e-4)
    # From positions to outputs and back; known rows do not depend on unknown positions.
    future = truth.future.astype(np.float64)
    np.testing.assert_allclose(layer.positions(layer.outputs(future)), future, atol=1e-8)
    assert len(layer.outputs(future)) == len(layer.inputs)
    known = np.random.default_rng(0).random(truth.known.shape) < 0.9
    rows = layer.known_rows(known)
    assert rows.shape == (len(layer.inputs),) and layer.known_rows(np.ones_like(known)).all()
    unknown = layer.by_step((~rows).astype(float)) > 0
    assert unknown.shape == known.shape and unknown[~known].all()
    other = np.where(known[..., None], future, future + 1)
    np.testing.assert_allclose(layer.outputs(other)[rows], layer.outputs(future)[rows])
