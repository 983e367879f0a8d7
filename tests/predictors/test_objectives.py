"""Objectives against golden numbers, autograd and their definitions."""

import numpy as np
import pytest
import torch

from motion_gym.predictors.training.objectives import Erm, GroupDro, Irm, Risks, VRex, risks_of
from tests.predictors.test_stgat import SHARED

EMPTY = torch.zeros(0)


@pytest.mark.parametrize("name", ["erm", "counterfactual", "irm_5.0"])
def test_risk_and_penalty_equal_those_of_the_released_program(name):
    path = SHARED / "stgat_golden.npz"
    if not path.exists():
        pytest.skip("the golden numbers of the released program are not here")
    golden = dict(np.load(path))
    sizes = np.diff(golden["seq_start_end"], axis=1)[:, 0]
    target = torch.from_numpy(golden["fut_rel"][..., :2])
    share = torch.from_numpy(np.repeat(1 / (12 * sizes), sizes)).float().expand(12, -1)
    scene = torch.from_numpy(np.repeat(np.arange(len(sizes)), sizes))
    forecast = torch.from_numpy(golden[f"{name}/stage3"])[:, None]
    risks = risks_of(forecast, target, share, scene, torch.zeros_like(scene), torch.tensor([float(len(sizes))]))
    assert risks.value.item() == pytest.approx(float(golden[f"{name}/risk"]), rel=1e-5)
    penalty = Irm(len(sizes) / 64, unbiased=False)(risks, EMPTY) - Erm()(risks, EMPTY)
    assert penalty.item() == pytest.approx(float(golden[f"{name}/irm_penalty"]), rel=1e-5)


def some_risks(environments=3, models=2, agents=40, seed=0):
    """Risks of random forecasts, and the arguments that they were computed from."""
    generator = torch.Generator().manual_seed(seed)
    forecast = torch.randn(12, models, agents, 2, generator=generator, dtype=torch.float64)
    target = torch.randn(12, agents, 2, generator=generator, dtype=torch.float64)
    weight = torch.rand(12, agents, generator=generator, dtype=torch.float64)
    scene = torch.arange(agents) // 2
    environment = torch.arange(agents) * environments // agents
    count = torch.bincount(environment[::2]).double()
    return risks_of(forecast, target, weight, scene, environment, count), (forecast, target, weight, environment)


def test_slopes_are_derivatives_with_respect_to_a_scale():
    risks, (forecast, target, weight, environment) = some_risks()
    scale = torch.ones(2, dtype=torch.float64, requires_grad=True)
    for number in range(3):
        here = environment == number
        off = (forecast * scale[None, :, None, None] - target[:, None])[:, :, here]
        value = (off**2 * weight[:, None, here, None]).sum(dim=(0, 2, 3))
        (slope,) = torch.autograd.grad(value.sum(), scale)
        torch.testing.assert_close(risks.value[number], value.detach())
        torch.testing.assert_close(risks.slope[:, number].sum(dim=0), slope)


def test_irm_adds_the_squared_slope_of_each_environment():
    risks, _ = some_risks()
    slope = risks.slope.sum(dim=0)
    expected = risks.value.sum(dim=0) + (3 * 64 / risks.scenes[:, None] * slope**2).sum(dim=0)
    torch.testing.assert_close(Irm(3.0, unbiased=False)(risks, EMPTY), expected)
    torch.testing.assert_close(Irm(0.0)(risks, EMPTY), Erm()(risks, EMPTY))


def test_the_unbiased_penalty_has_the_right_expectation():
    # Slopes of 2 n scenes drawn around a mean: the square of their sum exceeds (2 n mean)^2 by the noise, the product
    # of the halves does not.
    rng = np.random.default_rng(0)
    mean, trials = 0.3, 20_000
    halves = torch.from_numpy(rng.normal(8 * mean, np.sqrt(8), (2, 1, trials)))
    risks = Risks(torch.zeros(1, trials), halves, torch.tensor([16.0]))
    assert Irm(16 / 64)(risks, EMPTY).mean().item() == pytest.approx((8 * mean) ** 2, rel=0.05)
    squared = Irm(16 / 64, unbiased=False)(risks, EMPTY)
    assert squared.mean().item() == pytest.approx((16 * mean) ** 2 + 16, rel=0.05)


def test_lambda_does_not_depend_on_the_scenes_per_step():
    many = Risks(torch.full((1, 1), 8.0), torch.full((2, 1, 1), 3.0), torch.tensor([64.0]))
    few = Risks(many.value / 4, many.slope / 4, many.scenes / 4)
    for unbiased in (True, False):
        objective = Irm(5.0, unbiased)
        torch.testing.assert_close(4 * objective(few, EMPTY), objective(many, EMPTY))


def test_vrex_penalises_only_differences_of_mean_risks():
    value = torch.tensor([[4.0], [8.0]])
    even = Risks(value, torch.zeros(2, 2, 1), torch.tensor([4.0, 8.0]))
    assert VRex(100.0)(even, EMPTY).item() == pytest.approx(1.0)
    uneven = Risks(value, torch.zeros(2, 2, 1), torch.tensor([4.0, 2.0]))
    assert VRex(100.0)(uneven, EMPTY).item() == pytest.approx(2.5 + 100 * 2.25)


def test_group_dro_converges_to_the_worst_environment():
    objective = GroupDro(1.0)
    state = objective.start(2, 1, torch.device("cpu"))
    risks = Risks(torch.tensor([[1.0], [3.0]], requires_grad=True), torch.zeros(2, 2, 1), torch.ones(2))
    first = objective(risks, state)
    assert first.item() == pytest.approx((np.e + 3 * np.e**3) / (np.e + np.e**3), rel=1e-5)
    for _ in range(10):
        last = objective(risks, state)
    assert last.item() == pytest.approx(3.0, abs=1e-3)
    (gradient,) = torch.autograd.grad(last.sum(), risks.value)
    torch.testing.assert_close(gradient, state)
