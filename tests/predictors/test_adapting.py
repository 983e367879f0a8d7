"""What predictors offer to be adapted agrees with their forecasts."""

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
    "modular_stgat": MIXED,
    "erm": MIXED,
    "erm_no_sigma:weights=original/zara2": MIXED,
    "counterfactual": MIXED,
}
every = pytest.mark.parametrize("spec", PREDICTORS)


def made_of(spec):
    """The predictor, after it has seen a few scenes if it reads a style, and scenes for it."""
    made, truth = mg.predictor(spec), PREDICTORS[spec]
    made.fingerprint  # noqa: B018
    if hasattr(made, "observe"):
        made.observe(pick_scenes(truth, [1, 2]))
    return made, truth


@every
def test_forecasts_by_its_own_weights_are_its_forecasts(spec):
    made, truth = made_of(spec)
    assert isinstance(made, Tunable)
    seen = truth.observation
    with torch.no_grad():
        offsets = made.offsets(seen, made.tensors)
    np.testing.assert_allclose(offsets[0].numpy() + seen.xy[:, -1:], made.predict(seen).positions[:, 0], atol=1e-4)


@every
def test_several_models_forecast_side_by_side(spec):
    made, truth = made_of(spec)
    rng = torch.Generator().manual_seed(0)
    tuned = {
        name: made.tensors[name] + 0.02 * torch.randn(made.tensors[name].shape, generator=rng)
        for name in tunable(made, "all")
    }
    other = {**made.tensors, **tuned}
    both = {name: torch.cat([value, other[name]]) for name, value in made.tensors.items()}
    with torch.no_grad():
        together = made.offsets(truth.observation, both)
        apart = [made.offsets(truth.observation, weights)[0] for weights in (made.tensors, other)]
    np.testing.assert_allclose(together.numpy(), torch.stack(apart).numpy(), atol=1e-4)
    assert not np.allclose(apart[0], apart[1], atol=1e-3)


@every
def test_parts_are_weights_that_forecasts_depend_on(spec):
    made, truth = made_of(spec)
    for part, beginnings in made.parts.items():
        assert all(any(name.startswith(beginning) for name in made.tensors) for beginning in beginnings), part
        names = tunable(made, part)
        free = {name: made.tensors[name].clone().requires_grad_() for name in names}
        shown = made.whole_scenes(truth) if "style" in beginnings else None
        offsets = made.offsets(truth.observation, {**made.tensors, **free}, 0, shown)
        slopes = torch.autograd.grad((offsets**2).sum(), list(free.values()), allow_unused=True)
        reached = {name for name, slope in zip(names, slopes, strict=True) if slope is not None and slope.any()}
        assert {name.split(".")[0] for name in reached} == {name.split(".")[0] for name in names}, part
    assert set(tunable(made, "last_layer")) < set(tunable(made, "all"))


@pytest.mark.parametrize("spec", ["modular_invariant", "modular_stgat"])
def test_the_style_is_that_of_the_scenes_that_are_shown(spec):
    made, truth = made_of(spec)
    seen, parts = truth.observation, [pick_scenes(truth, [scene]) for scene in (1, 2)]
    with torch.no_grad():
        by_style = [made.offsets(seen, made.tensors, 0, part) for part in parts]
    assert float((by_style[0] - by_style[1]).abs().max()) > 1e-3


@every
def test_the_last_layer_gives_its_forecasts(spec):
    made, truth = made_of(spec)
    assert isinstance(made, Linearised)
    assert_gives(made, truth)


def test_the_last_layer_of_linear_gives_its_forecasts():
    assert isinstance(fitted_linear(), Linearised)
    assert_gives(fitted_linear(), MIXED)


def assert_gives(made, truth):
    layer, seen = made.last_layer(truth.observation), truth.observation
    assert layer.inputs.dtype == np.float64 and (layer.inputs[:, -1] == 1).all()
    said = layer.positions(layer.inputs @ layer.weight)
    np.testing.assert_allclose(said, made.predict(seen).positions[:, 0], atol=1e-4)
    # From positions to outputs and back; what is not known, as where someone is hidden, is of no account to a row.
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
