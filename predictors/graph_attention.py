"""Graph attention among the agents of each scene, for ragged scenes and several models at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import elu, leaky_relu

SLOPE = 0.2
"""Of the leaky rectifier in the attention logits."""
EPSILON = 1e-5
"""Added to the variance before its root, in the normalisation over a scene's agents."""


@dataclass(frozen=True)
class Layout:
    """Where the agents of ragged scenes lie in an array padded to the largest scene.

    Attributes:
        row: [S, n] int64, row of each place in the stacked agents; 0 where there is nobody.
        mask: [S, n, 1] float32, 1 where there is somebody.
        place: [A] int64, place of each agent in the flattened [S * n].
        scene: [A] int64, scene of each agent.
        closed: [S, 1, 1, n] float32, minus infinity where there is nobody, else 0.
    """

    row: Tensor
    mask: Tensor
    place: Tensor
    scene: Tensor
    closed: Tensor

    @classmethod
    def of(cls, scene: np.ndarray, device: torch.device | str = "cpu") -> Layout:
        """Lay out scenes given as in an Observation: [S + 1] limits."""
        sizes = np.diff(scene)
        there = np.arange(max(int(sizes.max(initial=0)), 1)) < sizes[:, None]
        row = np.where(there, scene[:-1, None] + np.arange(there.shape[1]), 0)
        closed = np.where(there, 0.0, -np.inf).astype(np.float32)
        arrays = (
            row,
            there[..., None].astype(np.float32),
            np.flatnonzero(there),
            np.repeat(np.arange(len(sizes)), sizes),
            closed[:, None, None],
        )
        return cls(*(torch.as_tensor(a, device=device) for a in arrays))

    def pad(self, rows: Tensor) -> Tensor:
        """[..., A, C] to [..., S, n, C]; what stands where there is nobody is of no account."""
        padded = rows.index_select(-2, self.row.reshape(-1))
        return padded.reshape(*rows.shape[:-2], *self.row.shape, rows.shape[-1])

    def unpad(self, padded: Tensor) -> Tensor:
        """[..., S, n, C] to [..., A, C]."""
        return padded.flatten(-3, -2).index_select(-2, self.place)


class Attend(torch.autograd.Function):
    """Softmax over j of leaky_relu(source_i + target_j), times the values of j; keeps only the weights."""

    @staticmethod
    def forward(ctx: Any, source: Tensor, target: Tensor, values: Tensor, closed: Tensor) -> Tensor:
        """Attend.

        Args:
            ctx: Of autograd.
            source: [..., n] logit part of i.
            target: [..., n] logit part of j.
            values: [..., n, F] values of j.
            closed: Minus infinity where there is nobody, broadcast over the logits [..., n, n].

        Returns:
            [..., n, F].
        """
        logits = source[..., :, None] + target[..., None, :]
        leaky_relu(logits, SLOPE, inplace=True)
        logits += closed
        weights = torch.softmax(logits, dim=-1)
        ctx.save_for_backward(source, target, values, weights)
        return torch.matmul(weights, values)

    @staticmethod
    def backward(ctx: Any, d_out: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:  # type: ignore[override]
        """Gradients of source, target and values."""
        source, target, values, weights = ctx.saved_tensors
        d_values = torch.matmul(weights.transpose(-1, -2), d_out)
        d_logits = torch.matmul(d_out, values.transpose(-1, -2))
        d_logits *= weights
        d_logits.addcmul_(weights, d_logits.sum(dim=-1, keepdim=True), value=-1)
        negative = source[..., :, None] < -target[..., None, :]
        d_logits.mul_(torch.where(negative, SLOPE, 1.0))
        return d_logits.sum(dim=-1), d_logits.sum(dim=-2), d_values, None


def attention_layer(x: Tensor, layout: Layout, weights: dict[str, Tensor], prefix: str) -> Tensor:
    """One layer: normalise over the agents of a scene, then attend.

    Args:
        x: [T, M, S, n, C] padded features.
        layout: The scenes.
        weights: ``w`` [M, heads, C, F], ``source`` and ``target`` [M, heads, F], ``bias`` [M, F] under ``prefix``.
        prefix: Name of the layer.

    Returns:
        [T, M, S, n, heads * F].
    """
    w = weights[f"{prefix}.w"]
    models, heads, channels, out = w.shape
    count = layout.mask.sum(dim=-2, keepdim=True).clamp(min=1)
    off = (x - (x * layout.mask).sum(dim=-2, keepdim=True) / count) * layout.mask
    x = off * torch.rsqrt((off * off).sum(dim=-2, keepdim=True) / count + EPSILON)
    flat = w.transpose(1, 2).reshape(models, 1, channels, heads * out)
    values = torch.matmul(x, flat).unflatten(-1, (heads, out)).transpose(-2, -3)
    source, target = (
        torch.einsum("tmshnf,mhf->tmshn", values, weights[f"{prefix}.{side}"]) for side in ("source", "target")
    )
    attended = Attend.apply(source, target, values, layout.closed) + weights[f"{prefix}.bias"][:, None, None, None]
    return attended.transpose(-2, -3).flatten(-2)


def graph_attention(x: Tensor, layout: Layout, weights: dict[str, Tensor]) -> Tensor:
    """The two layers of the released program: [T, M, A, 32] to [T, M, A, 32]."""
    padded = elu(attention_layer(layout.pad(x), layout, weights, "attention1"))
    return layout.unpad(attention_layer(padded, layout, weights, "attention2"))
