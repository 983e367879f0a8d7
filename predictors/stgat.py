"""STGAT, the base model of the paper's experiments on spurious shifts, with each of its training objectives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from motion_gym.predictors.settings import boolean, number, setting
from motion_gym.predictors.stgat_predictor import Stgat
from motion_gym.predictors.training import objectives
from motion_gym.predictors.training.objectives import Objective


@dataclass(eq=False, repr=False)
class Erm(Stgat):
    """STGAT trained by empirical risk minimisation: the sum of all environments' errors (the paper's Eq. 1).

    ``erm_no_sigma`` is the one without sigma: what a forecaster can do without the leak.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: See ``Stgat``.
        counterfactual: Subtract in the decoder what it would forecast without the trajectory (Chen et al., ICCV 2021).
    """

    counterfactual: bool = setting(False, boolean)
    kind: ClassVar[str] = "erm"


@dataclass(eq=False, repr=False)
class Invariant(Stgat):
    """STGAT trained with a penalty on the gradient of each environment's risk (the paper's Eq. 3, IRMv1).

    Train it with ``joint`` steps. The gradient, with respect to a factor on the forecasts, is also zero for forecasts
    of no motion: with ``unbiased=False`` and steps of one environment, where it is large and varies most, training
    ended there.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: See ``Stgat``.
        penalty: Factor lambda of the penalty.
        unbiased: Estimate the squared gradient from two halves of each step; see ``objectives.Irm``.
    """

    penalty: float = setting(5.0, number)
    unbiased: bool = setting(True, boolean)
    kind: ClassVar[str] = "invariant"

    @property
    def objective(self) -> Objective:
        """IRMv1."""
        return objectives.Irm(self.penalty, self.unbiased)


@dataclass(eq=False, repr=False)
class VRex(Stgat):
    """STGAT trained with a penalty on the variance of the environments' risks (Krueger et al., ICML 2021).

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: See ``Stgat``.
        penalty: Factor beta of the variance.
    """

    penalty: float = setting(10.0, number)
    kind: ClassVar[str] = "vrex"

    @property
    def objective(self) -> Objective:
        """V-REx."""
        return objectives.VRex(self.penalty)


@dataclass(eq=False, repr=False)
class GroupDro(Stgat):
    """STGAT trained for its worst environment: group DRO (Sagawa et al., ICLR 2020).

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: See ``Stgat``.
        rate: Step of the environments' weights.
    """

    rate: float = setting(0.01, number)
    kind: ClassVar[str] = "group_dro"

    @property
    def objective(self) -> Objective:
        """Group DRO."""
        return objectives.GroupDro(self.rate)
