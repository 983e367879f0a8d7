"""Online fine-tuning: gradient steps on what has just become known and on what is remembered."""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.catalog import suggest, whole_number
from motion_gym.contract import FUTURE, SpecError, Truth
from motion_gym.data.windows import pick_scenes, stack
from motion_gym.predictors.adapters.adapter import MEMORY, Adapter, scene_key
from motion_gym.predictors.networks.last_layer import tunable
from motion_gym.predictors.settings import number, positive

OPTIMISERS = {"adam": torch.optim.Adam, "sgd": torch.optim.SGD}
MOST_RATE = 1e30
"""More is as wrong, and would overflow inside of the optimiser."""


class Finetune(Adapter):
    """Tunes weights by gradient steps on revealed truth, with a replay of the last scenes.

    What is minimised is the mean distance of the forecast positions from the true ones over all points that are known,
    metres: censored forecasts, and labels that come step by step, count as far as they go. A scene that is told again
    with more of its steps known replaces what was remembered of it. Where the style encoder is tuned, the style of a
    step is the mean code of its own scenes, unless a style is never read.

    Args:
        of: Name of a predictor of the STGAT or modular family, or such a predictor; a copy of it is used.
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
        anchor: After each step, the share of the way back to the trained weights that is gone.
        memory: Whole scenes, the last ones, that a style is read from; 0 for never.
        weights: Of the predictor, where it is given by name.
        seed: Of the predictor, where it is given by name.

    Raises:
        SpecError: an argument is not known or not allowed.
        PredictorError: the predictor cannot be tuned, or has no such part.
    """

    kind = "finetune"
    settings: ClassVar[tuple[str, ...]] = (
        *("parts", "rate", "optimiser", "every", "steps", "batch", "buffer", "least", "anchor", "memory"),
    )

    def __init__(
        self,
        of: Any = "modular_invariant",
        parts: str = "all",
        rate: float = 1e-4,
        optimiser: str = "adam",
        every: int = 1,
        steps: int = 1,
        batch: int = 16,
        buffer: int = 128,
        least: int = FUTURE,
        anchor: float = 0.0,
        memory: int = MEMORY,
        weights: str | Path | None = None,
        seed: int | None = None,
    ):
        if optimiser not in OPTIMISERS:
            raise SpecError(f"There is no `optimiser={optimiser}`.{suggest(str(optimiser), OPTIMISERS)}")
        self.parts, self.rate, self.optimiser = parts, positive("rate", rate), optimiser
        self.every, self.steps = whole_number("every", every, 1, 10**6), whole_number("steps", steps, 1, 10**4)
        self.batch, self.buffer = whole_number("batch", batch, 1, 10**5), whole_number("buffer", buffer, 1, 10**5)
        self.least, self.anchor = whole_number("least", least, 1, FUTURE), number("anchor", anchor)
        if self.anchor > 1:
            raise SpecError(f"`anchor={anchor}` is the share of a way: give a number from 0 to 1.")
        super().__init__(of, memory, weights, seed)
        self.tuned = tunable(self.inner, parts)

    def _start(self) -> None:
        super()._start()
        self.recent: OrderedDict[bytes, Truth] = OrderedDict()
        """Scenes that are remembered, by what was observed."""
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


class EmaAnchor(Finetune):
    """Fine-tuning that is pulled back towards the trained weights after each step, against forgetting.

    Args:
        of: Name of a predictor of the STGAT or modular family, or such a predictor; a copy of it is used.
        parts: What is tuned, as for ``finetune``.
        rate: Learning rate.
        anchor: After each step, the share of the way back to the trained weights that is gone.
        every: Scenes that must have come before the next update.
        steps: Gradient steps of an update.
        least: Future steps of which an agent of a scene must be known for the scene to be learned from, 1 to 12.
        memory: Whole scenes, the last ones, that a style is read from; 0 for never.
        weights: Of the predictor, where it is given by name.
        seed: Of the predictor, where it is given by name.
    """

    kind = "ema_anchor"
    settings = ("parts", "rate", "anchor", "every", "steps", "least", "memory")

    def __init__(
        self,
        of: Any = "modular_invariant",
        parts: str = "all",
        rate: float = 1e-4,
        anchor: float = 0.01,
        every: int = 1,
        steps: int = 1,
        least: int = FUTURE,
        memory: int = MEMORY,
        weights: str | Path | None = None,
        seed: int | None = None,
    ):
        how: dict[str, Any] = {"every": every, "steps": steps, "least": least, "anchor": anchor, "memory": memory}
        super().__init__(of, parts, rate, **how, weights=weights, seed=seed)
