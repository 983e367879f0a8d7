"""Graph attention among the agents of each scene, for scenes of any size and several models at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from motion_gym.predictors.networks.kernels import attend, normalise


@dataclass(frozen=True)
class Layout:
    """The scenes of a batch of agents.

    Attributes:
        scene: [A] int64, scene of each agent.
        limits: [S + 1] int64; scene s has the agents limits[s] to limits[s + 1].
    """

    scene: Tensor
    limits: Tensor

    @classmethod
    def of(cls, scene: np.ndarray, device: torch.device | str = "cpu") -> Layout:
        """The layout for the field ``scene`` [S + 1] of an Observation."""
        limits = torch.tensor(scene, dtype=torch.int64, device=device)
        return cls(torch.repeat_interleave(torch.arange(len(limits) - 1, device=device), limits.diff()), limits)


def graph_attention(x: Tensor, layout: Layout, weights: dict[str, Tensor]) -> Tensor:
    """The two layers of the released program: [T, M, A, 32] to [T, M, A, 32]."""
    hidden = attention_layer(x, layout, weights, "attention1", True)
    return attention_layer(hidden, layout, weights, "attention2", False)


def attention_layer(x: Tensor, layout: Layout, weights: dict[str, Tensor], name: str, rectify: bool) -> Tensor:
    """One layer: normalisation over the agents of a scene, then attention.

    Args:
        x: [T, M, A, C] features.
        layout: The scenes.
        weights: Weights with the prefix ``name``: ``w`` [M, heads, C, F], ``source`` and ``target`` [M, heads, F],
            ``bias`` [M, F].
        name: Name of the layer.
        rectify: Whether to apply an exponential linear unit to the output.

    Returns:
        [T, M, A, heads * F].
    """
    w, bias = weights[f"{name}.w"], weights[f"{name}.bias"]
    # One matrix product computes the values and both parts of the logits.
    parts = [w.transpose(1, 2).flatten(2)]
    parts += [torch.einsum("mhcf,mhf->mch", w, weights[f"{name}.{side}"]) for side in ("source", "target")]
    projected = normalise(x, layout.scene, layout.limits) @ torch.cat(parts, dim=-1)
    return attend(projected, bias, layout.limits, rectify)
