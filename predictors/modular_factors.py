"""The modular network whose style has factors: the side of passing and the distance, each with a code of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from motion_gym import catalog
from motion_gym.contract import PredictorError, Truth
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import CODE, FACTORS, SHARE
from motion_gym.predictors.training.factor_training import FactorProgram
from motion_gym.predictors.training.style_training import StyleProgram
from motion_gym.specs import one_of


@dataclass(eq=False, repr=False)
class ModularFactors(Modular):
    """``modular`` whose style is split into factors, the parameters ``side`` and ``d`` of the domain ``orca``.

    Each factor has a style encoder with a code of its own, which is trained by contrast over the training domains that
    share the value of the parameter, and a modulator of its own. Gates share the units of the latent among the
    modulators, and a penalty lets each unit belong to one of them; see ``pair_network.modulate`` and ``FactorProgram``.

    The codes can be read from different scenes: ``observe(truth, factors=["side"])`` reads the code of the side alone.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        penalty: See ``StyleErm``.
    """

    kind: ClassVar[str] = "modular_factors"
    sets: ClassVar[tuple[str, ...]] = ("factors",)
    program: ClassVar[type[StyleProgram]] = FactorProgram
    factors: ClassVar[tuple[str, ...]] = FACTORS
    """Parameters of a domain that have a code of their own."""
    expected: ClassVar[dict[str, tuple[int, ...]]] = {
        **pair_network.shapes_with_factors(),
        "prior.code": (CODE,),
        "prior.dt": (1,),
    }
    scenes_of_factors: np.ndarray = field(default_factory=lambda: np.zeros(len(FACTORS)), init=False)
    """[F] number of scenes from which the code of each factor is read."""

    def labels_of(self, names: Sequence[str]) -> dict[str, Any]:
        """Value of each factor in each of the named training domains, as the option ``labels`` of ``FactorProgram``.

        Raises:
            PredictorError: there are no names, or a domain lacks a factor.
        """
        parameters: list[Mapping[str, Any]] = [catalog.domain(name).card.parameters for name in names]
        lacking = [name for name, values in zip(names, parameters, strict=True) if not values.keys() >= set(FACTORS)]
        if lacking or not names:
            raise PredictorError(
                f"{self.name} learns the factors {', '.join(FACTORS)} from the parameters of the training domains, and "
                + (f"{lacking[0]} does not have them" if lacking else "none are named")
                + ": train on orca domains, and give `names` (their specs) or `labels`."
            )
        return {"labels": {factor: [values[factor] for values in parameters] for factor in FACTORS}}

    def observe(self, truth: Truth, factors: Sequence[str] = FACTORS) -> None:
        """Read the codes of some factors from the scenes whose 20 steps are all known.

        Args:
            truth: Scenes of two agents.
            factors: Factors to read, ``side`` and ``d``; the codes of the others stay as they are.

        Raises:
            SpecError: a factor is not known.
            DataError: the ground truth is not valid.
            PredictorError: there are no weights, or the scenes have another time step than the training data.
        """
        for factor in factors:
            one_of("factors", factor, FACTORS, self.kind)
        before, count = self.observed, self.scenes
        super().observe(truth)
        read = np.isin(FACTORS, list(factors))
        self.observed = np.where(np.repeat(read, SHARE), self.observed, before)
        self.scenes_of_factors = self.scenes_of_factors + read * (self.scenes - count)

    def reset(self) -> None:
        """Forget all observed scenes."""
        super().reset()
        self.scenes_of_factors = np.zeros(len(FACTORS))

    def scenes_of_values(self) -> np.ndarray:
        """[8] number of observed scenes from which each value of the code is read."""
        return np.repeat(self.scenes_of_factors, SHARE)
