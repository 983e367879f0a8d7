"""Base class of the STGAT family."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation, PredictorError, Truth
from motion_gym.data.windows import pick_scenes_of
from motion_gym.predictors.networks.graph_attention import Layout
from motion_gym.predictors.networks.last_layer import LastLayer, with_bias_input
from motion_gym.predictors.networks.scene_noise import agent_keys, normals
from motion_gym.predictors.networks.sigma import check_sigma, relative_to_scene
from motion_gym.predictors.networks.stgat_network import (
    NOISE,
    STATES,
    Draws,
    decode,
    decoder_states,
    encode,
    shapes,
)
from motion_gym.predictors.networks.stgat_released import import_released
from motion_gym.predictors.settings import setting
from motion_gym.predictors.training import objectives
from motion_gym.predictors.training.objectives import Objective
from motion_gym.predictors.training.stgat_training import StgatProgram
from motion_gym.predictors.weighted import Weighted
from motion_gym.training.plans import OTHER_PLACES
from motion_gym.training.program import Weights

if TYPE_CHECKING:
    from typing_extensions import Self

SCENES_AT_ONCE = 256
"""Scenes times samples of one forward pass, to bound memory."""

PARTS: Mapping[str, tuple[str, ...]] = {
    "all": ("trajectory", "attention1", "attention2", "graph", "decoder", "stage3"),
    "last_layer": ("stage3",),
}
"""Tunable weights, by prefixes of their names."""


@dataclass(eq=False, repr=False)
class Stgat(Weighted):
    """Spatio-temporal graph attention (Huang et al., ICCV 2019), with the sizes of the paper's released program.

    The input is the displacements of the 8 observed steps, rounded to 4 decimals (the first is 0), and sigma as a third
    value. Stochastic: the initial states and the decoder noise are drawn from N(0, 1), the noise once per scene, so
    that sample k of a scene is one joint forecast. The draws depend on the seed and the scene, not on the batch.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: True to use sigma; ``"relative"`` to divide sigma by its mean over the scene, which removes its scale;
            False for a network without this input.
    """

    sigma: bool | str = setting(True, check_sigma)
    kind: ClassVar[str] = "stgat"
    sets: ClassVar[tuple[str, ...]] = ("spurious", *OTHER_PLACES)
    program: ClassVar[type[StgatProgram]] = StgatProgram
    counterfactual = False
    parts: ClassVar[Mapping[str, tuple[str, ...]]] = PARTS
    """Tunable weights, by prefixes of their names; see ``last_layer.Tunable``."""

    @property
    def expected(self) -> dict[str, tuple[int, ...]]:
        """Shape of every weight, without the model axis."""
        return shapes(self.features)

    @property
    def objective(self) -> Objective:
        """Training objective."""
        return objectives.Erm()

    @property
    def features(self) -> int:
        """Values per observed step."""
        return 2 if self.sigma is False else 3

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres.

        Raises:
            PredictorError: there are no weights, or the observation has no sigma.
        """
        ready = self._ready(observation)
        weights = {key: value.expand(samples, *value.shape[1:]) for key, value in ready.items()}
        parts = [np.zeros((0, samples, FUTURE, 2), np.float32)]
        at_once = max(SCENES_AT_ONCE // samples, 1)
        with torch.no_grad():
            for first in range(0, observation.scenes, at_once):
                part = pick_scenes_of(observation, slice(first, first + at_once))
                moves = self._moves(*self._network_inputs(part, samples, seed), weights)
                positions = torch.from_numpy(part.xy[:, -1].copy()) + moves.cumsum(dim=0)
                parts.append(positions.permute(2, 1, 0, 3).contiguous().numpy())
        return Forecast(np.concatenate(parts))

    def _moves(
        self, steps: Tensor, draws: Draws, layout: Layout, weights: Weights, shown: Truth | None = None
    ) -> Tensor:
        """Forecast displacements [12, K, A, 2]."""
        latent = self._latent(steps, draws, layout, weights, shown)
        return decode(latent, steps[-1, :, :2], draws.noise, weights, self.counterfactual)

    def offsets(self, observation: Observation, weights: Weights, seed: int = 0, shown: Truth | None = None) -> Tensor:
        """Offsets [M, A, 12, 2] of the first sample from the last position, metres; see ``last_layer.Tunable``."""
        steps, draws, layout = self._network_inputs(observation, 1, seed)
        moves = self._moves(steps, draws.for_models(len(weights["stage3.bias"])), layout, weights, shown)
        return moves.permute(1, 2, 0, 3).cumsum(dim=2)

    def last_layer(self, observation: Observation, seed: int = 0) -> LastLayer:
        """The last layer, from each agent and step to its displacement; see ``last_layer.LastLayer``."""
        weights = self._ready(observation)
        steps, draws, layout = self._network_inputs(observation, 1, seed)
        with torch.no_grad():
            latent = self._latent(steps, draws, layout, weights)
            _, states = decoder_states(latent, steps[-1, :, :2], draws.noise, weights, self.counterfactual)
        inputs = states[:, 0].transpose(0, 1).flatten(0, 1).double().numpy()
        weight = np.concatenate([weights["stage3.weight"][0].numpy(), weights["stage3.bias"].numpy()])
        return LastLayer(with_bias_input(inputs), weight.astype(np.float64), observation.xy[:, -1:].astype(np.float64))

    def _latent(
        self, steps: Tensor, draws: Draws, layout: Layout, weights: Weights, shown: Truth | None = None
    ) -> Tensor:
        """Latent [M, A, 64], the input of the decoder."""
        return encode(steps, draws, layout, weights)

    def _network_inputs(self, observation: Observation, samples: int, seed: int) -> tuple[Tensor, Draws, Layout]:
        """Steps [8, A, F], the random draws of K samples, and the layout of the scenes."""
        keys, own = agent_keys(observation, samples, seed)
        layout = Layout.of(observation.scene)
        draws = Draws.of(torch.from_numpy(normals(own, STATES)), torch.from_numpy(normals(keys, NOISE)), layout)
        return torch.from_numpy(self.inputs(observation)), draws, layout

    def inputs(self, observation: Observation) -> np.ndarray:
        """Input of the network: [8, A, F] float32, displacements in metres (0 at the first step), then sigma.

        Raises:
            PredictorError: the observation has no sigma.
        """
        if observation.history.shape[2] < self.features:
            raise PredictorError(
                f"{self.name} needs sigma, but this domain gives only x and y: use a domain with sigma, such as "
                "eth:alpha=8, or a predictor without sigma, such as erm_no_sigma."
            )
        xy = observation.xy.astype(np.float64)
        steps = np.zeros((len(xy), HISTORY, self.features), np.float32)
        steps[:, 1:, :2] = np.round(np.diff(xy, axis=1), 4)
        if self.sigma:
            relative = self.sigma == "relative"
            steps[:, :, 2] = relative_to_scene(observation) if relative else observation.history[:, :, 2]
        return np.ascontiguousarray(steps.transpose(1, 0, 2))

    def from_released(self, path: str | Path) -> Self:
        """Use the weights of the paper's released program; see ``import_released``. Returns the predictor itself."""
        self.use(*import_released(path), str(path))
        return self
