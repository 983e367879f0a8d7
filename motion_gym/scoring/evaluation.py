"""Scores of a predictor on a domain, with everything that a reader needs to know about them."""

from __future__ import annotations

import copy
import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.contract import (
    HISTORY,
    MOST_SAMPLES,
    Card,
    Domain,
    Forecast,
    Observation,
    Predictor,
    PredictorError,
    SpecError,
    Truth,
)
from motion_gym.data.domains import spec_of
from motion_gym.data.windows import counts, pick_scenes, pick_scenes_of, rows_of
from motion_gym.metrics.bootstrap import Difference, Summary, paired_difference, summarise
from motion_gym.metrics.errors import error_by_horizon, metric_rows, score
from motion_gym.scoring.cards import declared_leaks, in_json, peak_memory
from motion_gym.stepping.dicts import forecast_to_dict, observation_from_dict
from motion_gym.stepping.harness import ask, name_of, ready, selection_of, tell, tune, windows_of_domain
from motion_gym.stepping.pettingzoo_env import ForecastEnv

PROTOCOLS: Mapping[str, str] = {
    "honest": "style read from reference scenes disjoint from those scored; k = 1 unless stated",
    "paper": "as published: style read from the 20 frames of the scored batches (a leak); best of 20 unless stated",
}
PAPER_BATCH = 64
"""Scenes of a test batch of the released program, whose own future the ``paper`` protocol reads the style from."""
PROBED_SCENES = 32
ASKED_AGAIN = 512
BASELINE = "constant_velocity"


@dataclass(frozen=True, eq=False)
class Scorecard:
    """What came out, and how.

    Attributes:
        predictor: Name or spec.
        domain: Card of the domain.
        spec: The domain in short.
        split: Split that was scored.
        protocol: ``honest`` or ``paper``.
        k: Number of samples.
        samples: Samples that the predictor gave; 1 of a deterministic one stands for all k.
        seed: Seed of a stochastic predictor's samples, and of what was fitted.
        metrics: Mean, interval and counts by name.
        horizon: [12] mean error of the most likely sample by future step, metres.
        versus_baseline: Paired difference of ADE and FDE from constant velocity (negative is better).
        oracle: Whether the predictor is told what no forecaster can know.
        leaks: What reads the future on purpose: side channels of the domain, leaks of the protocol.
        scored: Which agents were scored.
        selection: How the weights were selected.
        reference_scenes: Reference scenes that the predictor saw.
        shots: Scenes of the training split of the domain that the predictor was tuned on, or read a style from.
        seconds: Wall time of the forecasts, fitting not included.
        peak_memory: Bytes, of the whole process so far.
        values: [A] values per agent-window by name of the metric; not written to files.
        truth: What was scored; not written to files.
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
    shots: int
    seconds: float
    peak_memory: int
    values: Mapping[str, np.ndarray]
    truth: Truth

    def as_dict(self) -> dict[str, Any]:
        """All of it in JSON types, except the values per agent; NaN becomes None."""
        plain = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in ("values", "truth")}
        units = {row.name: row for row in metric_rows(self.k, self.domain.unit)}
        plain["domain"] = dataclasses.asdict(self.domain)
        plain["aggregation"] = (
            "mean over agent-windows; ADE, FDE and MR_2m of the most likely sample; min*: best sample of each agent; "
            "J*: best sample of each scene; intervals: 95 %, bootstrap of whole agents (1000 replicates)"
        )
        plain["metrics"] = {
            name: {
                **dataclasses.asdict(s),
                "unit": units[name].unit,
                "lower_is_better": units[name].lower_is_better,
            }
            for name, s in self.metrics.items()
        }
        plain["versus_baseline"] = {
            "baseline": BASELINE,
            **{name: dataclasses.asdict(d) for name, d in self.versus_baseline.items()},
        }
        return in_json(plain)  # type: ignore[no-any-return]

    def __str__(self) -> str:
        ade, fde = self.metrics["ADE"], self.metrics["FDE"]
        return (
            f"{self.predictor} on {self.spec}: "
            f"ADE {ade.mean:.3f} [{ade.low:.3f}, {ade.high:.3f}] {self.domain.unit}, "
            f"FDE {fde.mean:.3f} [{fde.low:.3f}, {fde.high:.3f}] {self.domain.unit}, k = {self.k}, "
            f"protocol {self.protocol}, {ade.agent_windows} agent-windows of {ade.agents} agents in {ade.scenes} scenes"
        )


def evaluate(
    predictor: str | Predictor,
    domain: str | Domain,
    *,
    split: str = "test",
    k: int | None = None,
    protocol: str = "honest",
    seed: int = 0,
    references: int | None = None,
    shots: int = 0,
    through: str = "arrays",
    **parameters: Any,
) -> Scorecard:
    """Score a predictor on every window of a split.

    Args:
        predictor: A name, a spec, ``"module:Class"`` or a predictor. One given by name is fitted to the domain's
            sources if it needs to be.
        domain: A name, a spec, ``"module:Class"`` or a domain.
        split: Which split.
        k: Number of samples; by default 1 (``honest``) or 20 (``paper``).
        protocol: ``honest`` or ``paper``, see ``PROTOCOLS``.
        seed: Seed of the samples, and of the fit.
        references: Reference scenes that a predictor with ``observe`` is shown under ``honest``, the first ones of the
            domain; None for all.
        shots: Scenes of the domain's own training split, the first ones: a copy of a predictor with ``tune`` is tuned
            on them, and one with ``observe`` is shown them under ``honest``. Under ``paper``, what is tuned is also
            given the validation split, to select by.
        through: ``arrays`` asks for all windows at once; ``environment`` steps the PettingZoo environment. The scores
            are the same for every predictor whose forecasts do not depend on the batch.
        **parameters: Parameters of the domain.

    Returns:
        Scorecard.

    Raises:
        SpecError: a name, parameter or option is not known.
        PredictorError: the predictor broke its contract.
        DataError: data is missing or damaged.
    """
    if protocol not in PROTOCOLS:
        raise SpecError(f"There is no protocol `{protocol}`.{catalog.suggest(str(protocol), PROTOCOLS)}")
    if through not in ("arrays", "environment"):
        raise SpecError(f"`through={through}` is not known.{catalog.suggest(str(through), ('arrays', 'environment'))}")
    k = default_k(protocol) if k is None else k
    k = catalog.whole_number("k", k, 1, MOST_SAMPLES)
    seed = catalog.whole_number("seed", seed, 0, 2**63 - 1)
    if references is not None:
        references = catalog.whole_number("references", references, 0, 10**9)
    shots = catalog.whole_number("shots", shots, 0, 10**9)
    place = catalog.domain(domain, **parameters)
    truth = windows_of_domain(place, split)
    if not len(truth.future):
        raise SpecError(f"Split `{split}` of {place!r} has no agent to score.")
    made = ready(predictor, place, seed)
    observes = hasattr(made, "observe")
    leaking = observes and protocol == "paper"
    if leaking and through == "environment":
        raise SpecError("The paper protocol shows a predictor the batch it forecasts: use through='arrays'.")
    shown, tunes, learned = 0, hasattr(made, "tune"), 0
    if shots and (tunes or (observes and protocol == "honest")):
        made, learned = _shown_shots(made, place, truth, split, shots, protocol), shots
    selected = tunes and learned > 0 and protocol == "paper"
    if observes and protocol == "honest":
        reference = place.reference() if references is None else _first_scenes(place, "reference", references)
        _refuse_shared(made, "reference", reference, truth, split)
        tell(made, reference)
        shown = reference.observation.scenes
    began = time.perf_counter()
    if leaking:
        forecast = _by_leaking_batches(made, truth, k, seed)
    elif through == "environment":
        forecast, truth = _by_stepping(made, place, split, truth, k, seed)
    else:
        forecast = ask(made, truth.observation, k, seed)
    seconds = time.perf_counter() - began
    if through == "arrays" and not leaking and not hasattr(made, "know"):
        _check_scenes_apart(made, truth.observation, forecast, k, seed)
    values = score(forecast, truth, k, place.card.unit)
    baseline = score(ask(ready(BASELINE, place), truth.observation), truth, unit=place.card.unit)
    card = dataclasses.replace(place.card, counts={split: counts(truth)})
    agents = truth.observation.agent
    return Scorecard(
        predictor=predictor if isinstance(predictor, str) else name_of(made),
        domain=card,
        spec=spec_of(place),
        split=split,
        protocol=protocol,
        k=k,
        samples=forecast.positions.shape[1],
        seed=seed,
        metrics=summarise(values, truth.observation),
        horizon=np.nanmean(error_by_horizon(forecast, truth), axis=0).tolist(),
        versus_baseline={name: paired_difference(values[name], baseline[name], agents) for name in ("ADE", "FDE")},
        oracle=hasattr(made, "know"),
        leaks=declared_leaks(card, leaking, selected, getattr(made, "trained_on", ()), type(place)),
        scored=_scored(truth),
        selection=selection_of(made),
        reference_scenes=shown,
        shots=learned,
        seconds=seconds,
        peak_memory=peak_memory(),
        values=values,
        truth=truth,
    )


def _first_scenes(domain: Domain, split: str, most: int) -> Truth:
    there = domain.reference() if split == "reference" else windows_of_domain(domain, split)
    if most > there.observation.scenes:
        option, kind = ("references", "reference") if split == "reference" else ("shots", "training")
        raise SpecError(
            f"`{option}={most}`: {domain.card.name} has {there.observation.scenes} {kind} scenes. Ask for at most as "
            "many."
        )
    return pick_scenes(there, slice(0, most))


def _shown_shots(
    predictor: Predictor, domain: Domain, truth: Truth, split: str, shots: int, protocol: str
) -> Predictor:
    """The predictor after it was given scenes of the training split; a copy, if it was tuned on them."""
    if getattr(type(domain), "tests_on_train", False):
        raise SpecError(
            f"`shots={shots}`: the training split of {domain.card.name} is cut from the recording that is scored, so "
            "that it holds the future. Use `references`, or a domain whose splits are apart, as orca."
        )
    few = _first_scenes(domain, "train", shots)
    _refuse_shared(predictor, "training", few, truth, split)
    if hasattr(predictor, "tune"):
        validation = windows_of_domain(domain, "val") if protocol == "paper" else None
        if validation is not None:
            _refuse_shared(predictor, "validation", validation, truth, split)
        predictor = copy.deepcopy(predictor)
        tune(predictor, few, validation)
    if protocol == "honest":
        tell(predictor, few)
    return predictor


def _refuse_shared(predictor: Predictor, kind: str, shown: Truth, scored: Truth, split: str) -> None:
    shared = _shared_agents(shown, scored)
    if shared:
        raise SpecError(
            f"{name_of(predictor)} is shown the {kind} scenes, and {shared} of their agent-windows are in split "
            f"`{split}`: only what a predictor was not shown can be scored. Score another split."
        )


def default_k(protocol: str) -> int:
    """Number of samples where none is named: 20 in published evaluations, 1 in honest ones."""
    return 20 if protocol == "paper" else 1


def compare(a: Scorecard, b: Scorecard, metric: str = "ADE") -> Difference:
    """Paired, clustered difference a - b of one metric; both cards must be about the same agent-windows.

    Raises:
        SpecError: the cards are about different windows, or lack the metric.
    """
    if not np.array_equal(a.truth.future, b.truth.future):
        raise SpecError("The two scorecards are about different windows: compare predictors on one domain and split.")
    for card in (a, b):
        if metric not in card.values:
            raise SpecError(
                f"The scorecard of {card.predictor} has no `{metric}`.{catalog.suggest(metric, card.values)}"
            )
    return paired_difference(a.values[metric], b.values[metric], a.truth.observation.agent)


def _check_scenes_apart(predictor: Predictor, observation: Observation, forecast: Forecast, k: int, seed: int) -> None:
    """Ask again with all but a few scenes changed: the forecasts of those few must stay.

    Windows overlap: the history of a later one holds the future of an earlier one, and all of them are in one batch.
    Of a predictor that gives one sample only some scenes are asked for again; the random numbers of others may depend
    on how many there are.
    """
    if observation.scenes < 2:
        return
    rng = np.random.default_rng()  # of no seed, so that no predictor can know which scenes are looked at
    positions = forecast.positions
    if positions.shape[1] == 1 and observation.scenes > ASKED_AGAIN:
        some = rng.choice(observation.scenes, ASKED_AGAIN, replace=False)
        positions = positions[rows_of(observation, some)]
        observation = pick_scenes_of(observation, some)
    kept = rng.choice(observation.scenes, min(PROBED_SCENES, observation.scenes // 2), replace=False)
    stays = np.isin(observation.scene_index, kept)
    history = observation.history.copy()
    history[~stays, :, :2] += rng.normal(0, 0.5, (int((~stays).sum()), HISTORY, 2)).cumsum(axis=1).astype(np.float32)
    other = ask(predictor, dataclasses.replace(observation, history=history), k, seed)
    same = other.positions.shape == positions.shape
    off = np.abs(other.positions[stays] - positions[stays]).max(initial=0) if same else np.inf
    if off > 1e-3:
        raise PredictorError(
            f"{name_of(predictor)} forecasts a scene otherwise when other scenes of the batch change (by up to "
            f"{off:.3f} m). The batch holds overlapping windows, and with them the future: forecast every scene from "
            "its own history, or score with through='environment'."
        )


def _by_stepping(
    predictor: Predictor, domain: Domain, split: str, truth: Truth, k: int, seed: int
) -> tuple[Forecast, Truth]:
    samples = ask(predictor, pick_scenes(truth, [0]).observation, k, seed).positions.shape[1]
    env = ForecastEnv(domain, split=split, samples=samples)
    observations, _ = env.reset()
    forecasts = []
    while env.agents:
        observation = observation_from_dict(observations, domain.card.dt, env.agents)
        forecasts.append(ask(predictor, observation, samples, seed))
        observations, *_ = env.step(forecast_to_dict(forecasts[-1], env.agents))
    stored, truth = env.ledger.read()
    # Actions have no weights.
    return Forecast(stored.positions, Forecast.join(forecasts).weights), truth


def _by_leaking_batches(predictor: Predictor, truth: Truth, k: int, seed: int) -> Forecast:
    parts = []
    for first in range(0, truth.observation.scenes, PAPER_BATCH):
        batch = pick_scenes(truth, slice(first, first + PAPER_BATCH))
        if hasattr(predictor, "reset"):
            predictor.reset()
        tell(predictor, batch)
        parts.append(ask(predictor, batch.observation, k, seed))
    return Forecast.join(parts)


def _scored(truth: Truth) -> str:
    """Which agents were scored, as the truth itself says."""
    least = int(np.diff(truth.observation.scene).min())
    complete = "agents complete over all 20 steps" if truth.known.all() else "agents, also those who left early"
    return complete + (f", at least {least} in every window" if least > 1 else "")


def _shared_agents(a: Truth, b: Truth) -> int:
    """Agent-windows of ``a`` whose 20 steps are also in ``b``."""

    def steps(truth: Truth) -> list[bytes]:
        both = np.concatenate([truth.observation.xy, truth.future], axis=1)
        return [row.tobytes() for row in both]

    return len(set(steps(a)) & set(steps(b)))
