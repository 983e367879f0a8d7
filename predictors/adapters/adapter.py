"""Base class of adapters: reading the style, recognising scenes, and undoing updates."""

from __future__ import annotations

import copy
import itertools
from collections import OrderedDict, deque
from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from motion_gym.contract import Domain, PredictorError, Truth
from motion_gym.data.windows import check_truth, pick_scenes, whole_scenes
from motion_gym.predictors.adapters.around import Around
from motion_gym.predictors.settings import setting, whole
from motion_gym.stepping.harness import name_of

KEPT = 32
"""Number of recent scenes to remember, to recognise scenes that are revealed again. More than the future steps."""
MEMORY = 16
"""Default number of scenes to read a style from."""
SceneKey = tuple[Any, bytes]


@runtime_checkable
class Styled(Protocol):
    """A predictor whose style is a sum over the observed scenes.

    Attributes:
        observed: The sum.
        scenes: Number of scenes in the sum.
    """

    observed: np.ndarray
    scenes: int

    def observe(self, truth: Truth) -> None:
        """Add scenes to the sum."""

    def reset(self) -> None:
        """Set the sum to zero scenes."""


@dataclass(eq=False, repr=False)
class Adapter(Around):
    """A predictor that wraps a copy of another predictor and learns from revealed ground truth.

    ``predict`` calls the copy. ``observe`` reads the style from recent scenes, if the predictor has a style, then calls
    ``learn``, which subclasses define. An update with a result that is not finite is rolled back. If the predictor
    takes a fixed number of agents, scenes with another number of agents are skipped.

    Args:
        of: See ``Around``.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: Number of recent, fully known scenes to read the style from; 0 disables the style.
    """

    memory: int = field(default=MEMORY, kw_only=True, metadata={"check": whole(0, 100_000)})

    def _prepare(self) -> None:
        self.unchosen = copy.deepcopy(self.inner) if getattr(self.inner, "tensors", 0) is None else None
        """The wrapped predictor before its weights were loaded; None if they were loaded before."""
        if hasattr(self.inner, "fingerprint"):
            self.inner.fingerprint  # noqa: B018  # loads the weights, or raises if there are none
        if "curve" in getattr(self.inner, "card", {}):
            # The training curve is long, and would be copied with each agent, update and checkpoint.
            self.inner.card = {key: value for key, value in self.inner.card.items() if key != "curve"}
        if hasattr(self.inner, "reset"):
            self.inner.reset()
        self.source = copy.deepcopy(self.inner)
        """The wrapped predictor before any update."""
        self._start()

    def _start(self) -> None:
        """Set the state before the first update."""
        self.updates = 0
        """Number of updates, including those that were rolled back."""
        self.rolled_back = 0
        """Number of updates that were rolled back."""
        self.styles: deque[Any] = deque(maxlen=self.memory)
        """What each recent scene adds to the style: (sum, number of scenes)."""

    def reset(self) -> None:
        """Restore the initial weights, state and counts, bit by bit."""
        self.inner = copy.deepcopy(self.source)
        self._start()

    def choose_weights(self, domains: Sequence[Domain]) -> None:
        """Let the wrapped predictor choose its weights, if it has several sets and none was named."""
        if self.unchosen is not None and hasattr(self.unchosen, "choose_weights"):
            self.inner = copy.deepcopy(self.unchosen)
            self.inner.choose_weights(domains)
            self._prepare()

    def observe(self, truth: Truth) -> None:
        """Learn from revealed ground truth.

        Args:
            truth: The revealed ground truth with its observations; agents may be partly known.

        Raises:
            DataError: the ground truth is not valid.
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
        """Learn from checked ground truth. The base class learns nothing."""

    def _read_style(self, truth: Truth) -> None:
        scenes = whole_scenes(truth)
        for scene in scenes:
            self.inner.reset()
            self.inner.observe(pick_scenes(truth, [scene]))
            self.styles.append((self.inner.observed, self.inner.scenes))
        if len(scenes):
            self.inner.observed, self.inner.scenes = (sum(values) for values in zip(*self.styles, strict=True))


@dataclass(eq=False, repr=False, kw_only=True)
class Unadapted(Adapter):
    """The source model without any adaptation: the reference for every adapter.

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
    """Reads the style from recent scenes. Learns nothing else.

    Args:
        of: See ``Around``.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``; at least 1.

    Raises:
        PredictorError: the predictor has no style.
    """

    memory: int = setting(MEMORY, whole(1, 100_000))
    kind: ClassVar[str] = "style"

    def _prepare(self) -> None:
        super()._prepare()
        if not isinstance(self.inner, Styled):
            raise PredictorError(
                f"{name_of(self.inner)} reads no style from scenes (`observe`, `observed`, `scenes`): use "
                "modular_invariant, modular_stgat or ego_modular, or another adapter such as finetune."
            )

    def learn(self, truth: Truth) -> None:
        """Count the updates of the style."""
        self.updates += int(len(whole_scenes(truth)) > 0)


def scene_key(truth: Truth, scene: int) -> SceneKey:
    """Key of a scene: its time and agents, or its histories and agents if the time is unknown."""
    observation = truth.observation
    rows = slice(observation.scene[scene], observation.scene[scene + 1])
    time = observation.history[rows].tobytes() if observation.time is None else int(observation.time[scene])
    return time, observation.agent[rows].tobytes()


class KnownSteps:
    """The known steps of recent scenes. A scene may be revealed several times, with more known steps each time."""

    def __init__(self) -> None:
        self.known: OrderedDict[SceneKey, np.ndarray] = OrderedDict()

    def update(self, truth: Truth) -> np.ndarray:
        """Add the known steps of some scenes; return those known before, [A, 12] bool."""
        before = np.zeros_like(truth.known)
        for scene, (first, last) in enumerate(itertools.pairwise(truth.observation.scene)):
            key = scene_key(truth, scene)
            before[first:last] = self.known.pop(key, False)
            self.known[key] = truth.known[first:last] | before[first:last]
        while len(self.known) > KEPT:
            self.known.popitem(last=False)
        return before
