"""What adapters share: a copy of a predictor, a style that is read from the last scenes, updates that can be undone."""

from __future__ import annotations

import copy
from collections import deque
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from motion_gym.catalog import whole_number
from motion_gym.contract import PredictorError, Truth
from motion_gym.data.windows import check_truth, pick_scenes, whole_scenes
from motion_gym.predictors.adapters.around import Around
from motion_gym.stepping.harness import name_of

KEPT = 32
"""Scenes that are remembered where it matters whether they were told before; more than the steps of a future."""
MEMORY = 16
"""Scenes that a style is read from."""


@runtime_checkable
class Styled(Protocol):
    """A predictor whose style is a sum over the scenes that it has observed.

    Attributes:
        observed: The sum.
        scenes: How many scenes it is over.
    """

    observed: np.ndarray
    scenes: int

    def observe(self, truth: Truth) -> None:
        """Add scenes."""
        ...

    def reset(self) -> None:
        """Go back to no scene."""
        ...


class Adapter(Around):
    """A predictor around a copy of another one, that learns from revealed truth.

    ``predict`` is that of the copy. ``observe`` reads the style from the last scenes, if the predictor has one, and
    then learns, as a subclass says in ``learn``. An update that leaves something that is not finite is taken back.

    Args:
        of: Name of a predictor, or a predictor; a copy of it is used.
        memory: Whole scenes, the last ones, that a style is read from; 0 for never.
        weights: Of the predictor, where it is given by name.
        seed: Of the predictor, where it is given by name.
    """

    settings: ClassVar[tuple[str, ...]] = ("memory",)

    def __init__(self, of: Any, memory: int = MEMORY, weights: str | Path | None = None, seed: int | None = None):
        super().__init__(of, weights, seed)
        self.memory = whole_number("memory", memory, 0, 100_000)
        if hasattr(self.inner, "fingerprint"):
            self.inner.fingerprint  # noqa: B018  # loads the weights, or says that there are none
        if "curve" in getattr(self.inner, "card", {}):
            # How the training went is long, and would be copied with each agent, update and checkpoint.
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
        """Forget all that was learned: weights, states and counts are those of the start, bit by bit."""
        self.inner = copy.deepcopy(self._begun)
        self._start()

    def observe(self, truth: Truth) -> None:
        """Learn from revealed truth.

        Args:
            truth: What became known, with the observations that it answers; agents may be known in part.

        Raises:
            DataError: it is no proper Truth.
            PredictorError: it is not such as the predictor takes.
        """
        check_truth(truth, "What was observed")
        if self.memory and isinstance(self.inner, Styled):
            self._read_style(truth)
        self.learn(truth)

    def learn(self, truth: Truth) -> None:
        """Learn from truth that was checked; here, nothing more than the style."""

    def _read_style(self, truth: Truth) -> None:
        whole = whole_scenes(truth)
        for scene in whole:
            self.inner.reset()
            self.inner.observe(pick_scenes(truth, [scene]))
            self.shown.append((self.inner.observed, self.inner.scenes))
        if len(whole):
            self.inner.observed, self.inner.scenes = (sum(values) for values in zip(*self.shown, strict=True))


class Unadapted(Adapter):
    """The source model, which never learns: what every adapter is held against.

    Args:
        of: Name of a predictor, or a predictor.
        weights: Of the predictor, where it is given by name.
        seed: Of the predictor, where it is given by name.
    """

    kind = "none"
    settings = ()

    def __init__(self, of: Any = "constant_velocity", weights: str | Path | None = None, seed: int | None = None):
        super().__init__(of, 0, weights, seed)


class Style(Adapter):
    """Reads the style from the last scenes, and learns nothing else.

    Args:
        of: Name of a predictor with a style, or such a predictor.
        memory: Whole scenes, the last ones, that the style is read from.
        weights: Of the predictor, where it is given by name.
        seed: Of the predictor, where it is given by name.

    Raises:
        PredictorError: the predictor reads no style.
    """

    kind = "style"

    def __init__(
        self,
        of: Any = "modular_invariant",
        memory: int = MEMORY,
        weights: str | Path | None = None,
        seed: int | None = None,
    ):
        super().__init__(of, whole_number("memory", memory, 1, 100_000), weights, seed)
        if not isinstance(self.inner, Styled):
            raise PredictorError(
                f"{name_of(self.inner)} reads no style from scenes (`observe`, `observed`, `scenes`): use "
                "modular_invariant, modular_stgat or ego_modular, or another adapter, as finetune."
            )

    def learn(self, truth: Truth) -> None:
        """Count what the style was read from."""
        self.updates += int(len(whole_scenes(truth)) > 0)


def scene_key(truth: Truth, scene: int) -> Any:
    """Identifies a scene: when and with whom it was observed; where the time is not known, what was observed."""
    seen = truth.observation
    rows = slice(seen.scene[scene], seen.scene[scene + 1])
    when = seen.history[rows].tobytes() if seen.time is None else int(seen.time[scene])
    return when, seen.agent[rows].tobytes()
