"""Prediction with expert advice: training-free, trained and adapted forecasters, combined by their errors."""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from motion_gym import catalog
from motion_gym.contract import FUTURE, Forecast, Observation, SpecError, Truth
from motion_gym.data.windows import pick_scenes_of
from motion_gym.metrics.errors import distance
from motion_gym.predictors.adapters.adapter import KEPT, Adapter, KnownSteps, Styled
from motion_gym.predictors.adapters.kalman import FORGETTING, NO_WEIGHTS, Kalman, drawn_around
from motion_gym.predictors.networks.last_layer import Linearised
from motion_gym.predictors.settings import any_text, positive, setting, share, whole
from motion_gym.stepping.harness import ask

TINY = 1e-12
"""Smallest sum of mixability gaps: before, the learning rate is practically infinite."""
FADE = 0.05
"""Weight of the newest trust in the running mean of the past trust."""

Style = tuple[np.ndarray, int]
"""``observed`` and ``scenes`` of a predictor with a style."""


class Learned(NamedTuple):
    """What the experts had learned at one time.

    Attributes:
        number: Number of observations of ground truth before.
        until: Last listed frame that the experts had learned from.
        styles: ``observed`` and ``scenes`` of the predictor for each memory; empty if it has no style.
        means: Weights of the last layer according to each filter.
    """

    number: int
    until: float
    styles: tuple[Style, ...]
    means: tuple[np.ndarray, ...]


@dataclass(eq=False, repr=False, kw_only=True)
class Hedge(Adapter):
    """A weighted mean of the forecasts of several experts. The weight of each expert, its trust, follows its errors.

    The experts are training-free predictors (``experts``); ``none``, the trained predictor; if it has a style, two
    times ``style``, the same with the style of many and of few recent scenes; and if it has a linear last layer,
    ``kalman``, a Kalman filter of that layer, for each style if there are styles. The experts learn regardless of their
    trust.

    The trust is that of AdaHedge (de Rooij et al., "Follow the leader if you can, hedge if you must", JMLR 15, 2014,
    section 2) with a fixed share (Herbster and Warmuth, "Tracking the best expert", Machine Learning 32, 1998), most of
    which goes to experts that were trusted before (Bousquet and Warmuth, "Tracking a small set of experts by mixing
    past posteriors", JMLR 3, 2002). Whenever agents become fully known, the trust in each expert is multiplied by
    exp(-rate * loss), where the loss is the ADE of the expert over the mean ADE of all experts. Then a share of the
    total trust is redistributed, so that an expert with a long series of errors can regain trust quickly: a part
    follows the running mean of the trust, and the rest is spread evenly. The learning rate is ln(number of experts) /
    (sum of the mixability gaps so far), so that nobody has to tune it. Where it decreases, the trust is raised to the
    power (new rate / old rate), as in Cesa-Bianchi et al., "Mirror descent meets fixed share (and feels no regret)",
    NIPS 2012, section 5.

    An expert is judged by the forecast that it made at the time of the observation: with what it had learned from the
    frames up to that time. For an observation without a time, the state of the experts before this truth counts.

    Args:
        of: See ``Around``; any predictor.
        weights: See ``Around``.
        seed: See ``Around``.
        memory: See ``Adapter``.
        recent: Number of scenes to read the second style from, which changes faster.
        experts: Specs of the training-free predictors, separated by spaces.
        ridge: See ``Kalman``.
        forgetting: See ``Kalman``.
        prior: Trust at the start in all experts that contain the trained predictor together, from 0 to 1; the
            training-free ones have the rest. Where there are none, it is 1.
        recall: Part of the redistributed trust that follows the running mean of the trust, from 0 to 1.
        share: Share of the trust that is redistributed at each update, from 0 to 1.

    Raises:
        SpecError: a setting is not allowed.
    """

    memory: int = setting(64, whole(0, 100_000))
    recent: int = setting(16, whole(1, 100_000))
    experts: str = setting("constant_velocity constant_velocity:velocity=4 kalman_velocity", any_text)
    ridge: float = setting(10.0, positive)
    forgetting: float = setting(0.99, FORGETTING)
    prior: float = setting(0.8, share)
    recall: float = setting(0.9, share)
    share: float = setting(0.02, share)
    kind: ClassVar[str] = "hedge"

    def _prepare(self) -> None:
        self.untrained = {spec: _untrained(spec) for spec in self.experts.split()}
        """Training-free predictors by their specs."""
        styled = bool(self.memory) and isinstance(self.inner, Styled)
        self.memories = {"": self.memory, f":memory={self.recent}": self.recent} if styled else {}
        """Number of scenes of each style, by the end of the names of its experts."""
        number = max(len(self.memories), 1) if isinstance(self.inner, Linearised) else 0
        self.filters = [Kalman(self.inner, ridge=self.ridge, forgetting=self.forgetting) for _ in range(number)]
        """Filters of the last layer, one for each style; empty if the predictor has no such layer."""
        super()._prepare()

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "asked": OrderedDict()}  # forecasts only save time

    def _start(self) -> None:
        super()._start()
        for one in self.filters:
            # One predictor, whose style is set before it is used.
            one.inner, one.source, one.unchosen = self.inner, self.source, None
            one._start()
        groups = (len(self.untrained), 1 - self.prior), (len(self.names) - len(self.untrained), self.prior)
        trust = np.concatenate([np.full(number, total / max(number, 1)) for number, total in groups])
        self.trust = trust / trust.sum() if trust.sum() else np.full(len(trust), 1 / len(trust))
        """[E] trust in each expert; the sum is 1."""
        self.mean_trust = self.trust
        """[E] running mean of the trust before it is redistributed."""
        self.gap = 0.0
        """Sum of the mixability gaps."""
        self.known = KnownSteps()
        self.past: deque[Learned] = deque([self._learned(0, -np.inf)], maxlen=KEPT)
        """What the experts had learned after each of the last observations of ground truth, the present state last."""
        self.asked: OrderedDict[tuple[bytes, int], np.ndarray] = OrderedDict()
        """Forecasts of the experts for recent observations, which are needed again with the ground truth."""
        self.squares, self.count = np.zeros(FUTURE), 0.0
        """[12] sums of squared residuals per coordinate by future step, and the sum of their weights."""

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each expert."""
        styles = [f"style{end}" for end in self.memories]
        filters = [f"kalman{end}" for end in list(self.memories or [""])[: len(self.filters)]]
        return (*self.untrained, "none", *styles, *filters)

    def gauges(self) -> dict[str, float]:
        """Trust in each expert."""
        return {f"trust in {name}": float(trust) for name, trust in zip(self.names, self.trust, strict=True)}

    def learn(self, truth: Truth) -> None:
        """Update the trust by the forecasts of the experts, then let the filter learn."""
        before = self.known.update(truth)
        whole = np.asarray(truth.known.all(axis=1) & ~before.all(axis=1))
        if whole.any():
            self._judge(self._past_advice(truth.observation)[:, whole], truth.future[whole])
        styles, before_updates, before_undone = self._styles(), *self._counts()
        for number, one in enumerate(self.filters):
            self._set_style(styles[number] if styles else None)
            one.learn(truth)
        self._set_style(styles[0] if styles else None)
        updates, undone = self._counts()
        self.updates += int(updates > before_updates or whole.any())
        self.rolled_back += int(undone > before_undone)
        until = self.past[-1].until
        if truth.observation.time is not None:
            last = np.where(truth.known, np.arange(1, FUTURE + 1), 0).max(axis=1)
            until = max(until, float((truth.observation.time[truth.observation.scene_index] + last).max()))
        self.past.append(self._learned(self.past[-1].number + 1, until))
        for _ in range(len(self.asked) - KEPT // 2):
            self.asked.popitem(last=False)

    def _counts(self) -> tuple[int, int]:
        """Numbers of updates of all filters, and of those that were rolled back."""
        return sum(one.updates for one in self.filters), sum(one.rolled_back for one in self.filters)

    def _judge(self, advice: np.ndarray, future: np.ndarray) -> None:
        """Update the trust and the variance by forecasts [E, A, 12, 2] of agents whose future [A, 12, 2] is known."""
        residual = np.einsum("e,eaxy->axy", self.trust, advice) - future
        self.squares = self.forgetting * self.squares + (residual**2).sum(axis=(0, 2)) / 2
        self.count = self.forgetting * self.count + len(future)
        if len(self.trust) == 1:
            return
        loss = distance(advice - future).mean(axis=(1, 2))
        trusted = self.trust > 0
        loss = (loss - loss[trusted].min()) / max(loss.mean(), TINY)
        rate = np.log(len(loss)) / max(self.gap, TINY)
        mixed = -np.log(self.trust[trusted] @ np.exp(-rate * loss[trusted])) / rate
        self.gap += max(float(self.trust @ loss - mixed), 0.0)
        new_rate = np.log(len(loss)) / max(self.gap, TINY)
        with np.errstate(divide="ignore"):
            log_trust = np.log(self.trust) * (new_rate / rate) - new_rate * loss
        trust = np.exp(log_trust - log_trust.max())
        trust /= trust.sum()
        self.mean_trust = (1 - FADE) * self.mean_trust + FADE * trust
        redistributed = self.recall * self.mean_trust + (1 - self.recall) / len(trust)
        self.trust = (1 - self.share) * trust + self.share * redistributed

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres: the mean first, then samples with the variance of recent residuals."""
        mean = np.einsum("e,eaxy->axy", self.trust, self._advice(observation, self.past[-1]))
        return drawn_around(mean, self.squares / max(self.count, TINY), observation, samples, seed)

    def advice(self, observation: Observation) -> dict[str, np.ndarray]:
        """Forecast [A, 12, 2] of each expert, metres, by its name."""
        return dict(zip(self.names, self._advice(observation, self.past[-1]), strict=True))

    def _learned(self, number: int, until: float) -> Learned:
        return Learned(number, until, self._styles(), tuple(one.mean for one in self.filters))

    def _styles(self) -> tuple[Style, ...]:
        """The present style for each memory."""
        if not self.memories:
            return ()
        scenes = list(self.styles) or [(self.source.observed, self.source.scenes)]
        return tuple(
            tuple(sum(values) for values in zip(*scenes[-number:], strict=True))  # type: ignore[misc]
            for number in self.memories.values()
        )

    def _set_style(self, style: Style | None) -> None:
        if style is not None:
            self.inner.observed, self.inner.scenes = style

    def _past_advice(self, observation: Observation) -> np.ndarray:
        """Forecasts [E, A, 12, 2] of the experts with what they had learned at the time of the observation."""
        if observation.time is None:
            return self._advice(observation, self.past[-1])
        parts = []
        for scene, time in enumerate(observation.time.tolist()):
            learned = next((past for past in reversed(self.past) if past.until <= time), self.past[0])
            parts.append(self._advice(pick_scenes_of(observation, [scene]), learned))
        return np.concatenate(parts, axis=1)

    def _advice(self, observation: Observation, learned: Learned) -> np.ndarray:
        """Forecasts [E, A, 12, 2] of the experts in a state, metres."""
        key = observation.history.tobytes() + observation.scene.tobytes(), learned.number
        advice = self.asked.get(key)
        if advice is None:
            advice = self._asked(observation, learned)
            if len(self.asked) < KEPT:  # predict never deletes an entry
                self.asked[key] = advice
        return advice

    def _asked(self, observation: Observation, learned: Learned) -> np.ndarray:
        forecasts = [ask(expert, observation).most_likely() for expert in self.untrained.values()]
        styled = bool(self.memories)
        present = (self.inner.observed, self.inner.scenes) if styled else None
        try:
            self._set_style((self.source.observed, self.source.scenes) if styled else None)
            forecasts.append(self._with_layer(observation))
            for style in learned.styles:
                self._set_style(style)
                forecasts.append(self._with_layer(observation))
            for number, mean in enumerate(learned.means):
                self._set_style(learned.styles[number] if styled else None)
                forecasts.append(self._with_layer(observation, mean))
        finally:
            self._set_style(present)
        return np.stack(forecasts)

    def _with_layer(self, observation: Observation, weight: np.ndarray = NO_WEIGHTS) -> np.ndarray:
        """Forecast [A, 12, 2] of the predictor, metres, with weights of the last layer; the trained ones if empty."""
        if not self.filters:
            return ask(self.inner, observation).most_likely()
        return self.filters[0].forecast(observation, weight)


def _untrained(spec: str) -> Any:
    """A training-free predictor; SpecError if it is trained, learns or is an oracle."""
    predictor = catalog.predictor(spec)
    if any(hasattr(predictor, method) for method in ("fit", "observe", "know")):
        raise SpecError(
            f"`experts` of hedge are training-free predictors, and {spec} is not one: name constant_velocity, "
            "kalman_velocity, constant_acceleration, constant_turn or stand_still, also with their settings."
        )
    return predictor
