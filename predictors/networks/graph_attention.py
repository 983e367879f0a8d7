"""Graph attention among the agents of each scene, for ragged scenes and several models at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import elu, leaky_relu

from motion_gym.predictors.networks import kernels, threads

PAIRS_AT_ONCE = 15_000
"""Most pairs of agents of a block, padding included."""


@dataclass(frozen=True)
class Block:
    """Scenes of like size, to be padded to the largest.

    Attributes:
        first: [S] first agent of each.
        size: [S] number of its agents, at least 1.
        most: The largest of these.
    """

    first: np.ndarray
    size: np.ndarray
    most: int


@dataclass(frozen=True)
class Layout:
    """Where the scenes are among the agents.

    Attributes:
        scene: [A] int64, scene of each agent.
        scenes: Number of scenes S.
        limits: [S + 1] int64; scene s has the agents limits[s] to limits[s + 1].
        blocks: Scenes of like size that kernels work on together, ascending.
    """

    scene: Tensor
    scenes: int
    limits: Tensor
    blocks: tuple[Block, ...]

    @classmethod
    def of(cls, scene: np.ndarray, device: torch.device | str = "cpu") -> Layout:
        """Lay out scenes given as in an Observation: [S + 1] limits."""
        limits = torch.tensor(scene, dtype=torch.int64, device=device)
        scenes, sizes = len(limits) - 1, np.diff(scene)
        of_agent = torch.repeat_interleave(torch.arange(scenes, device=device), limits.diff())
        by_size = np.argsort(sizes, kind="stable")
        groups = _groups(sizes[by_size])
        blocks = [Block(scene[:-1][by_size[g]], sizes[by_size[g]], int(sizes[by_size[g]].max())) for g in groups]
        return cls(of_agent, scenes, limits, tuple(blocks))


def _groups(sizes: np.ndarray) -> list[slice]:
    """Cut ascending sizes, zeros left out, into runs in which little is padded and that are not too large."""
    groups, first = [], int((sizes == 0).sum())
    for last in range(first + 1, len(sizes) + 1):
        if last < len(sizes):
            padded = (last + 1 - first) * int(sizes[last]) ** 2
            if padded <= PAIRS_AT_ONCE and padded <= 1.3 * (sizes[first : last + 1].astype(np.int64) ** 2).sum() + 300:
                continue
        groups.append(slice(first, last))
        first = last
    return groups


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
    joined = torch.cat(parts, dim=-1)
    return (Layer.apply if kernels.serve(x) else plain_layer)(x, joined, bias, layout, rectify)


def plain_layer(x: Tensor, joined: Tensor, bias: Tensor, layout: Layout, rectify: bool) -> Tensor:
    """``Layer`` by plain operations of torch, with every scene padded to the largest."""
    limits = layout.limits
    sizes = limits.diff()[:, None]
    place = torch.arange(int(sizes.max()) if len(sizes) else 0, device=x.device)
    there = place < sizes
    x = x[:, :, torch.where(there, limits[:-1, None] + place, 0)] * there[..., None]
    share = 1 / sizes.clamp(min=1)[..., None]
    y = (x - x.sum(dim=-2, keepdim=True) * share) * there[..., None]
    y = y / ((y * y).sum(dim=-2, keepdim=True) * share + kernels.EPSILON).sqrt()
    features = bias.shape[-1]
    heads = joined.shape[-1] // (features + 2)
    made = y @ joined[:, None]
    values, source, target = made.split([heads * features, heads, heads], dim=-1)
    logits = leaky_relu(source[..., :, None, :] + target[..., None, :, :], kernels.SLOPE)
    logits = logits.masked_fill(~there[:, None, :, None], torch.finfo(x.dtype).min)
    attended = torch.einsum("...ijh,...jhf->...ihf", logits.softmax(dim=-2), values.unflatten(-1, (heads, features)))
    out = (attended + bias[:, None, None, None]).flatten(-2)[:, :, there]
    return elu(out) if rectify else out


class Layer(torch.autograd.Function):
    """A layer by kernels."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, joined: Tensor, bias: Tensor, layout: Layout, rectify: bool) -> Tensor:
        """Normalise and attend.

        Args:
            ctx: Of autograd.
            x: [T, M, A, C] features.
            joined: [M, C, heads * F + 2 * heads], from features to values, sources and targets.
            bias: [M, F].
            layout: The scenes.
            rectify: Whether to end with an exponential linear unit.

        Returns:
            [T, M, A, heads * F].
        """
        steps, models, agents, channels = x.shape
        features = bias.shape[1]
        heads = joined.shape[2] // (features + 2)
        x, limits = x.contiguous(), layout.limits.numpy()
        y = torch.empty_like(x)
        scale = x.new_empty(steps, models, layout.scenes, channels)
        made = x.new_empty(steps, models, agents, joined.shape[2])
        out = x.new_empty(steps, models, agents, heads * features)
        every = bias.detach().repeat(steps, 1).numpy()

        def project(part: slice) -> None:
            flat = [a[part].flatten(0, 1).numpy() for a in (x, y, scale)]
            kernels.normalise(flat[0], limits, flat[1], flat[2])
            for t in range(part.start, part.stop):
                torch.bmm(y[t], joined, out=made[t])

        def attend(job: tuple[Block, slice]) -> None:
            block, part = job
            values, weights = _weighed(made, block, part, heads, features)
            found = torch.bmm(weights.flatten(0, 2), values.flatten(0, 2)).view(values.shape)
            kernels.spread(found.numpy(), block.first, block.size, every[part], rectify, _flat(out)[part])

        threads.side_by_side(project, threads.slices(steps, models * agents * joined.shape[2]))
        threads.side_by_side(attend, _jobs(layout.blocks, steps * models, heads))
        if any(ctx.needs_input_grad):
            ctx.save_for_backward(joined, y, scale, made, out)
            ctx.layout, ctx.rectify, ctx.features = layout, rectify, features
        return out

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_out: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:  # type: ignore[override]
        """Gradients of x, joined and bias."""
        joined, y, scale, made, out = ctx.saved_tensors
        joined, layout, features, rectify = joined.detach(), ctx.layout, ctx.features, ctx.rectify
        steps, models, agents, width = made.shape
        heads, limits = width // (features + 2), layout.limits.numpy()
        d_out = d_out.contiguous()
        d_x, d_made = torch.empty_like(y), torch.empty_like(made)

        def attend(job: tuple[Block, slice]) -> np.ndarray:
            block, part = job
            values, weights = _weighed(made, block, part, heads, features)
            d_found, d_bias = torch.empty_like(values), np.zeros((steps * models, features), np.float32)
            given = _flat(d_out)[part], _flat(out)[part]
            kernels.spread_backward(*given, block.first, block.size, rectify, d_found.numpy(), d_bias[part])
            flat = weights.flatten(0, 2), values.flatten(0, 2), d_found.flatten(0, 2)
            d_weights = torch.bmm(flat[2], flat[1].transpose(1, 2)).view(weights.shape)
            d_values = torch.bmm(flat[0].transpose(1, 2), flat[2]).view(values.shape)
            arrays = (a.numpy() for a in (weights, d_weights, d_values))
            kernels.weigh_backward(_flat(made)[part], block.first, block.size, *arrays, _flat(d_made)[part])
            return d_bias

        def project(part: slice) -> Tensor:
            d_joined = torch.zeros_like(joined)
            for t in range(part.start, part.stop):
                d_joined.baddbmm_(y[t].transpose(1, 2), d_made[t])
                torch.bmm(d_made[t], joined.transpose(1, 2), out=d_x[t])
            flat = [a[part].flatten(0, 1).numpy() for a in (y, scale, d_x)]
            kernels.normalise_backward(flat[0], limits, flat[1], flat[2])
            return d_joined

        d_bias = sum(threads.side_by_side(attend, _jobs(layout.blocks, steps * models, heads)), np.zeros(1, np.float32))
        d_joined = sum(threads.side_by_side(project, threads.slices(steps, models * agents * width)))
        by_model = torch.from_numpy(np.broadcast_to(d_bias, (steps * models, features)).copy())
        return d_x, d_joined, by_model.view(steps, models, features).sum(dim=0), None, None  # type: ignore[return-value]


def _weighed(made: Tensor, block: Block, part: slice, heads: int, features: int) -> tuple[Tensor, Tensor]:
    """Padded values [B, S, heads, n, F] and weights [B, S, heads, n, n] of a block, for a part of steps and models."""
    shape = part.stop - part.start, len(block.first), heads, block.most
    values, weights = made.new_empty(*shape, features), made.new_empty(*shape, block.most)
    kernels.weigh(_flat(made)[part], block.first, block.size, values.numpy(), weights.numpy())
    return values, weights


def _flat(x: Tensor) -> np.ndarray:
    """[T, M, A, C] as an array [T M, A, C]."""
    return x.flatten(0, 1).numpy()


def _jobs(blocks: tuple[Block, ...], batch: int, heads: int) -> list[tuple[Block, slice]]:
    """Blocks and parts of the steps and models whose weights stay in the cache."""
    found = []
    for block in blocks:
        pairs = len(block.first) * block.most**2 * heads
        found += [(block, part) for part in threads.slices(batch, pairs)]
    return found
