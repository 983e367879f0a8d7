"""The numba kernels against plain operations of torch: values and gradients, on one thread and on two."""

import multiprocessing
import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from motion_gym.predictors import kernels, lstm
from motion_gym.predictors import stgat_network as network
from motion_gym.predictors.graph_attention import Layout, graph_attention

MODELS, STEPS = 2, 3


@pytest.fixture(params=[1, 2], ids=["one thread", "two threads"])
def threads(request, monkeypatch):
    """Both ways of working, and slices of a few rows."""
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    monkeypatch.setattr(kernels, "CACHED", 500)
    yield
    torch.set_num_threads(before)


def normal(*shape, spread=0.5):
    """Random float32 numbers that want a gradient."""
    return (spread * torch.randn(*shape)).requires_grad_()


def assert_same(function, arguments):
    """The function has the same values and gradients in float32, by the kernels, as in float64, by plain torch."""
    torch.manual_seed(1)
    found = []
    for dtype in (torch.float32, torch.float64):
        own = [x.detach().to(dtype).requires_grad_(x.requires_grad) for x in arguments]
        value = function(*own)
        upstream = torch.randn(value.shape, generator=torch.Generator().manual_seed(0)).to(dtype)
        wanted = [x for x in own if x.requires_grad]
        found.append([value, *torch.autograd.grad(value, wanted, upstream)])
    for mine, expected in zip(*found, strict=True):
        assert mine.dtype == torch.float32
        torch.testing.assert_close(mine.double(), expected, atol=1e-4, rtol=5e-4)


def lstm_arguments(agents, inputs, size):
    torch.manual_seed(0)
    return normal(MODELS, agents, size), normal(MODELS, inputs + size + 1, 4 * size)


@pytest.mark.parametrize("agents", [0, 1, 37])
def test_unrolled_lstm(threads, agents):
    h, weight = lstm_arguments(agents, 3, 6)
    assert_same(lstm.unrolled, [normal(STEPS, MODELS, agents, 3), h.detach(), torch.randn(MODELS, agents, 6), weight])


@pytest.mark.parametrize("twins", [False, True])
@pytest.mark.parametrize("agents", [0, 1, 37])
def test_rolled_out_lstm(threads, agents, twins):
    h, weight = lstm_arguments(agents * (1 + twins), 2, 6)
    arguments = [h, torch.randn(MODELS, agents, 2), weight, normal(MODELS, 6, 2), normal(MODELS, 2)]
    assert_same(lambda *a: lstm.rolled_out(*a, STEPS, twins), arguments)


@pytest.mark.parametrize("sizes", [[1, 5, 0, 2, 19], [1], [0], []], ids=str)
def test_graph_attention(threads, sizes):
    torch.manual_seed(0)
    layout = Layout.of(np.append(0, np.cumsum(sizes, dtype=int)))
    weights = {
        key: normal(MODELS, *shape, spread=0.1)
        for key, shape in network.shapes(3).items()
        if key.startswith("attention")
    }
    assert_same(
        lambda x, *values: graph_attention(x, layout, dict(zip(weights, values, strict=True))),
        [normal(STEPS, MODELS, sum(sizes), 32), *weights.values()],
    )


def test_large_logits_do_not_overflow():
    torch.manual_seed(0)
    layout = Layout.of(np.array([0, 4]))
    weights = {k: v.clone() for k, v in network.initial(3, 0).items() if k.startswith("attention")}
    for side in ("source", "target"):
        weights[f"attention1.{side}"] *= 1000
    assert_same(
        lambda x: graph_attention(x, layout, {k: v.to(x.dtype) for k, v in weights.items()}), [normal(1, 1, 4, 32)]
    )


def test_hyperbolic_tangent():
    x = np.concatenate([np.linspace(-12, 12, 100_001), [1e-6, -1e-20, 0, np.inf, -np.inf]]).astype(np.float32)
    found = np.array([kernels.tanh(v) for v in x], np.float32)
    np.testing.assert_allclose(found, np.tanh(x.astype(np.float64)), atol=1e-12, rtol=1e-6)
    assert np.isnan(kernels.tanh(np.float32("nan")))
