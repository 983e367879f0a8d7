"""Online fine-tuning: gradient steps on new ground truth and on remembered scenes."""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, Truth
from motion_gym.data.windows import pick_scenes, stack
from motion_gym.predictors.adapters.adapter import Adapter, SceneKey, scene_key
from motion_gym.predictors.networks.last_layer import tunable
from motion_gym.predictors.settings import any_text, one_of, positive, setting, share, whole

OPTIMISERS = {"adam": torch.optim.Adam, "sgd": torch.optim.SGD}
MOST_RATE = 1e30
"""A larger rate is as wrong, and would overflow inside the optimiser."""


@dataclass(eq=False, repr=False, kw_only=True)
class Finetune(Adapter):
    """Tunes weights by gradient steps on revealed truth, with a replay of the last scenes.

    What is minimised is the mean distance of the forecast positions from the true ones over all points that are known,
    metres: censored forecasts, and labels that come step by step, count as far as they go. A scene that is told again
    with more of its steps known replaces the remembered one. Where the style encoder is tuned, the style of a
    step is the mean code of its own scenes, unless a style is never read.

    Args:
        of: See ``Around``; a predictor of the STGAT or modular family.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        parts: What is tuned: ``all``; ``style``, all but the scene encoder (psi, f and g of the paper); ``modulator``,
            f alone; ``last_layer``.
        rate: Learning rate.
        optimiser: ``adam`` or ``sgd``.
        every: Scenes that must have come before the next update.
        steps: Gradient steps of an update.
        batch: Scenes of a step: those that have come, and as many of the remembered ones, drawn at random.
        buffer: Scenes that are remembered.
        least: Future steps of which an agent of a scene must be known for the scene to be learned from, 1 to 12. Fewer
            than 12 let it learn from people who left, and from labels that come step by step.
        anchor: Share of the way back to the trained weights that is taken after each step, against forgetting. The
            alias ``ema_anchor`` has 0.01.

    Raises:
        SpecError: an argument is not known or not allowed.
        PredictorError: the predictor cannot be tuned, or has no such part.
    """

    parts: str = setting("all", any_text)
    rate: float = setting(1e-4, positive)
    optimiser: str = setting("adam", one_of(OPTIMISERS))
    every: int = setting(1, whole(1, 10**6))
    steps: int = setting(1, whole(1, 10**4))
    batch: int = setting(16, whole(1, 10**5))
    buffer: int = setting(128, whole(1, 10**5))
    least: int = setting(FUTURE, whole(1, FUTURE))
    anchor: float = setting(0.0, share)
    kind: ClassVar[str] = "finetune"

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        super().__post_init__(of, weights, seed)
        self.tuned = tunable(self.inner, self.parts)

    def _start(self) -> None:
        super()._start()
        self.recent: OrderedDict[SceneKey, Truth] = OrderedDict()
        """Scenes that are remembered, by ``scene_key``."""
        self.waiting = 0
        """Scenes that have come since the last update."""
        self.state: dict[str, Any] = {}
        """Of the optimiser."""

    def learn(self, truth: Truth) -> None:
        """Remember the scenes, and take gradient steps if enough have come."""
        for scene in range(truth.observation.scenes):
            one = pick_scenes(truth, [scene])
            if one.known.sum(axis=1).max() >= self.least:
                key = scene_key(one, 0)
                self.waiting += key not in self.recent
                self.recent[key] = one
                self.recent.move_to_end(key)
        while len(self.recent) > self.buffer:
            self.recent.popitem(last=False)
        if self.waiting >= self.every and self.recent:
            self._update()
            self.waiting = 0

    def _update(self) -> None:
        begun = self.inner.tensors
        free = {name: begun[name].detach().clone().requires_grad_() for name in self.tuned}
        optimiser = OPTIMISERS[self.optimiser](list(free.values()), lr=min(self.rate, MOST_RATE))
        if self.state:
            optimiser.load_state_dict(copy.deepcopy(self.state))  # which it would change, even if that is taken back
        rng = np.random.default_rng([self.updates, self.rolled_back])
        self.updates += 1
        with torch.enable_grad():
            for _ in range(self.steps):
                loss = self.loss(self._batch(rng), {**begun, **free})
                gradients = torch.autograd.grad(loss, list(free.values()), allow_unused=True)
                for tensor, gradient in zip(free.values(), gradients, strict=True):
                    tensor.grad = torch.zeros_like(tensor) if gradient is None else gradient
                optimiser.step()
                if self.anchor:
                    with torch.no_grad():
                        for name, tensor in free.items():
                            tensor.lerp_(self._begun.tensors[name], self.anchor)
        learned = {**begun, **{name: tensor.detach() for name, tensor in free.items()}}
        if self._usable(learned):
            self.inner.tensors = learned
            self.state = optimiser.state_dict()
        else:
            self.rolled_back += 1

    def _usable(self, weights: dict[str, Tensor]) -> bool:
        """Whether weights, and the forecasts of the last scene by them, are finite."""
        if not all(bool(torch.isfinite(weights[name]).all()) for name in self.tuned):
            return False
        with torch.no_grad():
            return bool(torch.isfinite(self.loss(next(reversed(self.recent.values())), weights)))

    def _batch(self, rng: np.random.Generator) -> Truth:
        """The scenes that have come, and as many remembered ones as a batch has room for."""
        scenes: Sequence[Truth] = list(self.recent.values())
        new = min(self.waiting, self.batch, len(scenes))
        older = len(scenes) - new
        drawn = rng.choice(older, min(self.batch - new, older), replace=False)
        return stack([*(scenes[i] for i in np.sort(drawn)), *scenes[older:]])

    def loss(self, truth: Truth, weights: dict[str, Tensor]) -> Tensor:
        """Mean distance over all known points, metres, by weights [1, ...]."""
        shown = None
        if self.memory and "style" in self.inner.parts.get(self.parts, ()):
            shown = self.inner.whole_scenes(truth)
        offsets = self.inner.offsets(truth.observation, weights, 0, shown)[0]
        target = torch.from_numpy(truth.future - truth.observation.xy[:, -1:])
        known = torch.from_numpy(truth.known)
        return ((offsets - target)[known] ** 2).sum(dim=-1).add(1e-10).sqrt().mean()
