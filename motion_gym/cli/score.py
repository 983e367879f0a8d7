"""The command that scores predictors on domains."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Annotated, Any

import tyro
from rich.markup import escape

from motion_gym import catalog
from motion_gym.benchmarks import store
from motion_gym.benchmarks.identity import windows_identity
from motion_gym.benchmarks.jobs import Job, Runner, score_windows
from motion_gym.benchmarks.reports import score_tables
from motion_gym.benchmarks.row_specs import takes_weights, with_parameters
from motion_gym.checks.inspection import warn_about
from motion_gym.cli.output import Json, Out, begin, console, end, print_json, progress_bar, reporter, say
from motion_gym.contract import Domain, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.scoring.evaluation import BASELINE, default_k

Names = Annotated[list[str], tyro.conf.Positional, tyro.conf.arg(metavar="PREDICTOR [PREDICTOR ...]")]


def score(
    predictors: Names,
    domain: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="DOMAIN")],
    k: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    protocol: str = "honest",
    split: str = "test",
    seed: int = 0,
    references: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    shots: int = 0,
    weights: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None,
    out: Out = None,
    resume: bool = False,
    as_json: Json = False,
) -> None:
    """Score predictors on domains, beside constant velocity and the domain's oracle.

    Under the honest protocol, domains whose windows need two agents are scored a second time with all agents.

    Args:
        predictors: Names, specs (linear:sigma=true) or your own (module:Class).
        domain: Name or spec, as eth:alpha=64 or orca:d=0.6; give it once for each domain.
        k: Samples per agent; by default 1 (honest) or 20 (paper).
        protocol: honest or paper.
        split: Split to score.
        seed: Seed of samples and fits.
        references: Number of reference scenes that predictors with a style receive; all by default.
        shots: Number of scenes of the domain's training split that `transfer` and predictors with a style learn from.
        weights: Weights of the predictors that need weights: a name, as spurious, or a .safetensors file.
        out: Folder for one JSON file per run. Runs of shipped predictors and domains are reused; your own are
            scored each time, since changes of their code and files are not noticed.
        resume: Resume the same command after an interruption: its runs in OUT are reused, your own included.
        as_json: Print JSON in place of tables.
    """
    if not predictors:
        raise SpecError("No predictor was named: motion-gym score linear --domain eth. See `motion-gym ls`.")
    if not domain:
        raise SpecError("No domain was named: add --domain eth, or see `motion-gym ls`.")
    if weights is not None:
        predictors = _with_weights(predictors, weights)
    for predictor in predictors:
        catalog.predictor(predictor)
    places = [place for spec in domain for place in _variants(catalog.domain(spec), protocol)]
    warn_about(places)
    options = {"protocol": protocol, "split": split, "seed": seed, "references": references, "shots": shots}
    options["k"] = default_k(protocol) if k is None else k
    folder = None if out is None else out.absolute()  # a predictor may change the working folder
    session = begin(folder, ["score", *predictors, *domain, str(sorted(options.items()))], resume)
    runner = Runner(store.Store(None, folder))
    scored: list[store.Run] = []
    for place in places:
        with progress_bar() as progress:
            runner.report = reporter(progress, spec_of(place))
            rows = runner.rows([_job(name, place, options, session) for name in _between(predictors, place)])
        runs = [run for runs in rows.values() for run in runs]
        if runs and not as_json:
            console.print(score_tables.domain_table(runs))
        scored += runs
    if as_json:
        print_json(scored)
    for line in score_tables.conditions(scored) if scored and not as_json else ():
        console.print(escape(line), style="dim", highlight=False)
    end(folder, runner)
    if out is not None and not as_json:
        say(f"Results are in {out}.")


def _job(name: str, place: Domain, options: dict[str, Any], session: str) -> Job:
    """A predictor on a domain."""
    spec, identity = spec_of(place), windows_identity(name, place, session=session, **options)
    compute = functools.partial(score_windows, name, place, options)
    return Job(f"{name} on {spec}", (spec,), name, spec, [identity], compute)


def _variants(place: Domain, protocol: str) -> list[Domain]:
    """The domain, and under the honest protocol also the domain with windows of single agents."""
    if protocol != "honest" or place.card.parameters.get("min_agents", 1) == 1:
        return [place]
    return [place, place.replace(min_agents=1)]  # type: ignore[attr-defined]


def _with_weights(predictors: Sequence[str], weights: str) -> list[str]:
    """The specs, with weights for predictors that have weights; SpecError if none has."""
    if not any(map(takes_weights, predictors)):
        raise SpecError(f"`--weights {weights}`: none of {', '.join(predictors)} has weights.")
    return [with_parameters(spec, weights=weights) if takes_weights(spec) else spec for spec in predictors]


def _between(predictors: Sequence[str], place: Domain) -> list[str]:
    """The predictors between constant velocity and the oracle of the domain, each once."""
    oracle = [place.card.oracle] if place.card.oracle else []
    return list(dict.fromkeys([BASELINE, *predictors, *oracle]))
