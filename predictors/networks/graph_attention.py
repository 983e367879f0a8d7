"""Graph attention among the agents of each scene, for ragged scenes and several models at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from motion_gym.predictors.networks.kernels import attend, normalise


@dataclass(frozen=True)
class Layout:
    """Where the scenes are among the agents.

    Attributes:
        scene: [A] int64, scene of each agent.
        scenes: Number of scenes S.
        limits: [S + 1] int64; scene s has the agents limits[s] to limits[s + 1].
    """

    scene: Tensor
    scenes: int
    limits: Tensor

    @classmethod
    def of(cls, scene: np.ndarray, device: torch.device | str = "cpu") -> Layout:
        """From the limits [S + 1] of an Observation's scenes."""
        limits = torch.tensor(scene, dtype=torch.int64, device=device)
        scenes = len(limits) - 1
        return cls(torch.repeat_interleave(torch.arange(scenes, device=device), limits.diff()), scenes, limits)


def graph_attention(x: Tensor, layout: Layout, weights: dict[str, Tensor]) -> Tensor:
    """The two layers of the released program: [T, M, A, 32] to [T, M, A, 32]."""
    return attention_layer(
        attention_layer(x, layout, weights, "attention1", True), layout, weights, "attention2", False
    )


def attention_layer(x: Tensor, layout: Layout, weights: dict[str, Tensor], name: str, rectify: bool) -> Tensor:
    """One layer: normalise over the agents of a scene, then attend.

    Args:
        x: [T, M, A, C] features.
        layout: The scenes.
        weights: ``w`` [M, heads, C, F], ``source`` and ``target`` [M, heads, F], ``bias`` [M, F] under the name.
        name: Of the layer.
        rectify: Whether it ends with an exponential linear unit.

    Returns:
        [T, M, A, heads * F].
    """
    w, bias = weights[f"{name}.w"], weights[f"{name}.bias"]
    # Values and both parts of the logits come out of one product.
    parts = [w.transpose(1, 2).flatten(2)]
    parts += [torch.einsum("mhcf,mhf->mch", w, weights[f"{name}.{side}"]) for side in ("source", "target")]
    projected = normalise(x, layout.scene, layout.limits) @ torch.cat(parts, dim=-1)
    return attend(projected, bias, layout.limits, rectify)
