"""Scorecards: one predictor on one domain, and several seeds of its weights."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.catalog import suggest
from motion_gym.contract import FUTURE, Card, SpecError, Truth
from motion_gym.metrics.bootstrap import Difference, Summary, paired_difference
from motion_gym.metrics.errors import metric_rows
from motion_gym.scoring.cards import in_json

BASELINE = "constant_velocity"

SHIPPED = "not asked again: a shipped predictor"
"""Beginning of the sentence on how a shipped predictor was verified."""


@dataclass(frozen=True, eq=False)
class Scorecard:
    """The scores of a predictor on a domain, and how they were computed.

    Attributes:
        predictor: Name or spec.
        domain: Card of the domain.
        spec: Spec of the domain.
        split: Split that was scored.
        protocol: ``honest`` or ``paper``.
        k: Requested number of samples.
        samples: Number of samples of the forecast; the 1 sample of a deterministic predictor stands for all k.
        seed: Seed of a stochastic predictor's samples, and of the fit.
        metrics: Mean, interval and counts by name.
        horizon: [12] mean error of the most likely sample by future step, in the domain's unit.
        versus_baseline: Paired difference of ADE and FDE from constant velocity (negative is better).
        oracle: Whether the predictor is an oracle.
        leaks: Declared leaks of the future: side channels of the domain, leaks of the protocol.
        scored: Kind and number of scored agents, and number of agents of the recordings.
        selection: How the weights were selected.
        reference_scenes: Number of reference scenes that the predictor observed.
        reference_draws: Number of draws of reference scenes over which means and intervals are taken.
        shots: Number of scenes of the training split on which the predictor was tuned, or from which it read a style.
        weights_seed: Seed of the weights, if the weights name their seeds.
        verified: How it was verified that forecasts do not depend on later scenes.
        seconds: Wall time of the forecasts, fitting not included.
        peak_memory: Peak memory of the process so far, bytes.
        values: [A] values per agent-window by name of the metric, means over the draws; not written to files.
        truth: Scored ground truth; not written to files.
    """

    predictor: str
    domain: Card
    spec: str
    split: str
    protocol: str
    k: int
    samples: int
    seed: int
    metrics: Mapping[str, Summary]
    horizon: list[float]
    versus_baseline: Mapping[str, Difference]
    oracle: bool
    leaks: tuple[str, ...]
    scored: str
    selection: str
    reference_scenes: int
    reference_draws: int
    shots: int
    weights_seed: int | None
    verified: str
    seconds: float
    peak_memory: int
    values: Mapping[str, np.ndarray]
    truth: Truth

    @property
    def ade(self) -> Summary:
        """Average displacement error of the most likely sample."""
        return self.metrics["ADE"]

    @property
    def fde(self) -> Summary:
        """Final displacement error of the most likely sample."""
        return self.metrics["FDE"]

    @property
    def horizon_seconds(self) -> float:
        """Seconds from the last observed step to the last forecast step."""
        return round(FUTURE * self.domain.dt, 6)

    def as_dict(self) -> dict[str, Any]:
        """All attributes in JSON types, except the values per agent; NaN becomes None."""
        plain = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in ("values", "truth")}
        plain |= {"unit": self.domain.unit, "dt": self.domain.dt, "horizon_seconds": self.horizon_seconds}
        units = {row.name: row for row in metric_rows(self.k, self.domain.unit)}
        plain["aggregation"] = (
            "mean over agent-windows; ADE, FDE and MR_2m of the most likely sample; min*: best sample of each agent; "
            "J*: best sample of each scene; intervals: 95 %, bootstrap of whole agents and of the draws of reference "
            "scenes"
        )
        plain["metrics"] = {
            name: {
                **dataclasses.asdict(s),
                "unit": units[name].unit,
                "lower_is_better": units[name].lower_is_better,
            }
            for name, s in self.metrics.items()
        }
        plain["versus_baseline"] = {"baseline": BASELINE, **self.versus_baseline}
        return in_json(plain)  # type: ignore[no-any-return]

    def __str__(self) -> str:
        unit, seed = self.domain.unit, "" if self.weights_seed is None else f" (weights of seed {self.weights_seed})"
        default = ", the default of the paper protocol" if (self.protocol, self.k) == ("paper", 20) else ""
        return (
            f"{self.predictor}{seed} on {self.spec}: "
            f"ADE {self.ade.mean:.3f} [{self.ade.low:.3f}, {self.ade.high:.3f}] {unit}, "
            f"FDE {self.fde.mean:.3f} [{self.fde.low:.3f}, {self.fde.high:.3f}] {unit}, "
            f"horizon {self.horizon_seconds:g} s in steps of {self.domain.dt:g} s, k = {self.k}{default}, "
            f"protocol {self.protocol}, {self.ade.agent_windows} agent-windows of {self.ade.agents} agents in "
            f"{self.ade.scenes} scenes; {self.verified}"
        )


@dataclass(frozen=True, eq=False)
class SeedsCard:
    """The scores of one predictor with the weights of several seeds.

    Attributes:
        cards: Scorecard of each seed of the weights.
    """

    cards: Mapping[int, Scorecard]

    @property
    def mean(self) -> dict[str, float]:
        """Mean over the seeds by name of the metric."""
        return {name: float(np.mean(values)) for name, values in self._by_seed().items()}

    @property
    def standard_error(self) -> dict[str, float]:
        """Standard error of that mean by name of the metric; NaN for one seed."""
        spread = {name: np.std(v, ddof=1) if len(v) > 1 else np.nan for name, v in self._by_seed().items()}
        return {name: float(s) / np.sqrt(len(self.cards)) for name, s in spread.items()}

    def __str__(self) -> str:
        first = next(iter(self.cards.values()))
        parts = (f"{m} {self.mean[m]:.3f} +- {self.standard_error[m]:.3f} {first.domain.unit}" for m in ("ADE", "FDE"))
        seeds = ", ".join(map(str, self.cards))
        return f"{first.predictor} on {first.spec}: {', '.join(parts)} (standard error over seeds {seeds})"

    def _by_seed(self) -> dict[str, list[float]]:
        names = next(iter(self.cards.values())).metrics
        return {name: [card.metrics[name].mean for card in self.cards.values()] for name in names}


def compare(a: Scorecard, b: Scorecard, metric: str = "ADE") -> Difference:
    """Paired, clustered difference a - b of one metric; both cards must be about the same agent-windows.

    Raises:
        SpecError: The cards are about different windows, or lack the metric.
    """
    if not np.array_equal(a.truth.future, b.truth.future):
        raise SpecError("The two scorecards are about different windows: compare predictors on one domain and split.")
    for card in (a, b):
        if metric not in card.values:
            raise SpecError(f"The scorecard of {card.predictor} has no `{metric}`.{suggest(metric, card.values)}")
    return paired_difference(a.values[metric], b.values[metric], a.truth.observation.agent)


def who_was_scored(truth: Truth, recorded: Mapping[str, int]) -> str:
    """Kind and number of scored agents, and number of agents of the recordings.

    Args:
        truth: Scored ground truth.
        recorded: Counts of the split, including those of the recordings.
    """
    least = int(np.diff(truth.observation.scene).min())
    complete = "agents complete over all 20 steps" if truth.known.all() else "agents, also those who left early"
    scored = complete + (f", at least {least} in every window" if least > 1 else "")
    if "recorded_agent_windows" not in recorded:
        return scored
    agents = len(np.unique(truth.observation.agent))
    return (
        f"{scored}: {len(truth.future)} of the {recorded['recorded_agent_windows']} agent-windows and {agents} of the "
        f"{recorded['recorded_agents']} agents of the recordings"
    )
