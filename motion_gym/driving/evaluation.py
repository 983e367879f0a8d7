"""Driving with a predictor: seeded episodes, their scores, and the errors of the forecasts in them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.contract import FUTURE, Domain, Predictor, PredictorError
from motion_gym.data.domains import spec_of
from motion_gym.driving.episodes import OTHERS, STEPS, Episode, Episodes
from motion_gym.driving.planner import plan
from motion_gym.driving.run import FORECAST_METRICS, METRICS, Run
from motion_gym.metrics.bootstrap import clustered_interval
from motion_gym.metrics.errors import MISS_DISTANCE, distance
from motion_gym.scoring.cards import declared_leaks, in_json
from motion_gym.specs import one_of, whole_number
from motion_gym.stepping.harness import ask, copied, name_of, ready, selection_of, tell
from motion_gym.stepping.outstanding import Outstanding

ORACLE = "oracle"
"""Instead of a predictor: knows the future of the others."""
ORACLES = {
    "react": "what a copy of the simulation does in which the ego vehicle drives on by its present plan",
    "replay": "the recorded future of the others",
}
"""What the oracle knows."""
KEPT = {"score": 3, **dict.fromkeys(FORECAST_METRICS, 2)}
"""Scores whose values of each episode are stored, with their decimals: rank correlations need them."""
Report = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class DriveCard:
    """Scores of a predictor in episodes.

    Attributes:
        predictor: Name of the predictor.
        domain: Its domain.
        others: How the others move, see ``OTHERS``.
        seed: Seed of the episodes.
        values: [E] value of each episode by name of the score; NaN where it is not defined.
        errors: Messages of a predictor that failed, by number of the episode, which ended there with the score 0.
        seconds: Median seconds of a forecast and of a plan.
        selection: How the weights of the predictor were selected.
        leaks: Declared leaks.
    """

    predictor: str
    domain: Any
    others: str
    seed: int
    values: dict[str, np.ndarray]
    errors: dict[int, str]
    seconds: dict[str, float]
    selection: str
    leaks: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """The card in JSON types: means over episodes with their intervals, and the values of ``KEPT``."""
        metrics = {}
        for name, values in self.values.items():
            mean, low, high = clustered_interval(values, np.arange(len(values)))
            metrics[name] = {"mean": mean, "low": low, "high": high, "episodes": int(np.isfinite(values).sum())}
        card = self.domain.card
        return in_json({  # type: ignore[no-any-return]
            "predictor": self.predictor,
            "spec": spec_of(self.domain),
            "others": self.others,
            "seed": self.seed,
            "metrics": metrics,
            "values": {
                name: np.round(self.values[name], decimals).tolist()
                for name, decimals in KEPT.items()
                if name in self.values
            },
            "errors": self.errors,
            "seconds": self.seconds,
            "oracle": self.predictor == ORACLE,
            "selection": self.selection,
            "leaks": self.leaks,
            "domain": {"parameters": dict(card.parameters), "unit": card.unit, "dt": card.dt},
        })  # fmt: skip

    def __str__(self) -> str:
        means = {name: float(np.nanmean(values)) for name, values in self.values.items() if np.isfinite(values).any()}
        parts = ", ".join(f"{name} {means[name]:.3f}" for name in (*METRICS, *FORECAST_METRICS) if name in means)
        failed = f"; {len(self.errors)} failed: {next(iter(self.errors.values()))}" if self.errors else ""
        return (
            f"{self.predictor} on {spec_of(self.domain)}, others {self.others}, "
            f"{len(self.values['score'])} episodes: {parts}{failed}"
        )


def drive(
    predictor: str | Predictor,
    domain: str | Domain,
    *,
    others: str = "react",
    episodes: int = 100,
    seed: int = 0,
    split: str = "test",
    fitted_to: str | Domain | None = None,
    report: Report = lambda done, total, label: None,
) -> DriveCard:
    """Drive seeded episodes with a planner that sees the others through a predictor.

    Every 0.4 s the predictor forecasts the vehicles around the ego vehicle from their last 8 steps, the planner scores
    15 proposals against the forecasts, and the ego vehicle drives the first 0.4 s of the best one. A predictor that has
    ``observe`` learns from matured forecasts, and keeps what it learned from one episode to the next.

    Args:
        predictor: A name, a spec, ``"module:Class"``, a predictor, or ``"oracle"``, see ``ORACLES``.
        domain: A domain with roads, as ``"highway:style=calm"``.
        others: See ``OTHERS``.
        episodes: Number of episodes.
        seed: Seed of the choice of the episodes and of a predictor's samples.
        split: Split of the domain.
        fitted_to: Domain to whose sources a predictor with ``fit`` is fitted; by default the same domain.
        report: Called before each episode with its number, the number of all, and a label.

    Returns:
        DriveCard. An episode in which the predictor fails ends there with the score 0, and the card has the message.

    Raises:
        SpecError: A name or a value is not known or not allowed, or nobody can drive in the domain.
        PredictorError: The predictor failed in all episodes.
    """
    one_of("others", others, OTHERS)
    count = whole_number("episodes", episodes, 1, 100_000)
    seed = whole_number("seed", seed, 0, 2**31)
    place = catalog.domain(domain)
    drawn = episodes_of(place, split).draw(count, seed)
    oracle = isinstance(predictor, str) and predictor == ORACLE
    asked: Any = None if oracle else ready(copied(predictor), catalog.domain(fitted_to or place), seed, [place])
    name = predictor if isinstance(predictor, str) else name_of(asked)
    results: list[_Result] = []
    for number, episode in enumerate(drawn):
        report(number, count, f"{name} on {spec_of(place)}")
        results.append(_drive_one(asked, name, place, episode, others, seed))
    errors = {drawn[n].number: result.error for n, result in enumerate(results) if result.error}
    if len(errors) == count:
        raise PredictorError(next(iter(errors.values())))
    values = {
        key: np.array([result.values.get(key, np.nan) for result in results]) for key in (*METRICS, *FORECAST_METRICS)
    }
    seconds = np.concatenate([np.array(result.seconds).reshape(-1, 2) for result in results])
    middle = np.median(seconds, axis=0) if len(seconds) else np.zeros(2)
    leaks = () if oracle else declared_leaks(place, asked, split)
    leaks += (f"oracle: knows {ORACLES[others]}",) if oracle else ()
    selection = "no weights; knows the future" if oracle else selection_of(asked)
    times = {"forecast": float(middle[0]), "plan": float(middle[1])}
    return DriveCard(name, place, others, seed, values, errors, times, selection, leaks)


def episodes_of(domain: Any, split: str = "test") -> Episodes:
    """The moments of a split at which an episode can begin; computed once for each domain."""
    return domain.kept(f"episodes of {split}", lambda: Episodes(domain, split))  # type: ignore[no-any-return]


@dataclass
class _Result:
    """What one episode leaves.

    Attributes:
        values: Scores by name.
        seconds: Seconds of each forecast and plan.
        error: Message of a predictor that failed; empty if it did not.
    """

    values: dict[str, float] = field(default_factory=dict)
    seconds: list[tuple[float, float]] = field(default_factory=list)
    error: str = ""


def _drive_one(predictor: Any, name: str, domain: Any, episode: Episode, others: str, seed: int) -> _Result:
    """Drive one episode; without a predictor the oracle forecasts."""
    run, ledger, result = Run(domain, episode, others), Outstanding(), _Result()
    errors: list[np.ndarray] = []
    plans, number = None, 0
    try:
        while not run.over and run.step < STEPS:
            seen = run.observation()
            begin = time.perf_counter()
            if predictor is None:
                positions = _without_gaps(run.world.future(run.ahead(plans, number))[run.there], run.others[run.there])
            else:
                forecast = ask(predictor, seen, 1, seed)
                ledger.store(run.step, seen, forecast)
                positions = forecast.most_likely()
            asked = time.perf_counter()
            paths = run.forecast_paths(positions)
            plans, _, number = plan(run.ego, episode.path, paths, run.others[run.there, 2])
            result.seconds.append((asked - begin, time.perf_counter() - asked))
            run.follow(plans, number)
            for stored in ledger:
                if stored.made + FUTURE == run.step:
                    errors.append(_settle(ledger, run, stored.made, predictor))
        for stored in ledger:  # the last steps of the others are known in part
            _settle(ledger, run, stored.made, predictor)
    except PredictorError as error:
        result.error = (
            f"{name} failed in episode {episode.number} of {spec_of(domain)}, step {run.step} of {STEPS}: {error}"
        )
        result.values = {"score": 0.0}
        return result
    result.values = run.scores()
    matured = np.concatenate(errors, axis=1) if errors else np.zeros((3, 0))
    if matured.shape[1]:
        result.values |= dict(zip(FORECAST_METRICS, matured.mean(axis=1).tolist(), strict=True))
    return result


def _settle(ledger: Outstanding, run: Run, made: int, predictor: Any) -> np.ndarray:
    """Settle the forecast of a step, let the predictor learn, and return ADE, FDE and misses [3, A] of matured ones."""
    agents = next(stored.observation.agent for stored in ledger if stored.made == made)
    forecast, truth = ledger.settle(made, *run.happened(made, agents))
    matured = truth.known.all(axis=1)
    error = distance(forecast.most_likely()[matured].astype(np.float64) - truth.future[matured])
    values = np.array([error.mean(axis=1), error[:, -1], error[:, -1] > MISS_DISTANCE])
    tell(predictor, truth)
    return values


def _without_gaps(future: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Positions [N, 12, 2] of vehicles that leave: from there on they are far away, where nobody drives."""
    return np.where(np.isnan(future), 1e5, future)
