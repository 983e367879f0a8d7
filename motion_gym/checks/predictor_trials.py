"""Small scenes for predictors, and the trial that the rules of predictors take."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

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
"""Metres from the origin to one synthetic scene; float32 still resolves a millimetre there."""
SAMPLES = 20
INVALID = "predict gives no valid forecast"
"""Why a rule is not checked; the rules ``predict`` and ``forecast`` report the error."""
SCENES, TRAINING_SCENES = 6, 40
"""Number of scenes of a domain that are forecast, and of each training environment."""


@dataclass(frozen=True)
class Scenes:
    """Scenes to forecast, further scenes of the same kind, and training data.

    Attributes:
        truth: Observation to forecast, with its ground truth.
        other: Further scenes; synthetic ones have the same sizes.
        training: Makes new training and validation truths at every call.
        synthetic: Whether the histories of two scenes may be combined.
    """

    truth: Truth
    other: Truth
    training: Callable[[], TrainingSet]
    synthetic: bool = True


def synthetic_scenes(features: int, sizes: tuple[int, ...]) -> Scenes:
    """Synthetic scenes of the given sizes; one agent stands still, one scene is far from the origin."""

    def training() -> TrainingSet:
        train, validation = ([synthetic(sizes * 6, features, seed + e) for e in (0, 1)] for seed in (10, 20))
        return train, validation

    return Scenes(synthetic(sizes, features, 1, FAR), synthetic(sizes, features, 2, -FAR), training)


def synthetic(sizes: Sequence[int], features: int, seed: int, far: float = 0.0) -> Truth:
    """People who walk on gentle curves.

    Args:
        sizes: Number of agents of each scene.
        features: F; the features after x and y are random.
        seed: Seed of the random generator.
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
    observation = Observation(history, offsets(np.asarray(sizes)), np.arange(agents), 0.4)
    return Truth(xy[:, HISTORY:].astype(np.float32), np.ones((agents, FUTURE), bool), observation)


def domain_scenes(domain: Any) -> Scenes:
    """The first and last test windows of a domain, and some training windows of its sources, or else of itself."""
    test = domain.windows("test")
    if not test.observation.scenes:
        raise SpecError(f"Domain `{domain.card.name}` has no test window to try a predictor on.")

    def training() -> TrainingSet:
        try:
            sets = training_set(domain)
        except SpecError:
            sets = [domain.windows("train")], [domain.windows("val")]
        train, validation = ([copy.deepcopy(pick_scenes(t, slice(0, TRAINING_SCENES))) for t in part] for part in sets)
        return train, validation

    return Scenes(pick_scenes(test, slice(0, SCENES)), pick_scenes(test, slice(-SCENES, None)), training, False)


def partly_known(truth: Truth) -> Truth:
    """The same truth with fewer known steps: none of the first agent, one of the second, two of the third, ..."""
    count = np.arange(len(truth.known)) % (FUTURE + 1)
    known = truth.known & (np.arange(FUTURE) < count[:, None])
    return dataclasses.replace(truth, future=np.where(known[..., None], truth.future, np.float32(0)), known=known)


class PredictorTrial:
    """A predictor, and the scenes that the rules let it forecast.

    Args:
        make: Makes the predictor anew, in the state that is checked.
        domain: Domain that gives the scenes; None for synthetic scenes.
    """

    def __init__(self, make: Callable[[], Any], domain: Any = None):
        self.make, self.domain = make, domain

    @functools.cached_property
    def trainable(self) -> bool:
        """Whether the predictor must be fitted before it can forecast."""
        instance = self.make()
        unfitted = hasattr(instance, "fit") and getattr(instance, "fitted", False) is not True
        return unfitted and getattr(instance, "fit_on_demand", True)

    @functools.cached_property
    def scenes(self) -> Scenes:
        """The first kind of scenes that the predictor accepts; a predictor refuses scenes by a MotionGymError."""
        if self.domain is not None:
            return domain_scenes(self.domain)
        choices = [synthetic_scenes(features, sizes) for sizes in (MIXED, PAIRS) for features in (2, 3)]
        for scenes in choices:
            try:
                self.answer(self.fitted(scenes), scenes.truth.observation, 1)
            except MotionGymError as error:
                if error.__cause__ is not None:
                    break  # it crashed, and did not refuse these scenes
            else:
                return scenes
        return choices[0]

    @functools.cached_property
    def _first(self) -> Any:
        return self.fitted(self.scenes)

    @functools.cached_property
    def _incomparable(self) -> tuple[str, BaseException | None]:
        """Why forecasts cannot be compared, and the error behind it; an empty reason if they can."""
        try:
            predictor = self.ready()
            repeats = same(self.ask(predictor), self.ask(predictor))
        except NotChecked as reason:
            return str(reason), reason.__cause__
        except MotionGymError as error:
            return INVALID, error
        return ("", None) if repeats else ("predict answers the same question differently each time", None)

    def fresh(self) -> Any:
        """A new predictor; an oracle is shown the domain."""
        instance = self.make()
        if hasattr(instance, "know"):
            if self.domain is None:
                raise NotChecked("an oracle forecasts nothing without a domain (argument `domain`)")
            guarded(instance, "know", self.domain)
        return instance

    def fitted(self, scenes: Scenes) -> Any:
        """A new predictor, fitted if it must be."""
        instance = self.fresh()
        if self.trainable:
            with global_randomness():
                guarded(instance, "fit", *scenes.training(), 0)
        return instance

    def ready(self) -> Any:
        """A predictor that can forecast: a copy of the first one, or a new one if copying fails.

        Raises:
            NotChecked: The predictor cannot be fitted.
        """
        try:
            first = self._first
        except NotChecked:
            raise
        except MotionGymError as error:
            raise NotChecked("the predictor cannot be fitted") from error
        try:
            return copy.deepcopy(first)
        except Exception:
            return self.fitted(self.scenes)

    def comparable(self) -> Any:
        """The predictor of ``ready``; NotChecked unless its forecasts are valid and repeat."""
        reason, cause = self._incomparable
        if reason:
            raise NotChecked(reason) from cause
        return self.ready()

    def answer(self, predictor: Any, observation: Observation, samples: int = SAMPLES, seed: int = 3) -> Any:
        """The unchecked return value of predict; the state of the global generators depends on the seed."""
        with global_randomness(seed):
            return guarded(predictor, "predict", copy.deepcopy(observation), samples=samples, seed=seed)

    def ask(
        self, predictor: Any, observation: Observation | None = None, samples: int = SAMPLES, seed: int = 3
    ) -> Forecast:
        """A copy of the forecast of the trial's scenes, or of other scenes.

        Raises:
            PredictorError: predict raised, or returned no valid forecast.
        """
        seen = self.scenes.truth.observation if observation is None else observation
        answer = self.answer(predictor, seen, samples, seed)
        return check_forecast(answer, seen, samples, f"{name_of(predictor)}.predict")

    def observe(self, predictor: Any) -> None:
        """Let the predictor observe partly known truth.

        Raises:
            NotChecked: observe raised, which is the subject of rule ``observe``.
        """
        try:
            with global_randomness():
                guarded(predictor, "observe", copy.deepcopy(partly_known(self.scenes.truth)))
        except MotionGymError as error:
            raise NotChecked("observe raises") from error


def same(a: Forecast, b: Forecast) -> bool:
    """Whether two forecasts are bit-identical."""
    if (a.weights is None) != (b.weights is None):
        return False
    weights = a.weights is None or np.array_equal(a.weights, b.weights)  # type: ignore[arg-type]
    return weights and np.array_equal(a.positions, b.positions)


def distances(a: Forecast, b: Forecast) -> np.ndarray:
    """[A] largest distance over samples and steps, metres; infinite if the shapes differ."""
    if a.positions.shape != b.positions.shape:
        return np.full(len(a.positions), np.inf)
    return np.abs(a.positions.astype(np.float64) - b.positions).max(axis=(1, 2, 3), initial=0)


def gap(a: Forecast, b: Forecast) -> str:
    """The largest distance between two forecasts, for messages."""
    return f"up to {distances(a, b).max(initial=0):.2g} m"
