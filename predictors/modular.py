"""The paper's predictors for style shifts: the two-agent network with and without a style, plainly and invariantly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, Forecast, Observation, Truth
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.last_layer import LastLayer, with_one
from motion_gym.predictors.networks.pair_network import AGENTS, CODE, Pairs
from motion_gym.predictors.settings import number, setting
from motion_gym.predictors.style_memory import StyleMemory
from motion_gym.predictors.training.objectives import Erm, Irm, Objective
from motion_gym.predictors.training.style_training import PLAIN, StyleProgram
from motion_gym.predictors.training.transfer_training import PARTS
from motion_gym.predictors.weighted import Weighted
from motion_gym.training.program import Weights


@dataclass(eq=False, repr=False)
class StyleErm(Weighted):
    """The paper's two-agent network for style shifts, without a style, trained by empirical risk minimisation.

    Takes scenes of exactly two agents, in a fixed order, and their positions as they are. Deterministic.
    ``style_invariant`` is the one that is trained with IRMv1, lambda 1 (the paper's invariant row).

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        penalty: Factor lambda of IRMv1 in the first stage; 0 for empirical risk minimisation.
    """

    penalty: float = setting(0.0, number)
    kind: ClassVar[str] = "style_erm"
    shipped: ClassVar[str] = "style"
    agents_per_scene: ClassVar[int] = AGENTS
    """Scenes of another number of agents cannot be forecast or learned from."""
    program: ClassVar[type[StyleProgram]] = StyleProgram
    epochs: ClassVar[tuple[int, ...]] = (100,)
    """Of the stages, as in the released program."""
    expected: ClassVar[dict[str, tuple[int, ...]]] = pair_network.shapes(PLAIN)  # type: ignore[misc]
    """Shape of every weight."""
    parts: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "all": ("encoder", "decoder"),
        "last_layer": PARTS["last_layer"],
    }
    """What can be tuned: names, or beginnings of names, of weights; see ``last_layer.Tunable``."""

    @property
    def tensors(self) -> Weights | None:  # type: ignore[override]
        """Weights [1, ...] of the seed; replaced as a whole, since a copy in double precision is kept."""
        return self._tensors

    @tensors.setter
    def tensors(self, weights: Weights | None) -> None:
        self._tensors = weights
        self._double: Weights | None = None

    @property
    def objective(self) -> Objective:
        """What the first stage minimises."""
        return Irm(self.penalty) if self.penalty else Erm()

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres.

        Raises:
            PredictorError: there are no weights, or a scene has not two agents.
        """
        weights = self._exact(observation)
        with torch.no_grad():
            moves = pair_network.forecast(pair_network.exact(observation).flatten(1), self._codes(weights), weights)
        return pair_network.walked(observation, moves)

    def offsets(self, observation: Observation, weights: Weights, seed: int = 0, shown: Truth | None = None) -> Tensor:
        """Offsets [M, A, 12, 2] from the last position, metres, by weights [M, ...]; see ``last_layer.Tunable``."""
        self._ready(observation)
        history = torch.tensor(pair_network.paired(observation), dtype=torch.float32).flatten(1)
        moves = pair_network.forecast(history, self._codes(weights, shown), weights)
        return moves.view(len(moves), -1, FUTURE, 2).cumsum(dim=2)

    def last_layer(self, observation: Observation, seed: int = 0) -> LastLayer:
        """The last layer: of each scene, to the displacements of both agents; see ``last_layer.LastLayer``."""
        weights = self._exact(observation)
        with torch.no_grad():
            history = pair_network.exact(observation).flatten(1)
            codes = self._codes(weights)
            latent = pair_network.latent_of(history, codes, weights)
            inputs = pair_network.before_last(latent, codes, weights)[0].numpy()
        weight = np.concatenate([weights["decoder.weight4"][0].numpy(), weights["decoder.bias4"].numpy()])
        return LastLayer(with_one(inputs), weight, observation.xy[:, -1:].astype(np.float64))

    def _codes(self, weights: Weights, shown: Truth | None = None) -> Tensor | None:
        """Style code [1, 1, 8] to forecast with: as observed, or [M, 1, 8] of scenes that are shown."""
        return None

    def _exact(self, observation: Observation) -> Weights:
        """The weights in double precision, as ``pair_network.exact`` has the histories."""
        weights = self._ready(observation)
        if self._double is None:
            self._double = {name: value.double() for name, value in weights.items()}
        return self._double


@dataclass(eq=False, repr=False)
class Modular(StyleMemory, StyleErm):
    """The paper's modular network: an encoder of the scene, one of the style, and a modulator that joins them.

    The style of a domain is read from scenes that it observes over all 20 steps: a running average of their codes. It
    begins at the mean code of the training scenes, which counts for one scene. ``reset`` goes back there.
    ``modular_invariant`` is the one whose scene encoder is trained with IRMv1, lambda 1 (the paper's full method).

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        penalty: See ``StyleErm``.
    """

    kind: ClassVar[str] = "modular"
    epochs: ClassVar[tuple[int, ...]] = (100, 50, 20, 300)
    expected: ClassVar[dict[str, tuple[int, ...]]] = {
        **pair_network.shapes(),
        "prior.code": (CODE,),
        "prior.dt": (1,),
    }
    # The projection head is of no account to a forecast.
    parts: ClassVar[Mapping[str, tuple[str, ...]]] = {
        name: tuple(part for part in chosen if part != "head") for name, chosen in PARTS.items()
    }

    def scene_codes(self, truth: Truth, weights: Weights) -> Tensor:
        """Style codes [M, S, 8]; PredictorError if a scene has not two agents."""
        return pair_network.code(Pairs.of(truth).path, weights)

    def latent(self, observation: Observation, seed: int = 0) -> Tensor:
        """Latent [1, S, 16] of each scene after the first modulation."""
        weights = self._exact(observation)
        history = pair_network.exact(observation).flatten(1)
        return pair_network.latent_of(history, self._codes(weights), weights)

    def from_latent(self, observation: Observation, latent: Tensor, seed: int = 0) -> Tensor:
        """Displacements [1, S, 48], metres."""
        weights = self._exact(observation)
        return pair_network.decode(latent, self._codes(weights), weights)

    def embedded(self, observation: Observation, moves: Tensor) -> Tensor:
        """Style embeddings [1, S, 8] of scenes that go on by displacements [1, S, 48]."""
        weights = self._exact(observation)
        history = pair_network.exact(observation)
        steps = moves.view(-1, AGENTS, FUTURE, 2)
        future = history[:, :, -1:] + steps.cumsum(dim=2)
        whole = torch.cat([history, future], dim=2)
        return pair_network.embed(pair_network.code((whole[:, 1] - whole[:, 0]).flatten(1), weights), weights)
