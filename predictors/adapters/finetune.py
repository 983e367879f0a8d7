"""Online fine-tuning: gradient steps on new ground truth and on remembered scenes."""

from __future__ import annotations

import copy
from collections import OrderedDict
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, Truth
from motion_gym.data.windows import pick_scenes, stack
from motion_gym.predictors.adapters.adapter import Adapter, SceneKey, scene_key
from motion_gym.predictors.networks.last_layer import tunable
from motion_gym.predictors.settings import any_text, one_of, setting, share, whole
from motion_gym.specs import number

OPTIMISERS = {"adam": torch.optim.Adam, "sgd": torch.optim.SGD}


@dataclass(eq=False, repr=False, kw_only=True)
class Finetune(Adapter):
    """Fine-tunes weights by gradient steps on revealed ground truth, with a replay buffer of recent scenes.

    The loss is the mean Euclidean distance between forecast and true positions over all known points, in metres.
    Censored forecasts and labels that arrive step by step contribute their known points. A scene that is revealed
    again replaces the remembered one. If the style encoder is tuned, the style of a gradient step is the mean code of
    its own scenes, unless ``memory`` is 0.

    Args:
        of: See ``Around``; a predictor of the STGAT or modular family.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        parts: Weights to tune: ``all``; ``style``, all but the scene encoder (psi, f and g of the paper);
            ``modulator``, f alone; ``last_layer``.
        rate: Learning rate.
        optimiser: ``adam`` or ``sgd``.
        every: Number of new scenes before the next update.
        steps: Gradient steps per update.
        batch: Scenes per gradient step: the new ones, filled up with remembered ones drawn at random.
        buffer: Number of scenes to remember.
        least: Learn from a scene only if at least one agent has this many known future steps, 1 to 12. Values below 12
            allow learning from agents who left and from labels that arrive step by step.
        anchor: After each gradient step, move the weights by this share towards the trained weights, against
            forgetting. The alias ``ema_anchor`` sets 0.01.

    Raises:
        SpecError: a setting is unknown or not allowed.
        PredictorError: the predictor cannot be tuned, or lacks the part.
    """

    parts: str = setting("all", any_text)
    rate: float = setting(1e-4, partial(number, above=True, most=1e30))
    optimiser: str = setting("adam", one_of(OPTIMISERS))
    every: int = setting(1, whole(1, 10**6))
    steps: int = setting(1, whole(1, 10**4))
    batch: int = setting(16, whole(1, 10**5))
    buffer: int = setting(128, whole(1, 10**5))
    least: int = setting(FUTURE, whole(1, FUTURE))
    anchor: float = setting(0.0, share)
    kind: ClassVar[str] = "finetune"

    def _prepare(self) -> None:
        super()._prepare()
        self.tuned = tunable(self.inner, self.parts)

    def _start(self) -> None:
        super()._start()
        self.recent: OrderedDict[SceneKey, Truth] = OrderedDict()
        """The remembered scenes, oldest first."""
        self.waiting = 0
        """Number of new scenes since the last update."""
        self.state: dict[str, Any] = {}
        """State of the optimiser."""

    def learn(self, truth: Truth) -> None:
        """Remember the scenes, and update the weights if there are enough new ones."""
        for index in range(truth.observation.scenes):
            scene = pick_scenes(truth, [index])
            if scene.known.sum(axis=1).max() >= self.least:
                key = scene_key(scene, 0)
                self.waiting += key not in self.recent
                self.recent[key] = scene
                self.recent.move_to_end(key)
        while len(self.recent) > self.buffer:
            self.recent.popitem(last=False)
        if self.waiting >= self.every and self.recent:
            self._update()
            self.waiting = 0

    def _update(self) -> None:
        before = self.inner.tensors
        free = {name: before[name].detach().clone().requires_grad_() for name in self.tuned}
        optimiser = OPTIMISERS[self.optimiser](list(free.values()), lr=self.rate)
        if self.state:
            optimiser.load_state_dict(copy.deepcopy(self.state))  # steps modify it, even if they are rolled back
        rng = np.random.default_rng([self.updates, self.rolled_back])
        self.updates += 1
        with torch.enable_grad():
            for _ in range(self.steps):
                loss = self.loss(self._batch(rng), {**before, **free})
                gradients = torch.autograd.grad(loss, list(free.values()), allow_unused=True)
                for tensor, gradient in zip(free.values(), gradients, strict=True):
                    tensor.grad = torch.zeros_like(tensor) if gradient is None else gradient
                optimiser.step()
                if self.anchor:
                    with torch.no_grad():
                        for name, tensor in free.items():
                            tensor.lerp_(self.source.tensors[name], self.anchor)
        after = {**before, **{name: tensor.detach() for name, tensor in free.items()}}
        if self._usable(after):
            self.inner.tensors = after
            self.state = optimiser.state_dict()
        else:
            self.rolled_back += 1

    def _usable(self, weights: dict[str, Tensor]) -> bool:
        """Whether the weights, and their forecasts of the last scene, are finite."""
        if not all(bool(torch.isfinite(weights[name]).all()) for name in self.tuned):
            return False
        with torch.no_grad():
            return bool(torch.isfinite(self.loss(next(reversed(self.recent.values())), weights)))

    def _batch(self, rng: np.random.Generator) -> Truth:
        """The new scenes, and remembered ones up to the size of a batch."""
        scenes = list(self.recent.values())
        new = min(self.waiting, self.batch, len(scenes))
        older = len(scenes) - new
        drawn = rng.choice(older, min(self.batch - new, older), replace=False)
        return stack([*(scenes[i] for i in np.sort(drawn)), *scenes[older:]])

    def loss(self, truth: Truth, weights: dict[str, Tensor]) -> Tensor:
        """Mean distance over all known points, metres, for weights [1, ...]."""
        shown = None
        if self.memory and "style" in self.inner.parts.get(self.parts, ()):
            shown = self.inner.whole_scenes(truth)
        offsets = self.inner.offsets(truth.observation, weights, 0, shown)[0]
        target = torch.from_numpy(truth.future - truth.observation.xy[:, -1:])
        known = torch.from_numpy(truth.known)
        return ((offsets - target)[known] ** 2).sum(dim=-1).add(1e-10).sqrt().mean()
