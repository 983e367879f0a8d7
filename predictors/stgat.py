"""STGAT, the base model of the paper's experiments on spurious shifts: a predictor for each way to train it."""

from __future__ import annotations

from pathlib import Path

from motion_gym.predictors.stgat_predictor import Stgat
from motion_gym.predictors.training import objectives
from motion_gym.predictors.training.objectives import Objective


class Erm(Stgat):
    """STGAT trained by empirical risk minimisation: the sum of all environments' errors (the paper's Eq. 1).

    Args:
        weights: Name of shipped weights, or a ``.safetensors`` file.
        seed: Which of the seeds that the weights hold; by default the first.
        sigma: true, ``relative`` (divided by its mean over the scene) or false (never given).
    """

    kind = "erm"


class ErmNoSigma(Stgat):
    """STGAT trained by empirical risk minimisation, never given sigma: what a forecaster can do without the leak.

    Args:
        weights: Name of shipped weights, or a ``.safetensors`` file.
        seed: Which of the seeds that the weights hold; by default the first.
    """

    kind = "erm_no_sigma"
    settings = ()

    def __init__(self, weights: str | Path | None = None, seed: int | None = None):
        super().__init__(weights, seed, sigma=False)


class Counterfactual(Stgat):
    """STGAT whose decoder subtracts what it would forecast without the trajectory (Chen et al., ICCV 2021).

    Args:
        weights: Name of shipped weights, or a ``.safetensors`` file.
        seed: Which of the seeds that the weights hold; by default the first.
        sigma: true, ``relative`` (divided by its mean over the scene) or false (never given).
    """

    kind = "counterfactual"
    counterfactual = True


class Invariant(Stgat):
    """STGAT trained with a penalty on the gradient of each environment's risk (the paper's Eq. 3, IRMv1).

    Train it with ``joint`` steps. The gradient, by a factor on the forecasts, is zero too for forecasts of no motion:
    with ``unbiased=False`` and steps of one environment, where it is large and varies most, training ended there.

    Args:
        weights: Name of shipped weights, or a ``.safetensors`` file.
        seed: Which of the seeds that the weights hold; by default the first.
        sigma: true, ``relative`` (divided by its mean over the scene) or false (never given).
        penalty: Factor lambda of the penalty.
        unbiased: Estimate the squared gradient from two halves of each step; see ``objectives.Irm``.
    """

    kind = "invariant"
    settings = ("sigma", "penalty", "unbiased")

    def __init__(
        self,
        weights: str | Path | None = None,
        seed: int | None = None,
        sigma: bool | str = True,
        penalty: float = 5.0,
        unbiased: bool = True,
    ):
        self.penalty, self.unbiased = penalty, unbiased
        objectives.Irm(penalty, unbiased)  # says at once what is wrong with a value
        super().__init__(weights, seed, sigma)

    @property
    def objective(self) -> Objective:
        """IRMv1."""
        return objectives.Irm(self.penalty, self.unbiased)


class VRex(Stgat):
    """STGAT trained with a penalty on the variance of the environments' risks (Krueger et al., ICML 2021).

    Args:
        weights: Name of shipped weights, or a ``.safetensors`` file.
        seed: Which of the seeds that the weights hold; by default the first.
        sigma: true, ``relative`` (divided by its mean over the scene) or false (never given).
        penalty: Factor beta of the variance.
    """

    kind = "vrex"
    settings = ("sigma", "penalty")

    def __init__(
        self,
        weights: str | Path | None = None,
        seed: int | None = None,
        sigma: bool | str = True,
        penalty: float = 10.0,
    ):
        self.penalty = penalty
        objectives.VRex(penalty)
        super().__init__(weights, seed, sigma)

    @property
    def objective(self) -> Objective:
        """V-REx."""
        return objectives.VRex(self.penalty)


class GroupDro(Stgat):
    """STGAT trained for its worst environment: group DRO (Sagawa et al., ICLR 2020).

    Args:
        weights: Name of shipped weights, or a ``.safetensors`` file.
        seed: Which of the seeds that the weights hold; by default the first.
        sigma: true, ``relative`` (divided by its mean over the scene) or false (never given).
        rate: Step of the environments' weights.
    """

    kind = "group_dro"
    settings = ("sigma", "rate")

    def __init__(
        self,
        weights: str | Path | None = None,
        seed: int | None = None,
        sigma: bool | str = True,
        rate: float = 0.01,
    ):
        self.rate = rate
        objectives.GroupDro(rate)
        super().__init__(weights, seed, sigma)

    @property
    def objective(self) -> Objective:
        """Group DRO."""
        return objectives.GroupDro(self.rate)
