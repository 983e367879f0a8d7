"""The paper's predictors for style shifts: the two-agent network with and without a style, by ERM and IRM."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation, Truth
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.last_layer import LastLayer, with_bias_input
from motion_gym.predictors.networks.pair_network import AGENTS, CODE, LAYERS, PLAIN, Pairs
from motion_gym.predictors.settings import setting
from motion_gym.predictors.style_memory import StyleMemory
from motion_gym.predictors.training.objectives import Erm, Irm, Objective
from motion_gym.predictors.training.style_training import StyleProgram
from motion_gym.predictors.training.transfer_training import PARTS, TransferProgram
from motion_gym.predictors.weighted import Weighted
from motion_gym.specs import number
from motion_gym.training.program import Weights


@dataclass(eq=False, repr=False)
class StyleErm(Weighted):
    """The paper's two-agent network for style shifts, without a style.

    Takes scenes of exactly two agents, in a fixed order, with absolute positions. Deterministic. The alias
    ``style_invariant`` is trained with IRMv1, lambda 1 (the paper's invariant row).

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        penalty: Factor lambda of IRMv1 in the first stage; 0 for empirical risk minimisation.
    """

    penalty: float = setting(0.0, number)
    kind: ClassVar[str] = "style_erm"
    sets: ClassVar[tuple[str, ...]] = ("style",)
    agents_per_scene: ClassVar[int] = AGENTS
    """The only number of agents per scene that the network takes."""
    program: ClassVar[type[StyleProgram]] = StyleProgram
    epochs: ClassVar[tuple[int, ...]] = (100,)
    """Epochs of each stage, as in the released program."""
    expected: ClassVar[dict[str, tuple[int, ...]]] = pair_network.shapes(  # type: ignore[misc]
        {part: LAYERS[part] for part in PLAIN}
    )
    """Shape of every weight, without the model axis."""
    parts: ClassVar[Mapping[str, tuple[str, ...]]] = {"all": PLAIN, "last_layer": PARTS["last_layer"]}
    """Tunable weights, by prefixes of their names; see ``last_layer.Tunable``."""
    _double: Weights | None = field(default=None, init=False)
    """Copy of ``tensors`` in double precision."""

    @property
    def tensors(self) -> Weights | None:  # type: ignore[override]
        """Weights [1, ...] of the seed; they are replaced as a whole, since a copy in double precision is kept."""
        return self._tensors

    @tensors.setter
    def tensors(self, weights: Weights | None) -> None:
        self._tensors, self._double = weights, None

    @property
    def objective(self) -> Objective:
        """Training objective of the first stage."""
        return Irm(self.penalty) if self.penalty else Erm()

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres.

        Raises:
            PredictorError: there are no weights, or a scene does not have two agents.
        """
        history, weights = self._in_double(observation)
        with torch.no_grad():
            moves = pair_network.forecast(history, self._codes(weights), weights)
        return pair_network.to_forecast(observation, moves)

    def offsets(self, observation: Observation, weights: Weights, seed: int = 0, shown: Truth | None = None) -> Tensor:
        """Offsets [M, A, 12, 2] from the last position, metres, for weights [M, ...]; see ``last_layer.Tunable``."""
        self._ready(observation)
        history = torch.tensor(pair_network.pair_positions(observation), dtype=torch.float32).flatten(1)
        moves = pair_network.forecast(history, self._codes(weights, shown), weights)
        return moves.view(len(moves), -1, FUTURE, 2).cumsum(dim=2)

    def last_layer(self, observation: Observation, seed: int = 0) -> LastLayer:
        """The last layer, from each scene to the displacements of both agents; see ``last_layer.LastLayer``."""
        history, weights = self._in_double(observation)
        with torch.no_grad():
            codes = self._codes(weights)
            latent = pair_network.encode(history, codes, weights)
            inputs = pair_network.last_hidden(latent, codes, weights)[0].numpy()
        weight = np.concatenate([weights["decoder.weight4"][0].numpy(), weights["decoder.bias4"].numpy()])
        return LastLayer(with_bias_input(inputs), weight, observation.xy[:, -1:].astype(np.float64))

    def _codes(self, weights: Weights, shown: Truth | None = None) -> Tensor | None:
        """Style code [1, 1, 8] of the observed scenes, or [M, 1, 8] of ``shown``; None for networks without a style."""
        return None

    def _in_double(self, observation: Observation) -> tuple[Tensor, Weights]:
        """Histories [S, 32] and weights in double precision: absolute positions can be too large for float32."""
        tensors = self._ready(observation)
        if self._double is None:
            self._double = {name: value.double() for name, value in tensors.items()}
        history = torch.tensor(pair_network.pair_positions(observation), dtype=torch.float64).flatten(1)
        return history, self._double


@dataclass(eq=False, repr=False)
class Modular(StyleMemory, StyleErm):
    """The paper's modular network: a scene encoder, a style encoder, and a modulator that combines them.

    The style of a domain is a running average of the codes of scenes that are observed over all 20 steps. It starts at
    the mean code of the training scenes, which counts as one scene. ``reset`` restores this start. The alias
    ``modular_invariant`` trains the scene encoder with IRMv1, lambda 1 (the paper's full method).

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        penalty: See ``StyleErm``.
    """

    kind: ClassVar[str] = "modular"
    epochs: ClassVar[tuple[int, ...]] = (100, 50, 20, 300)
    expected: ClassVar[dict[str, tuple[int, ...]]] = {
        **pair_network.shapes(LAYERS),
        "prior.code": (CODE,),
        "prior.dt": (1,),
    }
    transfer: ClassVar[type[TransferProgram]] = TransferProgram
    """Training program of the predictor ``transfer``."""
    # Forecasts do not depend on the projection head.
    parts: ClassVar[Mapping[str, tuple[str, ...]]] = {
        name: tuple(prefix for prefix in prefixes if prefix != "head") for name, prefixes in PARTS.items()
    }

    def scene_codes(self, truth: Truth, weights: Weights) -> Tensor:
        """Style codes [M, S, 8]; PredictorError if a scene does not have two agents."""
        return pair_network.code(Pairs.of(truth).path, weights)

    def latent(self, observation: Observation, seed: int = 0) -> Tensor:
        """Latent [1, S, 16] of each scene after the first modulation."""
        history, weights = self._in_double(observation)
        return pair_network.encode(history, self._codes(weights), weights)

    def from_latent(self, observation: Observation, latent: Tensor, seed: int = 0) -> Tensor:
        """Displacements [1, S, 48], metres."""
        _, weights = self._in_double(observation)
        return pair_network.decode(latent, self._codes(weights), weights)

    def embedded(self, observation: Observation, moves: Tensor) -> Tensor:
        """Style embeddings [1, S, 8] of scenes with future displacements [1, S, 48]."""
        flat, weights = self._in_double(observation)
        history = flat.view(-1, AGENTS, HISTORY, 2)
        future = history[:, :, -1:] + moves.view(-1, AGENTS, FUTURE, 2).cumsum(dim=2)
        path = torch.cat([history, future], dim=2)
        return pair_network.embed(pair_network.code((path[:, 1] - path[:, 0]).flatten(1), weights), weights)
