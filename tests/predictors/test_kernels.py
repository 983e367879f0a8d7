"""The kernels against plain operations of torch: values and gradients."""

import subprocess
import sys

import numpy as np
import pytest
import torch

from motion_gym.predictors.networks import kernel_loops, lstm
from motion_gym.predictors.networks import stgat_network as network
from motion_gym.predictors.networks.graph_attention import Layout, graph_attention

STEPS, MODELS = 3, 2


@pytest.fixture(params=[1, 2], ids=["one thread", "two threads"])
def working(request):
    """One or two threads for the matrix products of torch; kernels always use one thread."""
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield
    torch.set_num_threads(before)


def normal(*shape, spread=0.5):
    """Random numbers with a gradient."""
    return (spread * torch.randn(*shape)).requires_grad_()


def assert_same(function, arguments):
    """The values and gradients of the kernels in float32 equal those of plain torch in float64."""
    results = []
    for dtype in (torch.float32, torch.float64):
        own = [x.detach().to(dtype).requires_grad_(x.requires_grad) for x in arguments]
        values = function(*own)
        values = values if isinstance(values, tuple) else (values,)
        assert all(value.dtype == dtype for value in values)
        generator = torch.Generator().manual_seed(0)
        upstream = [torch.randn(value.shape, generator=generator).to(dtype) for value in values]
        slopes = torch.autograd.grad(values, [x for x in own if x.requires_grad], upstream)
        results.append([*values, *slopes])
    # The tolerance is relative to the largest value: some gradients are nearly zero, such as that of a bias before a
    # normalisation, and consist of rounding errors.
    scale = max(float(expected.detach().abs().max()) for expected in results[1] if expected.numel())
    for mine, expected in zip(*results, strict=True):
        torch.testing.assert_close(mine.double(), expected, atol=5e-5 * max(scale, 1), rtol=1e-4)


@pytest.mark.parametrize("agents", [0, 1, 37])
def test_lstm_with_given_inputs(working, agents):
    torch.manual_seed(0)
    inputs, weight = normal(STEPS, MODELS, agents, 3), normal(MODELS, 10, 24)
    h, c = normal(MODELS, agents, 6), normal(MODELS, agents, 6)
    assert_same(lstm.unrolled, [inputs, h, c, weight])
    assert_same(lstm.unrolled, [inputs.detach(), h.detach(), c.detach(), weight])


@pytest.mark.parametrize("twins", [False, True])
@pytest.mark.parametrize("agents", [0, 1, 37])
def test_lstm_with_its_own_output_as_input(working, agents, twins):
    torch.manual_seed(0)
    h, weight = normal(MODELS, agents * (1 + twins), 6), normal(MODELS, 9, 24)
    arguments = [h, torch.randn(MODELS, agents, 2), weight, normal(MODELS, 6, 2), normal(MODELS, 2)]
    assert_same(lambda *tensors: lstm.rolled_out(*tensors, STEPS, twins), arguments)


@pytest.mark.parametrize("sizes", [[1, 5, 0, 3, 19], [1], [0], []], ids=str)
def test_graph_attention(working, sizes):
    torch.manual_seed(0)
    layout = Layout.of(np.append(0, np.cumsum(sizes, dtype=int)))
    shapes = {key: shape for key, shape in network.shapes(3).items() if key.startswith("attention")}
    weights = [normal(MODELS, *shape, spread=0.2) for shape in shapes.values()]
    assert_same(
        lambda x, *tensors: graph_attention(x, layout, dict(zip(shapes, tensors, strict=True))),
        [normal(STEPS, MODELS, sum(sizes), 32), *weights],
    )


def test_large_logits_do_not_overflow():
    torch.manual_seed(0)
    layout, weights = Layout.of(np.array([0, 4])), network.initial(3, 0)
    for side in ("source", "target"):
        weights[f"attention1.{side}"] *= 1000
    x = torch.randn(1, 1, 4, 32)
    results = graph_attention(x, layout, weights).double()
    expected = graph_attention(x.double(), layout, {key: value.double() for key, value in weights.items()})
    torch.testing.assert_close(results, expected, atol=1e-4, rtol=1e-4)


def test_hyperbolic_tangent():
    x = np.concatenate([np.linspace(-12, 12, 100_001), [1e-6, -1e-20, 0, np.inf, -np.inf]]).astype(np.float32)
    results = np.array([kernel_loops.tanh(value) for value in x])
    np.testing.assert_allclose(results, np.tanh(x.astype(np.float64)), atol=0, rtol=1e-6)
    assert np.isnan(kernel_loops.tanh(np.float32("nan")))


def test_numba_is_not_imported_before_it_is_needed():
    code = "import sys, motion_gym; print([name for name in ('numba', 'torch') if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"
