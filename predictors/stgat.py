"""STGAT, the base model of the paper's experiments on spurious shifts, with each training objective."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from motion_gym.predictors.settings import boolean, setting
from motion_gym.predictors.stgat_predictor import Stgat
from motion_gym.predictors.training import objectives
from motion_gym.predictors.training.objectives import Objective
from motion_gym.specs import number


@dataclass(eq=False, repr=False)
class Erm(Stgat):
    """STGAT trained by empirical risk minimisation: the sum of the errors of all environments (the paper's Eq. 1).

    The alias ``erm_no_sigma`` has no sigma input, which leaks the future.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: See ``Stgat``.
        counterfactual: Subtract the decoder's forecast without the trajectory (Chen et al., ICCV 2021).
    """

    counterfactual: bool = setting(False, boolean)
    kind: ClassVar[str] = "erm"


@dataclass(eq=False, repr=False)
class Invariant(Stgat):
    """STGAT trained with a penalty on the gradient of each environment's risk (the paper's Eq. 3, IRMv1).

    Train it with ``joint`` steps. The penalty is the squared gradient with respect to a factor on the forecasts, which
    is also zero for forecasts of no motion. With ``unbiased=False`` and steps of one environment, where the gradient is
    large and varies most, training collapsed to such forecasts.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: See ``Stgat``.
        penalty: Factor lambda of the penalty. The default is the paper's, for pedestrians in metres. The risk grows
            with the square of the length of a step, the penalty with its fourth power: divide lambda by 600 for
            traffic, whose steps are 25 times as long.
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
        penalty: Factor beta of the variance, which grows with the fourth power of the length of a step, in metres.
    """

    penalty: float = setting(10.0, number)
    kind: ClassVar[str] = "vrex"

    @property
    def objective(self) -> Objective:
        """V-REx."""
        return objectives.VRex(self.penalty)


@dataclass(eq=False, repr=False)
class GroupDro(Stgat):
    """STGAT trained for the worst environment: group DRO (Sagawa et al., ICLR 2020).

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: See ``Stgat``.
        rate: Step size of the environment weights.
    """

    rate: float = setting(0.01, number)
    kind: ClassVar[str] = "group_dro"

    @property
    def objective(self) -> Objective:
        """Group DRO."""
        return objectives.GroupDro(self.rate)
