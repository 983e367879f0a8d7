"""What adapters share: a style that is read from the last scenes, scenes told before, updates that can be undone."""

from __future__ import annotations

import copy
import itertools
from collections import OrderedDict, deque
from dataclasses import InitVar, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from motion_gym.contract import PredictorError, Truth
from motion_gym.data.windows import check_truth, pick_scenes, whole_scenes
from motion_gym.predictors.adapters.around import Around
from motion_gym.predictors.settings import setting, whole
from motion_gym.stepping.harness import name_of

KEPT = 32
"""Scenes that are remembered where it matters whether they were told before; more than the steps of a future."""
MEMORY = 16
"""Scenes that a style is read from."""
SceneKey = tuple[Any, bytes]


@runtime_checkable
class Styled(Protocol):
    """A predictor whose style is a sum over the scenes that it has observed.

    Attributes:
        observed: The sum.
        scenes: Number of these scenes.
    """

    observed: np.ndarray
    scenes: int

    def observe(self, truth: Truth) -> None:
        """Add scenes."""

    def reset(self) -> None:
        """Go back to no scene."""


@dataclass(eq=False, repr=False)
class Adapter(Around):
    """A predictor around a copy of another one that learns from revealed truth.

    ``predict`` is that of the copy. ``observe`` reads the style from the last scenes, if the predictor has one, and
    then learns, as a subclass says in ``learn``. An update whose result is not finite is taken back. Scenes of a number
    of agents that the predictor cannot take, as parts of a scene, are passed over.

    Args:
        of: See ``Around``.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: Whole scenes, the last ones, that a style is read from; 0 for never.
    """

    memory: int = field(default=MEMORY, kw_only=True, metadata={"check": whole(0, 100_000)})

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        super().__post_init__(of, weights, seed)
        if hasattr(self.inner, "fingerprint"):
            self.inner.fingerprint  # noqa: B018  # loads the weights, or says that there are none
        if "curve" in getattr(self.inner, "card", {}):
            # The training curve is long, and would be copied with each agent, update and checkpoint.
            self.inner.card = {key: value for key, value in self.inner.card.items() if key != "curve"}
        if hasattr(self.inner, "reset"):
            self.inner.reset()
        self._begun = copy.deepcopy(self.inner)
        self._start()

    def _start(self) -> None:
        self.updates = 0
        """Times that it has learned."""
        self.rolled_back = 0
        """Updates that were taken back."""
        self.shown: deque[Any] = deque(maxlen=self.memory)
        """What each of the whole scenes that the style is read from adds to it."""

    def reset(self) -> None:
        """Forget everything that was learned: weights, states and counts are those of the start, bit by bit."""
        self.inner = copy.deepcopy(self._begun)
        self._start()

    def observe(self, truth: Truth) -> None:
        """Learn from revealed truth.

        Args:
            truth: What became known, with the observations that it answers; agents may be known in part.

        Raises:
            DataError: it is no proper Truth.
        """
        check_truth(truth, "The observed truth")
        agents = getattr(self.inner, "agents_per_scene", None)
        if agents is not None:
            truth = pick_scenes(truth, np.flatnonzero(np.diff(truth.observation.scene) == agents))
        if not len(truth.future):
            return
        if self.memory and isinstance(self.inner, Styled):
            self._read_style(truth)
        self.learn(truth)

    def learn(self, truth: Truth) -> None:
        """Learn from truth that was checked; here, nothing more than the style."""

    def _read_style(self, truth: Truth) -> None:
        scenes = whole_scenes(truth)
        for scene in scenes:
            self.inner.reset()
            self.inner.observe(pick_scenes(truth, [scene]))
            self.shown.append((self.inner.observed, self.inner.scenes))
        if len(scenes):
            self.inner.observed, self.inner.scenes = (sum(values) for values in zip(*self.shown, strict=True))


@dataclass(eq=False, repr=False, kw_only=True)
class Unadapted(Adapter):
    """The source model, which never learns: the reference for every adapter.

    Args:
        of: See ``Around``.
        weights: See ``Around``.
        seed: See ``Around``.
    """

    of: InitVar[Any] = field(default="constant_velocity", kw_only=False)  # type: ignore[assignment]
    memory: int = field(default=0, init=False)
    kind: ClassVar[str] = "none"


@dataclass(eq=False, repr=False, kw_only=True)
class Style(Adapter):
    """Reads the style from the last scenes, and learns nothing else.

    Args:
        of: See ``Around``.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``; at least 1.

    Raises:
        PredictorError: the predictor reads no style.
    """

    memory: int = setting(MEMORY, whole(1, 100_000))
    kind: ClassVar[str] = "style"

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        super().__post_init__(of, weights, seed)
        if not isinstance(self.inner, Styled):
            raise PredictorError(
                f"{name_of(self.inner)} reads no style from scenes (`observe`, `observed`, `scenes`): use "
                "modular_invariant, modular_stgat or ego_modular, or another adapter, as finetune."
            )

    def learn(self, truth: Truth) -> None:
        """Count the updates of the style."""
        self.updates += int(len(whole_scenes(truth)) > 0)


def scene_key(truth: Truth, scene: int) -> SceneKey:
    """Identifies a scene: when and with whom it was observed; where the time is not known, what was observed."""
    seen = truth.observation
    rows = slice(seen.scene[scene], seen.scene[scene + 1])
    when = seen.history[rows].tobytes() if seen.time is None else int(seen.time[scene])
    return when, seen.agent[rows].tobytes()


class Told:
    """What was known of the last scenes when they were told before: labels may come step by step."""

    def __init__(self) -> None:
        self.known: OrderedDict[SceneKey, np.ndarray] = OrderedDict()

    def before(self, truth: Truth) -> np.ndarray:
        """What was known [A, 12] of the same scenes before; this truth is remembered."""
        before = np.zeros_like(truth.known)
        for scene, (first, last) in enumerate(itertools.pairwise(truth.observation.scene)):
            key = scene_key(truth, scene)
            before[first:last] = self.known.pop(key, False)
            self.known[key] = truth.known[first:last] | before[first:last]
        while len(self.known) > KEPT:
            self.known.popitem(last=False)
        return before
