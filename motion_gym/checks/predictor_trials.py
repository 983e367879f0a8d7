"""Small scenes to try a predictor on, and the trial that the rules of a predictor take."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from motion_gym.checks.report import NotChecked
from motion_gym.contract import FUTURE, HISTORY, WINDOW, Forecast, MotionGymError, Observation, SpecError, Truth
from motion_gym.data.domains import TrainingSet, training_set
from motion_gym.data.validation import check_forecast
from motion_gym.data.windows import offsets, pick_scenes
from motion_gym.stepping.harness import guarded, name_of
from motion_gym.stepping.snapshot import global_randomness

MIXED = (1, 2, 5, 1, 2)
PAIRS = (2, 2, 2, 2)
FAR = 1e4
"""Metres from the origin of one synthetic scene: float32 still resolves a millimetre there."""
SAMPLES = 20
SCENES, TRAINING_SCENES = 6, 40
"""Scenes taken from a domain, to forecast and of each training environment."""
Writable = TypeVar("Writable", Observation, Truth)


@dataclass(frozen=True)
class Scenes:
    """Scenes to forecast, others of the same kind, and what to train on.

    Attributes:
        truth: Observation to ask about, with its truth.
        other: Further scenes; synthetic ones have the same sizes.
        training: Makes training and validation truths, anew at every call.
        synthetic: Whether scenes may be recombined at will.
    """

    truth: Truth
    other: Truth
    training: Callable[[], TrainingSet]
    synthetic: bool = True


def synthetic_scenes(features: int = 2, pairs: bool = False) -> Scenes:
    """Scenes of 1, 2 and 5 agents, or of 2 alone; one agent stands still, one scene is far from the origin."""
    sizes = PAIRS if pairs else MIXED

    def training() -> TrainingSet:
        train, validation = ([synthetic(sizes * 6, features, seed + e) for e in (0, 1)] for seed in (10, 20))
        return train, validation

    return Scenes(synthetic(sizes, features, 1, FAR), synthetic(sizes, features, 2, -FAR), training)


def synthetic(sizes: Sequence[int], features: int, seed: int, far: float = 0.0) -> Truth:
    """People who walk on gentle curves; ``far`` metres away in the last scene.

    Args:
        sizes: Agents of each scene.
        features: F; what follows x and y is random.
        seed: Source of all randomness.
        far: Offset of the last scene in x, metres.
    """
    rng = np.random.default_rng(seed)
    agents = sum(sizes)
    turn = rng.uniform(0, 2 * np.pi, (agents, 1)) + np.cumsum(rng.normal(0, 0.1, (agents, WINDOW)), axis=1)
    speed = rng.uniform(0.2, 0.7, (agents, 1, 1))
    speed[sizes[0]] = 0
    steps = speed * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    xy = rng.uniform(-5, 5, (agents, 1, 2)) + np.cumsum(steps, axis=1)
    xy[agents - sizes[-1] :, :, 0] += far
    more = rng.uniform(1, 2, (agents, HISTORY, features - 2))
    history = np.concatenate([xy[:, :HISTORY], more], axis=2).astype(np.float32)
    scene = offsets(np.asarray(sizes))
    observation = Observation(history, scene, np.arange(agents), 0.4)
    return Truth(xy[:, HISTORY:].astype(np.float32), np.ones((agents, FUTURE), bool), observation)


def domain_scenes(domain: Any) -> Scenes:
    """The first test windows of a domain, and a few training windows of its sources, or of itself if it has none."""
    test = domain.windows("test")
    scenes = np.arange(test.observation.scenes)
    if not len(scenes):
        raise SpecError(f"Domain `{domain.card.name}` has no test window to try a predictor on.")

    def training() -> TrainingSet:
        try:
            train, validation = training_set(domain)
        except SpecError:
            train, validation = [domain.windows("train")], [domain.windows("val")]
        few = slice(0, TRAINING_SCENES)
        return [writable(pick_scenes(t, few)) for t in train], [writable(pick_scenes(v, few)) for v in validation]

    return Scenes(pick_scenes(test, scenes[:SCENES]), pick_scenes(test, scenes[-SCENES:]), training, synthetic=False)


def swapped(observation: Observation, other: Observation, rows: np.ndarray) -> Observation:
    """The same scenes with the histories of some agents taken from another observation of the same sizes."""
    return dataclasses.replace(observation, history=np.where(rows[:, None, None], other.history, observation.history))


def partly_known(truth: Truth) -> Truth:
    """The same truth with ever fewer steps known: none of the first agent's, one of the second's, and so on."""
    count = np.arange(len(truth.known)) % (FUTURE + 1)
    known = truth.known & (np.arange(FUTURE) < count[:, None])
    return Truth(np.where(known[..., None], truth.future, np.float32(0)), known, truth.observation)


def writable(value: Writable) -> Writable:
    """A copy that a predictor could write to."""
    return copy.deepcopy(value)


class PredictorTrial:
    """A predictor with the scenes that its rules ask it about.

    Args:
        make: Makes the predictor anew, in the state that is to be checked.
        domain: Domain to take the scenes from, or None for synthetic scenes.
    """

    def __init__(self, make: Callable[[], Any], domain: Any = None):
        self.make, self.domain = make, domain

    @functools.cached_property
    def trainable(self) -> bool:
        """Whether the predictor has to be fitted before it can be asked."""
        instance = self.make()
        unfitted = hasattr(instance, "fit") and getattr(instance, "fitted", False) is not True
        return unfitted and getattr(instance, "fit_on_demand", True)

    @functools.cached_property
    def scenes(self) -> Scenes:
        """The first scenes that the predictor does not refuse by an error of motion-gym."""
        if self.domain is not None:
            return domain_scenes(self.domain)
        choices = [synthetic_scenes(features, pairs) for pairs in (False, True) for features in (2, 3)]
        for scenes in choices:
            try:
                self.answer(self.fitted(scenes), scenes.truth.observation, 1)
            except MotionGymError as error:
                if error.__cause__ is not None:
                    break  # it crashed: other scenes are for predictors that refuse these
            else:
                return scenes
        return choices[0]

    @functools.cached_property
    def _first(self) -> Any:
        return self.fitted(self.scenes)

    @functools.cached_property
    def _incomparable(self) -> str:
        """Why forecasts cannot be compared; empty if they can."""
        try:
            predictor = self.ready()
            if same(self.ask(predictor), self.ask(predictor)):
                return ""
        except MotionGymError as error:
            return f"the predictor gives no valid forecast ({error})"
        return "the predictor gives another forecast each time it is asked"

    def comparable(self) -> None:
        """Raise NotChecked unless the predictor gives valid forecasts that repeat."""
        if self._incomparable:
            raise NotChecked(self._incomparable)

    def fresh(self) -> Any:
        """The predictor as it is made, told the domain if it is an oracle."""
        instance = self.make()
        if hasattr(instance, "know"):
            if self.domain is None:
                raise NotChecked("an oracle forecasts nothing before it knows a domain: give one")
            guarded(instance, "know", self.domain)
        return instance

    def fitted(self, scenes: Scenes, world: int = 0) -> Any:
        """A new predictor that can be asked, fitted if it has to be, with the global generators at ``world``."""
        instance = self.fresh()
        if self.trainable:
            with global_randomness(world):
                guarded(instance, "fit", *scenes.training(), 0)
        return instance

    def ready(self) -> Any:
        """A predictor that can be asked and changed: a copy of the first one, or a new one if it cannot be copied."""
        try:
            return copy.deepcopy(self._first)
        except MotionGymError:
            raise
        except Exception:
            return self.fitted(self.scenes)

    def answer(self, predictor: Any, observation: Observation, samples: int = SAMPLES, seed: int = 3) -> Any:
        """What predict returns, unchecked; the global generators differ with the seed."""
        with global_randomness(seed):
            return guarded(predictor, "predict", writable(observation), samples=samples, seed=seed)

    def ask(
        self, predictor: Any, observation: Observation | None = None, samples: int = SAMPLES, seed: int = 3
    ) -> Forecast:
        """A forecast of the trial's scenes or of others, as a copy.

        Raises:
            PredictorError: predict raised, or returned something that is no forecast.
        """
        here = self.scenes.truth.observation if observation is None else observation
        answer = self.answer(predictor, here, samples, seed)
        return check_forecast(answer, here, samples, f"{name_of(predictor)}.predict")

    def observe(self, predictor: Any) -> None:
        """Show the predictor truth that is partly known."""
        with global_randomness():
            guarded(predictor, "observe", writable(partly_known(self.scenes.truth)))


def same(a: Forecast, b: Forecast) -> bool:
    """Whether two forecasts are bit-identical."""
    if (a.weights is None) != (b.weights is None):
        return False
    weights = a.weights is None or np.array_equal(a.weights, b.weights)  # type: ignore[arg-type]
    return weights and np.array_equal(a.positions, b.positions)


def distances(a: Forecast, b: Forecast) -> np.ndarray:
    """[A] largest distance over samples and steps, metres; infinite where the shapes differ."""
    if a.positions.shape != b.positions.shape:
        return np.full(len(a.positions), np.inf)
    return np.abs(a.positions.astype(np.float64) - b.positions).max(axis=(1, 2, 3), initial=0)


def gap(a: Forecast, b: Forecast) -> str:
    """How far two forecasts are apart, for messages."""
    return f"up to {distances(a, b).max(initial=0):.2g} m"
