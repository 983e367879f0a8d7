"""The benchmarks: what is scored on what."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks import results
from motion_gym.benchmarks.published import ALPHAS
from motion_gym.contract import DataError, SpecError
from motion_gym.training.plans import PLACES

SAMPLES = 20
"""k of most runs: the first sample gives the scores for k = 1, all of them those for k = 20."""


@dataclass(frozen=True)
class Part:
    """One table of a benchmark.

    Attributes:
        title: Heading.
        domains: Columns of the table: short name, and spec.
        plain: Rows that are not trained, or are fitted to the sources at once.
        trained: Rows with weights.
        weights: Name of the weights of the trained rows.
        protocol: Protocol of every run.
        references: Reference scenes that a predictor with a style is shown; None for all.
        pooled: Further columns, each the mean of some columns.
        shots: Scenes that are given to learn from, by column; none where it is not named.
        samples: k of every run.
    """

    title: str
    domains: Mapping[str, str]
    plain: Sequence[str]
    trained: Sequence[str] = ()
    weights: str = ""
    protocol: str = "honest"
    references: int | None = None
    pooled: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    shots: Mapping[str, int] = field(default_factory=dict)
    samples: int = SAMPLES

    def runs(self) -> Iterator[tuple[str, str]]:
        """Predictor and column of every run."""
        yield from ((row, column) for row in self.plain for column in self.domains)
        for row in self.trained:
            yield from ((spec, column) for spec in self.seeds_of(row).values() for column in self.domains)

    def column_of(self, result: Mapping[str, Any]) -> str:
        """Name of the column that a result belongs to."""
        of = result["identity"]
        return self._columns[of["domain"], of["shots"]]

    @functools.cached_property
    def _columns(self) -> dict[tuple[str, int], str]:
        return {
            (results.domain_key(catalog.domain(spec)), self.shots.get(name, 0)): name
            for name, spec in self.domains.items()
        }

    def seeds_of(self, row: str) -> dict[int, str]:
        """Specs of a trained row by the seeds of its weights.

        Raises:
            SpecError: PyTorch is not installed.
            PredictorError: the weights are missing.
        """
        try:
            from motion_gym.training.weight_files import locate, read
        except ModuleNotFoundError as error:
            raise SpecError(
                f"Trained rows need PyTorch, and {error.name} is not installed: "
                'pip install "motion-gym[torch]" (from a checkout: pip install ".[torch]").'
            ) from None
        _, card = read(locate(self.weights, getattr(catalog.predictor(row), "weights_name", row)))
        name, parameters = catalog.parse_spec(row)
        return {
            seed: catalog.format_spec(name, {**parameters, "weights": self.weights, "seed": seed})
            for seed in card["seeds"]
        }


def _alphas(place: str, more: str = "") -> dict[str, str]:
    return {str(alpha): f"{place}:alpha={alpha}{more}" for alpha in ALPHAS}


PLAIN = ("constant_velocity", "linear", "linear:sigma=true", "linear:sigma=relative")

STYLES = (0.1, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
"""Distances d that predictors are tested with."""
REFERENCES = 64
"""Reference scenes that predictors with a style are shown in the tables."""
EGO = ("ego_erm", "ego_modular")


def _styles(
    title: str,
    trained: Sequence[str],
    weights: str,
    more: str = "",
    plain: Sequence[str] = ("orca_oracle",),
    **how: Any,
) -> Part:
    domains = {str(d): f"orca:d={d}{more}" for d in STYLES}
    return Part(title, domains, plain, trained, weights, pooled={"IID": ("0.1", "0.3", "0.5")}, **how)


REFINED = ("modular", "refine:of=modular")
TUNED = ("all", "style", "modulator", "last_layer")
"""What `transfer` tunes: every choice that it has."""
TRIED = tuple((epochs, rate) for rate in (1e-4, 3e-4, 1e-3, 3e-3) for epochs in (10, 30, 100))
"""Epochs and rates to choose from on a style that was left out."""


def _shots(title: str, d: float, batches: Sequence[int], trained: Sequence[str], weights: str, **how: Any) -> Part:
    domains = {str(n): f"orca:d={d}" for n in batches}
    shots = {str(n): 64 * n for n in batches if n}
    return Part(title, domains, ("constant_velocity",), trained, weights, references=0, shots=shots, **how)


BENCHMARKS: dict[str, tuple[Part, ...]] = {
    "online": (),  # see ``online_benchmark``
    "pretraining": (),  # nothing to score: see ``pretraining_report``
    "spurious": (
        Part(
            "Spurious shift: trained with alpha 1, 2, 4, 8 at four places, tested on eth",
            _alphas("eth"),
            PLAIN,
            (
                "erm_no_sigma",
                "erm",
                "counterfactual",
                "invariant:penalty=1",
                "invariant:penalty=3",
                "invariant",
                "vrex",
                "group_dro",
                "erm:sigma=relative",
            ),
            "spurious",
        ),
        Part(
            "Sigma from the past: no side channel",
            _alphas("eth", ",sigma=past"),
            PLAIN,
            ("erm", "invariant"),
            "spurious/past",
        ),
        Part(
            "Crossed: trained with alpha 1, 2, 4, 8 at each of the four places",
            _alphas("eth"),
            ("constant_velocity",),
            ("erm",),
            "spurious/crossed",
        ),
        *(Part(f"Spurious shift, tested on {place}", _alphas(place), PLAIN) for place in PLACES[1:]),
    ),
    "original": tuple(
        Part(
            f"Original data, tested on {place}",
            {place: place},
            ("constant_velocity", "linear"),
            # As strong as the middle one of the penalties that the paper's authors tried, .5 for sums over 16 scenes.
            ("erm_no_sigma", "counterfactual:sigma=false", "invariant:sigma=false,penalty=0.125"),
            f"original/{place}",
        )
        for place in PLACES
    ),
    "style": (
        _styles(
            "Style shift: trained with d = 0.1, 0.3, 0.5",
            ("style_erm", "style_invariant", "modular", "modular_invariant", *EGO),
            "style",
            plain=("constant_velocity", "linear", "orca_oracle"),
            references=REFERENCES,
        ),
        _styles(
            "Those with a style by the published protocol",
            ("modular", "modular_invariant", "ego_modular"),
            "style",
            protocol="paper",
        ),
        _styles(
            "Blind: on a circle of 7 m agents meet after the observed steps",
            EGO,
            "style/blind",
            ",radius=7",
            ("constant_velocity", "linear", "orca_oracle"),
            references=REFERENCES,
        ),
    ),
    "crowd": (
        _styles(
            "Crowds of ten agents on the circle: trained with d = 0.1, 0.3, 0.5",
            ("erm_no_sigma", "modular_stgat"),
            "style/crowd",
            ",agents=10,scenes=1000",
            ("constant_velocity", "linear"),
            references=REFERENCES,
            samples=1,
        ),
    ),
    "refinement": (
        _styles(
            "Refinement towards 64 reference scenes, by the number of steps",
            ("modular_invariant", "refine:steps=1", "refine", "refine:steps=10", "refine:steps=30", *REFINED),
            "style",
            plain=("constant_velocity",),
            references=REFERENCES,
        ),
        _styles(
            "Refinement by the published protocol",
            ("modular_invariant", "refine", *REFINED),
            "style",
            plain=("constant_velocity",),
            protocol="paper",
        ),
    ),
    "transfer": (
        _shots(
            "Low-shot transfer to d = 0.6, by the number of batches of 64 scenes",
            0.6,
            range(7),
            (
                "modular_invariant",
                "refine",
                *(f"transfer:parts={parts}" for parts in TUNED),
                "refine:of=transfer",
                "ego_modular",
            ),
            "style",
        ),
        _shots(
            "Low-shot transfer to d = 0.6 by the published protocol",
            0.6,
            range(7),
            ("modular_invariant", "refine", *(f"transfer:parts={parts}" for parts in TUNED), "refine:of=transfer"),
            "style",
            protocol="paper",
        ),
        _shots(
            "Schedules: trained with d = 0.1 and 0.3, tuned to d = 0.5",
            0.5,
            (1, 2, 6),
            [
                "modular_invariant",
                *(f"transfer:parts={parts},epochs={e},rate={r:g}" for parts in TUNED for e, r in TRIED),
            ],
            "style/held_out",
        ),
    ),
}
"""Parts of every benchmark by its name."""


Found = list[tuple[Part, list[dict[str, Any]]]]
"""Each part of a benchmark with the results of its runs."""


def run(name: str, folder: Path, report: Callable[[int, int, str], None] = lambda done, of, what: None) -> Found:
    """Score every row of a benchmark on every domain; a result that is in ``folder`` already is read.

    Args:
        name: Name of the benchmark.
        folder: For one JSON file per run.
        report: Called before each run with the number of runs done, of all, and what is next.

    Raises:
        SpecError: there is no such benchmark.
        PredictorError: weights of a row are missing.
    """
    jobs = [(part, predictor, column) for part in parts(name) for predictor, column in part.runs()]
    found: dict[int, dict[str, Any]] = {}
    # One domain after the other, as its windows and resamples are kept.
    for spec in dict.fromkeys(part.domains[column] for part, _, column in jobs):
        place = catalog.domain(spec)
        for number, (part, predictor, column) in enumerate(jobs):
            if part.domains[column] == spec:
                report(len(found), len(jobs), f"{predictor} on {spec}")
                found[number] = results.run(
                    predictor,
                    place,
                    folder,
                    k=part.samples,
                    protocol=part.protocol,
                    references=part.references,
                    shots=part.shots.get(column, 0),
                )
    return [(p, [found[number] for number, job in enumerate(jobs) if job[0] is p]) for p in parts(name)]


def read(name: str, folder: Path) -> Found:
    """What ``run`` left in a folder, made by whatever version of the code.

    Raises:
        SpecError: there is no such benchmark.
        DataError: a run is missing.
    """
    if not parts(name):
        return []
    there = {results.key_of(result): result for result in results.read_folder(folder)}
    found = []
    for part in parts(name):
        keys = [
            (
                predictor,
                results.domain_key(catalog.domain(part.domains[column])),
                "test",
                part.protocol,
                part.samples,
                0,
                part.references,
                part.shots.get(column, 0),
            )
            for predictor, column in part.runs()
        ]
        missing = [f"{key[0]} on {key[1]}" for key in keys if key not in there]
        if missing:
            raise DataError(f"{folder} has no result of {missing[0]}: motion-gym run {name} --out {folder.parent}")
        stale = [key[0] for key in keys if there[key]["identity"]["weights"] != _fingerprint(key[0])]
        if stale:
            raise DataError(
                f"{folder} has results of other weights of {stale[0]} than those that are here: "
                f"motion-gym run {name} --out {folder.parent}"
            )
        found.append((part, [there[key] for key in keys]))
    return found


@functools.cache
def _fingerprint(predictor: str) -> str | None:
    return getattr(catalog.predictor(predictor), "fingerprint", None)


def parts(name: str) -> tuple[Part, ...]:
    """Parts of a benchmark; SpecError if there is none of that name."""
    if name not in BENCHMARKS:
        raise SpecError(f"There is no benchmark `{name}`.{catalog.suggest(name, BENCHMARKS)}")
    return BENCHMARKS[name]
