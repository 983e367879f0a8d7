"""The command line, ``motion-gym``."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.markup import escape

from motion_gym import catalog
from motion_gym.benchmarks import marked_block, results, score_tables
from motion_gym.benchmarks.table import Table
from motion_gym.cli import adapt as cli_online
from motion_gym.cli import training as cli_training
from motion_gym.cli.draw import draw
from motion_gym.cli.output import console, progress_bar, say
from motion_gym.contract import DataError, Domain, MotionGymError, PredictorError, SpecError
from motion_gym.data import datasets
from motion_gym.data.storage import data_folder
from motion_gym.metrics.errors import METRICS
from motion_gym.scoring.evaluation import BASELINE, PROTOCOLS
from motion_gym.stepping.harness import ready

Names = Annotated[list[str], tyro.conf.Positional, tyro.conf.arg(metavar="PREDICTOR [PREDICTOR ...]")]
Thing = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="THING")]
Folder = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
Out = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]

BASELINES = (
    (["stand_still", "linear"], ["orca:d=0.1", "orca:d=0.3", "orca:d=0.6", "eth", "hotel", "univ", "zara1", "zara2"]),
    (["linear", "linear:sigma=true"], ["eth:alpha=8", "eth:alpha=64"]),
)
"""Predictors, and the domains to score them on."""


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
) -> None:
    """Score predictors on domains, between constant velocity and the domain's oracle if it has one.

    Under the honest protocol the domains whose windows need two agents are scored a second time with all agents.

    Args:
        predictors: Names, specs (linear:sigma=true) or your own (module:Class).
        domain: Name or spec, as eth:alpha=64 or orca:d=0.6; give it once for each domain.
        k: Samples per agent; by default 1 (honest) or 20 (paper).
        protocol: honest or paper.
        split: Split to score.
        seed: Seed of samples and fits.
        references: Reference scenes that predictors with a style are shown; all by default.
        shots: Scenes of the domain's training split that `transfer` is tuned on, and that those with a style are shown.
        weights: Weights of those predictors that have some: a name, as spurious, or a .safetensors file.
        out: Folder for one JSON file per run; a run that is there already is not run again.
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
    _score(
        [(place, _between(predictors, place)) for place in places],
        out,
        k=k,
        protocol=protocol,
        split=split,
        seed=seed,
        references=references,
        shots=shots,
    )


def baselines(out: Out = None) -> None:
    """Score the baselines on freshly simulated crowds, and on ETH-UCY where its data is here.

    Args:
        out: Folder for one JSON file per run; a run that is there already is not run again.
    """
    here = all(state.state == "ok" for state in datasets.verify("eth_ucy"))
    jobs = []
    for predictors, specs in BASELINES:
        wanted = [catalog.domain(spec) for spec in specs]
        places = [v for p in wanted if here or not p.card.files for v in _variants(p, "honest")]
        jobs += [(place, _between(predictors, place)) for place in places]
    _score(jobs, out, k=1, protocol="honest", split="test", seed=0)
    if not here:
        say("ETH-UCY was left out: its data is not here, or not whole. Get it with one of")
        say("  motion-gym data fetch eth_ucy            (downloads 4 MB)")
        say("  motion-gym data add eth_ucy --from DIR   (if you have the files)")


def table(
    folder: Folder, into: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None, name: str = "baselines"
) -> None:
    """Print a folder of results as a Markdown table, or put it into a file.

    Args:
        folder: What `score --out` wrote.
        into: File with the lines `<!-- results: NAME -->` and `<!-- results end -->`; what is between is replaced.
        name: NAME of these lines.
    """
    text = "\n\n".join(table.markdown() for table in score_tables.overview(results.read_folder(folder)))
    if into is None:
        print(text)
    else:
        changed = marked_block.insert(into, name, text)
        say(f"{into}: {'written' if changed else 'already up to date'}")


def ls(name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = None) -> None:
    """List domains, predictors, adapters, protocols, metrics and data sets, or explain one of the first three.

    Args:
        name: Domain, predictor or adapter to explain, with its parameters; nothing lists them all.
    """
    if name is not None:
        target, _ = catalog.parse_spec(name)
        if target not in catalog.ADAPTERS:
            _is_predictor(name)  # says what is wrong with a name that is none of them
        entry = {**catalog.DOMAINS, **catalog.PREDICTORS, **catalog.ADAPTERS}.get(target)
        kind = catalog.load_class(entry.target if entry else target)
        say(f"{name}{inspect.signature(kind)}\n\n{inspect.getdoc(kind)}")
        parent = next((k for k in kind.__mro__[1:] if k.__doc__ and "## Arguments" in k.__doc__), None)
        if parent is not None and "## Arguments" not in (kind.__doc__ or ""):
            say(f"\n{inspect.getdoc(parent)}")
        return
    _list("Domains  (name:parameter=value; also environments motion_gym/ID)", ("name", "id", "what"), [
        (name, entry.env_id or "", entry.summary) for name, entry in catalog.DOMAINS.items()
    ])  # fmt: skip
    _list("Predictors  (or your own: module:Class)", ("name", "what"), [
        (name, entry.summary) for name, entry in catalog.PREDICTORS.items()
    ])  # fmt: skip
    _list("Adapters  (motion-gym adapt PREDICTOR --adapter NAME; or your own: module:Class)", ("name", "what"), [
        (name, entry.summary) for name, entry in catalog.ADAPTERS.items()
    ])  # fmt: skip
    _list("Protocols", ("name", "what"), list(PROTOCOLS.items()))
    _list("Metrics", ("name", "unit", "what"), [(m.name, m.unit, m.description) for m in METRICS])
    _list("Data sets  (motion-gym data ...)", ("name", "what"), [(d.name, d.title) for d in datasets.DATASETS.values()])


def check(
    thing: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="THING")] = None,
    domain: str = "orca:scenes=40",
    of: Annotated[str | None, tyro.conf.arg(metavar="PREDICTOR")] = None,
    list: bool = False,
    only: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="RULE")] = [],  # noqa: B006
    skip: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="RULE=REASON")] = [],  # noqa: B006
) -> None:
    """Hold a predictor, an adapter or a domain to the contract, and look for leaks of the future on both clocks.

    Args:
        thing: Predictor, adapter or domain: your own (module:Class), a name or a spec.
        domain: For a predictor or an adapter: the domain on which leaks are looked for.
        of: For an adapter: the predictor to put it around, by default modular_invariant. Your own class is checked as
            an adapter if this is given.
        list: List the rules of each kind and check nothing.
        only: Run only this rule, and no leak probe; give it once for each rule.
        skip: Leave out a rule, with the reason that the report prints; give it once for each rule.
    """
    from motion_gym.checks.checker import KINDS, PREDICTOR, rules, run_checks
    from motion_gym.checks.leaks import leak_probe

    if list:
        for kind in KINDS:
            _list(f"Rules of {kind}s", ("rule", "what"), [*rules(kind).items()])
        return
    if thing is None:
        raise SpecError("Nothing was named to check: motion-gym check THING, or motion-gym check --list.")
    reasons = dict(part.partition("=")[::2] for part in skip)
    place = catalog.domain(domain)
    predictor: Any = thing
    kind = "adapter" if of is not None or catalog.parse_spec(thing)[0] in catalog.ADAPTERS else "predictor"
    if kind == "predictor" and not _is_predictor(thing):
        kind, place, predictor = "domain", catalog.domain(thing), BASELINE
    of = of or PREDICTOR
    found = run_checks(thing, kind, of=of, domain=None if kind == "domain" else place, only=only, skip=reasons)
    if not found.ok:
        raise PredictorError(str(found)) if kind != "domain" else SpecError(str(found))
    say(str(found).replace(thing, f"{thing} around {of}", 1) if kind == "adapter" else str(found))
    if only:
        return
    if kind == "adapter":
        predictor = catalog.adapter(thing, ready(of, place))
    # An oracle reads the world by permission, and simulates whole windows.
    oracle = hasattr(catalog.predictor(predictor), "know")
    for clock in ("windows",) if oracle else ("windows", "stream"):
        probe = leak_probe(predictor, place, clock=clock)
        console.print(str(probe), highlight=False, markup=False)
        if not probe.ok:
            raise DataError(f"{thing} leaks the future; see above.")


def data(
    action: tyro.conf.Positional[Literal["ls", "add", "fetch", "verify"]],
    name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = None,
    source: Annotated[Path | None, tyro.conf.arg(name="from", metavar="FOLDER")] = None,
) -> None:
    """List, add, download or verify data sets.

    Args:
        action: ls: what there is and what is here; add: copy the files from a folder, after checking each; fetch:
            download what is missing; verify: check every file against its checksum.
        name: Name of the data set, as eth_ucy.
        source: For add: the folder that holds the files, at any depth.
    """
    if action == "ls":
        for entry, states in datasets.listing():
            here = sum(state.state == "ok" for state in states)
            console.print(f"[bold]{entry.name}[/bold]  {here} of {len(states)} files here", highlight=False)
            for label, text in (
                ("title", entry.title),
                ("folder", str(data_folder() / entry.name)),
                ("source", entry.source),
                ("terms", entry.terms),
                ("cite", entry.citation),
            ):
                say(f"  {label + ':':8}{text}")
        return
    if name is None:
        raise SpecError(f"Which data set? motion-gym data {action} NAME; known: {', '.join(datasets.DATASETS)}.")
    if action == "add":
        if source is None:
            raise SpecError(f"Where are the files? motion-gym data add {name} --from DIR")
        states = datasets.add(name, source)
    else:
        states = datasets.fetch(name) if action == "fetch" else datasets.verify(name)
    for state in states:
        color = "green" if state.state == "ok" else "red"
        console.print(
            f"  [{color}]{state.state:8}[/{color}] {escape(str(state.path))}", highlight=False, soft_wrap=True
        )
    bad = [state for state in states if state.state != "ok"]
    if bad:
        raise DataError(
            f"{len(bad)} of {len(states)} files of {name} are missing or damaged: `motion-gym data fetch {name}`, or "
            f"`motion-gym data add {name} --from DIR`."
        )
    say(f"{name}: all {len(states)} files are here and whole.")


COMMANDS: dict[str, Callable[..., Any]] = {
    "score": score,
    "baselines": baselines,
    "train": cli_training.train,
    "run": cli_training.run,
    "adapt": cli_online.adapt,
    "import-weights": cli_training.import_weights,
    "table": table,
    "ls": ls,
    "check": check,
    "draw": draw,
    "data": data,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; errors that people can mend are one message and exit status 2."""
    # So that module:Class finds files of the folder one works in.
    sys.path.insert(0, os.getcwd())
    try:
        tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            prog="motion-gym",
            description="Test motion forecasters where they will be used.",
            args=arguments,
        )
    except MotionGymError as error:
        _fail(str(error))
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        os._exit(0)  # whoever read the output has seen enough
    except Exception as error:
        if os.environ.get("MOTION_GYM_DEBUG"):
            raise
        _fail(f"{type(error).__name__}: {error}. (MOTION_GYM_DEBUG=1 shows where.)")


def _fail(message: str) -> None:
    screen = Console(stderr=True, emoji=False)
    screen.print(f"[bold red]error:[/bold red] {escape(message)}", highlight=False, soft_wrap=True)
    sys.exit(2)


def _variants(place: Domain, protocol: str) -> list[Domain]:
    """The domain, and under the honest protocol also the one in which agents that are alone count."""
    if protocol != "honest" or place.card.parameters.get("min_agents", 1) == 1 or not hasattr(place, "replace"):
        return [place]
    return [place, place.replace(min_agents=1)]


def _score(jobs: Sequence[tuple[Domain, Sequence[str]]], out: Path | None, **options: Any) -> None:
    done: list[dict[str, Any]] = []
    failures: dict[str, list[str]] = {}
    with progress_bar() as progress:
        task = progress.add_task("", total=sum(len(names) for _, names in jobs))
        for place, names in jobs:
            progress.start()  # and stopped while a table is printed: they may share a terminal
            rows = []
            for name in names:
                progress.update(task, description=escape(f"{name} on {results.spec_of(place)}"))
                try:
                    rows.append(results.run(name, place, out, **options))
                except (PredictorError, SpecError) as error:
                    failures.setdefault(f"{name}: {error}", []).append(results.spec_of(place))
                progress.advance(task)
            progress.stop()
            if rows:
                console.print(score_tables.domain_table(rows))
            done += rows
    if done:
        for line in score_tables.conditions(done):
            console.print(escape(line), style="dim", highlight=False)
    if failures:
        raise PredictorError("\n".join(f"{message} (on {', '.join(on)})" for message, on in failures.items()))
    if out is not None:
        say(f"Results are in {out}.")


def _with_weights(predictors: Sequence[str], weights: str) -> list[str]:
    """The specs, with weights where the predictor has some; SpecError if none has."""
    found, any_of_them = [], False
    for spec in predictors:
        name, parameters = catalog.parse_spec(spec)
        takes = "weights" in inspect.signature(type(catalog.predictor(spec))).parameters
        any_of_them |= takes
        found.append(catalog.format_spec(name, {**parameters, "weights": weights}) if takes else spec)
    if not any_of_them:
        raise SpecError(f"`--weights {weights}`: none of {', '.join(predictors)} has weights.")
    return found


def _is_predictor(thing: str) -> bool:
    target, _ = catalog.parse_spec(thing)
    name, _, own = target.partition(":")
    known = {**catalog.PREDICTORS, **catalog.DOMAINS}
    if name in known:
        return name in catalog.PREDICTORS
    if not own:
        raise SpecError(
            f"There is no predictor or domain `{name}`.{catalog.suggest(name, known)} Your own: `module:Class`."
        )
    kind = catalog.load_class(target)
    if not any(hasattr(kind, method) for method in ("predict", "recordings")):
        raise SpecError(f"{target} is neither a predictor (method `predict`) nor a domain (`recordings`).")
    return hasattr(kind, "predict")


def _between(predictors: Sequence[str], place: Domain) -> list[str]:
    """The predictors between constant velocity and the oracle, each once."""
    oracle = [place.card.oracle] if place.card.oracle else []
    return list(dict.fromkeys([BASELINE, *predictors, *oracle]))


def _list(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    console.print(Table(title, header, rows))


if __name__ == "__main__":
    main()
