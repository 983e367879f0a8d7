"""Small scenes to try a predictor on, and a way of asking it that sees what a call changes besides answering."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, WINDOW, Forecast, MotionGymError, Observation, SpecError, Truth
from motion_gym.data.domains import TrainingSet, training_set
from motion_gym.data.windows import offsets, pick_scenes
from motion_gym.stepping.harness import checked, guarded, name_of
from motion_gym.stepping.snapshot import global_randomness, snapshot

MIXED = (1, 2, 5, 1, 2)
PAIRS = (2, 2, 2, 2)
FAR = 1e4
"""Metres from the origin of one synthetic scene: float32 still resolves a millimetre there."""
SAMPLES = 20
SCENES, TRAINING_SCENES = 6, 40
"""Scenes taken from a domain, to forecast and of each training environment."""
Report = Callable[[str, str], None]
Given = TypeVar("Given", Observation, Truth)


@dataclass(frozen=True)
class Trial:
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


def synthetic_trial(features: int = 2, pairs: bool = False) -> Trial:
    """Scenes of 1, 2 and 5 agents, or of 2 alone; one agent stands still, one scene is far from the origin."""
    sizes = PAIRS if pairs else MIXED

    def training() -> TrainingSet:
        train, validation = ([synthetic(sizes * 6, features, seed + e) for e in (0, 1)] for seed in (10, 20))
        return train, validation

    return Trial(synthetic(sizes, features, 1, FAR), synthetic(sizes, features, 2, -FAR), training)


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


def domain_trial(domain: Any) -> Trial:
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

    return Trial(pick_scenes(test, scenes[:SCENES]), pick_scenes(test, scenes[-SCENES:]), training, synthetic=False)


def swapped(observation: Observation, other: Observation, rows: np.ndarray) -> Observation:
    """The same scenes with the histories of some agents taken from another observation of the same sizes."""
    return dataclasses.replace(observation, history=np.where(rows[:, None, None], other.history, observation.history))


def partly_known(truth: Truth) -> Truth:
    """The same truth with ever fewer steps known: none of the first agent's, one of the second's, and so on."""
    count = np.arange(len(truth.known)) % (FUTURE + 1)
    known = truth.known & (np.arange(FUTURE) < count[:, None])
    return Truth(np.where(known[..., None], truth.future, np.float32(0)), known, truth.observation)


def writable(given: Given) -> Given:
    """A copy that a predictor could write to."""
    copies: dict[str, Any] = {}
    for field in dataclasses.fields(given):
        value = getattr(given, field.name)
        if isinstance(value, Observation):
            copies[field.name] = writable(value)
        elif isinstance(value, np.ndarray):
            copies[field.name] = np.array(value)
    return dataclasses.replace(given, **copies)


class Subject:
    """A predictor as the rules ask it; findings that may come with any call are reported here.

    Args:
        predictor: The instance.
        trial: Scenes.
        report: Called with the name of a rule and what is wrong.
    """

    def __init__(self, predictor: Any, trial: Trial, report: Report):
        self.predictor, self.trial, self.report = predictor, trial, report

    def has(self, method: str) -> bool:
        """Whether the predictor has an optional method."""
        return hasattr(self.predictor, method)

    def of(self, predictor: Any) -> Subject:
        """Another predictor, the same scenes."""
        return Subject(predictor, self.trial, self.report)

    def copied(self) -> Subject:
        """A deep copy; the predictor itself where that cannot be made, which has then been reported."""
        try:
            return self.of(copy.deepcopy(self.predictor))
        except Exception:
            return self

    def ask(self, observation: Observation | None = None, samples: int = SAMPLES, seed: int = 3) -> Forecast | None:
        """A forecast of the trial's scenes or others; None after a report of what was wrong with it."""
        here = self.trial.truth.observation if observation is None else observation
        try:
            answer = self.answer(here, samples, seed)
        except MotionGymError as error:
            self.report("predict", f"with samples={samples}: {error}")
            return None
        try:
            forecast = checked(answer, here, samples, name_of(self.predictor))
        except MotionGymError as error:
            self.report("forecast", f"with samples={samples}: {error}")
            return None
        # The very array that was returned, so that a later change of it is seen.
        return Forecast(answer.positions if isinstance(answer, Forecast) else answer, forecast.weights)

    def answer(self, observation: Observation, samples: int = 1, seed: int = 0) -> Any:
        """What predict returns, unchecked."""
        given = writable(observation)
        with global_randomness() as used:
            answer = guarded(self.predictor, "predict", given, samples=samples, seed=seed)
        if used:
            self.report(
                "randomness",
                f"predict drew from, or seeded, the global generator of {' and '.join(used)}: use "
                "numpy.random.default_rng(seed), or torch.Generator().manual_seed(seed).",
            )
        if snapshot(given) != snapshot(observation):
            self.report("input", "predict changed its observation: work on a copy, observation.history.copy().")
        return answer

    def fit(self, world: int = 0) -> None:
        """Fit it with seed 0, whatever the global generators stand at.

        Raises:
            PredictorError: it cannot be.
        """
        sets = self.trial.training()
        before = snapshot(sets)
        with global_randomness(world):
            returned = guarded(self.predictor, "fit", *sets, 0)
        if snapshot(sets) != before:
            self.report("input", "fit changed its training set: work on copies of the arrays.")
        if returned is not None and returned is not self.predictor:
            self.report("fit", f"fit returned another object, a {type(returned).__name__}: return self.")
        if getattr(self.predictor, "fitted", True) is not True:
            self.report("fit", f"after fit, fitted is {self.predictor.fitted!r}: make it True.")

    def observe(self) -> bool:
        """Let it see partly known truth; whether that went well."""
        truth = partly_known(self.trial.truth)
        given = writable(truth)
        fine = self.call("observe", "observe", given)
        if fine and snapshot(given) != snapshot(truth):
            self.report("input", "observe changed the truth that it was shown: work on a copy.")
        return fine

    def call(self, rule: str, method: str, *arguments: Any) -> bool:
        """Call a method; whether it raised nothing."""
        try:
            with global_randomness():
                guarded(self.predictor, method, *arguments)
        except MotionGymError as error:
            self.report(rule, str(error))
            return False
        return True
