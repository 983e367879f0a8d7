"""STGAT with a style: the paper's modular idea for scenes of any number of agents."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, HISTORY, Observation, Truth
from motion_gym.predictors.networks import pair_network, stgat_network, stgat_style
from motion_gym.predictors.networks.graph_attention import Layout
from motion_gym.predictors.networks.neighbour_pairs import NeighbourPairs, whole_paths
from motion_gym.predictors.networks.pair_network import CODE
from motion_gym.predictors.networks.sigma import check_sigma
from motion_gym.predictors.networks.stgat_network import Draws
from motion_gym.predictors.settings import setting
from motion_gym.predictors.stgat_predictor import PARTS, Stgat
from motion_gym.predictors.style_memory import StyleMemory
from motion_gym.predictors.training.modular_stgat_training import StyledStgatProgram
from motion_gym.predictors.training.stgat_training import StgatProgram
from motion_gym.training.program import Weights


@dataclass(eq=False, repr=False)
class ModularStgat(StyleMemory, Stgat):
    """STGAT with a style that modulates the latent, z' = f(z, c) + z, for any number and order of agents.

    The style of a scene is the mean code of its pairs of neighbours over all 20 steps; scenes of one agent have no
    style. The style of a domain is a running average over the observed scenes. It starts at the mean code of the
    training scenes, which counts as one scene, and ``reset`` restores this start.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        sigma: See ``Stgat``.
    """

    sigma: bool | str = setting(False, check_sigma)
    kind: ClassVar[str] = "modular_stgat"
    sets: ClassVar[tuple[str, ...]] = ("style/crowd",)
    program: ClassVar[type[StgatProgram]] = StyledStgatProgram
    # psi, f and g of the paper are the style encoder, the modulator and the decoder.
    parts: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "all": (*PARTS["all"], "style", "modulator"),
        "style": ("decoder", "stage3", "style", "modulator"),
        "modulator": ("modulator",),
        "last_layer": PARTS["last_layer"],
    }

    @property
    def expected(self) -> dict[str, tuple[int, ...]]:
        """Shape of every weight, without the model axis."""
        return {**super().expected, **stgat_style.shapes(), "prior.code": (CODE,), "prior.dt": (1,)}

    def scene_codes(self, truth: Truth, weights: Weights) -> Tensor:
        """Style codes [M, S, 8] of scenes of at least two agents."""
        pairs = NeighbourPairs.of(truth)
        scene = torch.from_numpy(pairs.scene)
        return stgat_style.scene_codes(pairs.paths(whole_paths(truth)), scene, truth.observation.scenes, weights)

    def latent(self, observation: Observation, seed: int = 0) -> Tensor:
        """Modulated latent [1, A, 64] of each agent."""
        return self._latent(*self._network_inputs(observation, 1, seed), self._ready(observation))

    def from_latent(self, observation: Observation, latent: Tensor, seed: int = 0) -> Tensor:
        """Displacements [1, A, 24], metres."""
        steps, draws, _ = self._network_inputs(observation, 1, seed)
        moves = stgat_network.decode(latent, steps[-1, :, :2], draws.noise, self._ready(observation))
        return moves.permute(1, 2, 0, 3).flatten(2)

    def embedded(self, observation: Observation, moves: Tensor) -> Tensor:
        """Style embeddings [1, S, 8] of scenes with future displacements [1, A, 24]."""
        weights = self._ready(observation)
        history = torch.tensor(observation.xy)
        path = torch.cat([history, history[:, -1:] + moves.float().view(-1, FUTURE, 2).cumsum(dim=1)], dim=1)
        future = path[:, HISTORY:].detach().numpy()
        pairs = NeighbourPairs.of(Truth(future, np.ones(future.shape[:2], bool), observation))
        codes = stgat_style.scene_codes(pairs.paths(path), torch.from_numpy(pairs.scene), observation.scenes, weights)
        return pair_network.embed(codes, weights)

    def _latent(
        self, steps: Tensor, draws: Draws, layout: Layout, weights: Weights, shown: Truth | None = None
    ) -> Tensor:
        latent = stgat_network.encode(steps, draws, layout, weights)
        return stgat_style.modulate(latent, self._codes(weights, shown), weights)
