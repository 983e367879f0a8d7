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
from rich.markdown import Markdown
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from motion_gym import benchmarks, catalog, datasets, report, results
from motion_gym.contract import DataError, Domain, MotionGymError, PredictorError, SpecError
from motion_gym.evaluation import BASELINE, PROTOCOLS
from motion_gym.metrics import METRICS
from motion_gym.storage import data_folder

console = Console(emoji=False)

Names = Annotated[list[str], tyro.conf.Positional, tyro.conf.arg(metavar="PREDICTOR [PREDICTOR ...]")]
Thing = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="THING")]
Folder = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
Out = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]

DEMO = (
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
        [(place, _between(predictors, place)) for place in places], out, k=k, protocol=protocol, split=split, seed=seed
    )


def demo(out: Out = None) -> None:
    """Score the baselines on freshly simulated crowds, and on ETH-UCY where its data is here.

    Args:
        out: Folder for one JSON file per run; a run that is there already is not run again.
    """
    here = all(state.state == "ok" for state in datasets.verify("eth_ucy"))
    jobs = []
    for predictors, specs in DEMO:
        wanted = [catalog.domain(spec) for spec in specs]
        places = [v for p in wanted if here or not p.card.files for v in _variants(p, "honest")]
        jobs += [(place, _between(predictors, place)) for place in places]
    _score(jobs, out, k=1, protocol="honest", split="test", seed=0)
    if not here:
        _say("ETH-UCY was left out: its data is not here, or not whole. Get it with one of")
        _say("  motion-gym data fetch eth_ucy            (downloads 4 MB)")
        _say("  motion-gym data add eth_ucy --from DIR   (if you have the files)")
    _say("Next: write a predictor, as examples/own_predictor.py; from its folder:")
    _say("  motion-gym score own_predictor:Turning --domain orca:d=0.6")
    _say("(`motion-gym` is found after `. .venv/bin/activate`.)")


def train(
    predictor: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PREDICTOR")],
    benchmark: str,
    seeds: str = "0-4",
    device: str = "cpu",
    resume: bool = False,
    epochs: Annotated[tuple[int, int, int] | None, tyro.conf.arg(metavar="INT INT INT")] = None,
    every: int = 10,
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("weights"),
) -> None:
    """Train a predictor for a benchmark, all seeds in one pass.

    Writes OUT/BENCHMARK/PREDICTOR.safetensors, its card, .json, and its last checkpoint, from which --resume goes on
    with more epochs of the last stage. Score it: motion-gym score PREDICTOR --weights
    OUT/BENCHMARK/PREDICTOR.safetensors --domain ...

    Args:
        predictor: Name or spec, as erm or invariant:penalty=1.
        benchmark: What to train for: spurious (test on eth), spurious/hotel, original/hotel, ...
        seeds: Seeds, as 0-4 or 0,2,5.
        device: cpu or cuda.
        resume: Go on from the last checkpoint; without it, one that is there is refused.
        epochs: Epochs of the three stages; by default those of the benchmark.
        every: Epochs from one checkpoint to the next.
        out: Folder for weights and checkpoints.
    """
    made = catalog.predictor(predictor)
    if not all(name in inspect.signature(getattr(made, "fit", print)).parameters for name in ("checkpoint", "report")):
        raise SpecError(f"`{predictor}` is not trained in epochs: there is nothing to train. See `motion-gym ls`.")
    plan = benchmarks.training(benchmark)
    path = out / benchmark / f"{made.row}.safetensors"  # type: ignore[attr-defined]
    checkpoint = path.with_suffix(".checkpoint")
    if checkpoint.exists() and not resume:
        raise SpecError(f"{checkpoint} is there already: add --resume to go on, or delete it to start again.")
    options = {**plan.options, **({"epochs": epochs} if epochs else {})}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    with Progress(*columns, console=screen, disable=not screen.is_terminal) as progress:
        task = progress.add_task(made.name, total=None)  # type: ignore[attr-defined]

        def report(state: Any) -> None:
            score = "" if state.score is None else f", validation ADE {state.score:.3f} m"
            text = f"{state.stage}: loss {state.loss:.3f}{score}"
            progress.update(task, total=state.epochs, completed=state.epoch, description=text)

        made.fit(  # type: ignore[attr-defined]
            *plan.data(),
            _seeds(seeds),
            device=device,
            checkpoint=checkpoint,
            resume=resume,
            every=every,
            report=report,
            **options,
        )
    made.save(path)  # type: ignore[attr-defined]
    card = made.card  # type: ignore[attr-defined]
    scores = ", ".join(f"{score:.3f}" for score in card["validation_ade"])
    _say(f"Written: {path}")
    _say(f"{len(card['seeds'])} seeds in {card['seconds']:.0f} s; validation ADE {scores} m.")


def run(
    benchmark: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="BENCHMARK")],
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("results"),
    into: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
) -> None:
    """Score every row of a benchmark, and write its tables and figures.

    Writes OUT/BENCHMARK/: one JSON file per run (a run that is there already is not run again), tables.md and figures.

    Args:
        benchmark: spurious or original.
        out: Folder of all results.
        into: File with the lines `<!-- results: BENCHMARK -->` and `<!-- results end -->`, to put the short table into.
    """
    from motion_gym import benchmark_report

    folder = out / benchmark
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    screen = Console(stderr=True)
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as progress:
        task = progress.add_task(benchmark, total=None)
        found = benchmarks.run(
            benchmark,
            folder,
            lambda done, of, what: progress.update(task, total=of, completed=done, description=escape(what)),
        )
    written = benchmark_report.write(benchmark, found, folder)
    console.print(Markdown(benchmark_report.short(benchmark, found)))
    if into is not None:
        changed = report.insert(into, benchmark, benchmark_report.short(benchmark, found))
        _say(f"{into}: {'written' if changed else 'already up to date'}")
    for path in written:
        _say(f"Written: {path}")


def import_weights(
    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")],
    predictor: str,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
) -> None:
    """Turn a weight file of the paper's released program (.pth.tar) into one of ours.

    The file is read safely: one that holds anything but tensors and plain values is refused, not opened.

    Args:
        file: The .pth.tar.
        predictor: What it was trained as: erm, counterfactual or invariant.
        out: Where the weights go; by default beside the file, ending in .safetensors.
    """
    made = catalog.predictor(predictor)
    if not hasattr(made, "from_released"):
        raise SpecError(f"`{predictor}` has no weights of the released program: erm, counterfactual or invariant have.")
    target = out if out is not None else file.with_name(file.name.split(".pth")[0] + ".safetensors")
    if target.suffix != ".safetensors":
        raise SpecError(f"`--out {target}` must end in .safetensors.")
    made.from_released(file).save(target)
    _say(f"Written: {target} and its card. Score it:")
    _say(f"  motion-gym score {predictor} --weights {target} --domain eth:alpha=8 --k 20")


def _with_weights(predictors: Sequence[str], weights: str) -> list[str]:
    """The specs, with weights where the predictor has some; SpecError if none has."""
    found, any_of_them = [], False
    for spec in predictors:
        name, parameters = catalog.parse_spec(spec)
        target = catalog.PREDICTORS[name].target if name in catalog.PREDICTORS else name
        takes = "weights" in inspect.signature(catalog.load_class(target, "predictor")).parameters
        any_of_them |= takes
        found.append(catalog.format_spec(name, {**parameters, "weights": weights}) if takes else spec)
    if not any_of_them:
        raise SpecError(f"`--weights {weights}`: none of {', '.join(predictors)} has weights.")
    return found


def _seeds(text: str) -> list[int]:
    """Seeds of ``0-4`` or ``0,2,5``."""
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not first.strip().isdecimal() or (dash and not last.strip().isdecimal()):
            raise SpecError(f"`--seeds {text}` cannot be read: write 0-4, or 0,2,5.")
        found += range(int(first), int(last or first) + 1)
    if not found or len(set(found)) < len(found):
        raise SpecError(f"`--seeds {text}` must name at least one seed, and each once.")
    return found


def table(
    folder: Folder, into: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None, name: str = "baselines"
) -> None:
    """Print a folder of results as a Markdown table, or put it into a file.

    Args:
        folder: What `score --out` wrote.
        into: File with the lines `<!-- results: NAME -->` and `<!-- results end -->`; what is between is replaced.
        name: NAME of these lines.
    """
    text = report.markdown(results.read_folder(folder))
    if into is None:
        print(text)
    else:
        changed = report.insert(into, name, text)
        _say(f"{into}: {'written' if changed else 'already up to date'}")


def ls(name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = None) -> None:
    """List domains, predictors, protocols, metrics and data sets, or explain one domain or predictor.

    Args:
        name: Domain or predictor to explain, with its parameters; nothing lists them all.
    """
    if name is not None:
        _is_predictor(name)  # says what is wrong with a name that is neither predictor nor domain
        target, _ = catalog.parse_spec(name)
        entry = {**catalog.DOMAINS, **catalog.PREDICTORS}.get(target)
        kind = catalog.load_class(entry.target if entry else target)
        _say(f"{name}{inspect.signature(kind)}\n\n{inspect.getdoc(kind)}")
        parent = next((k for k in kind.__mro__[1:] if k.__doc__ and "## Arguments" in k.__doc__), None)
        if parent is not None and "## Arguments" not in (kind.__doc__ or ""):
            _say(f"\n{inspect.getdoc(parent)}")
        return
    _list("Domains  (name:parameter=value; also environments motion_gym/ID)", ("name", "id", "what"), [
        (name, entry.env_id or "", entry.summary) for name, entry in catalog.DOMAINS.items()
    ])  # fmt: skip
    _list("Predictors  (or your own: module:Class)", ("name", "what"), [
        (name, entry.summary) for name, entry in catalog.PREDICTORS.items()
    ])  # fmt: skip
    _list("Protocols", ("name", "what"), list(PROTOCOLS.items()))
    _list("Metrics", ("name", "unit", "what"), [(m.name, m.unit, m.description) for m in METRICS])
    _list("Data sets  (motion-gym data ...)", ("name", "what"), [(d.name, d.title) for d in datasets.DATASETS.values()])


def check(thing: Thing, domain: str = "orca:scenes=40") -> None:
    """Hold a predictor or a domain to the contract, and look for leaks of the future on both clocks.

    Args:
        thing: Predictor or domain: your own (module:Class), a name or a spec.
        domain: For a predictor: the domain on which leaks are looked for.
    """
    from motion_gym.checks import check_domain, check_predictor
    from motion_gym.leaks import leak_probe

    if _is_predictor(thing):
        place, predictor = catalog.domain(domain), thing
        check_predictor(thing, domain=place)
        _say(f"{thing} keeps the contract of a predictor.")
    else:
        place, predictor = catalog.domain(thing), BASELINE
        check_domain(place)
        _say(f"{thing} keeps the contract of a domain.")
    # An oracle reads the world by permission, and simulates whole windows.
    oracle = hasattr(catalog.predictor(predictor), "know")
    for clock in ("windows",) if oracle else ("windows", "stream"):
        found = leak_probe(place, predictor, clock=clock)
        console.print(str(found), highlight=False, markup=False)
        if not found.ok:
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
                _say(f"  {label + ':':8}{text}")
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
    _say(f"{name}: all {len(states)} files are here and whole.")


COMMANDS: dict[str, Callable[..., Any]] = {
    "score": score,
    "demo": demo,
    "train": train,
    "run": run,
    "import-weights": import_weights,
    "table": table,
    "ls": ls,
    "check": check,
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
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    done: list[report.Result] = []
    failures: dict[str, list[str]] = {}
    screen = Console(stderr=True)
    with Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal) as progress:
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
                report.print_table(console, rows)
            done += rows
    if done:
        report.print_conditions(console, done)
    if failures:
        raise PredictorError("\n".join(f"{message} (on {', '.join(on)})" for message, on in failures.items()))
    if out is not None:
        _say(f"Results are in {out}.")


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
    if not any(hasattr(kind, method) for method in ("predict", "windows", "recordings")):
        raise SpecError(f"{target} is neither a predictor (method `predict`) nor a domain (`windows`, `recordings`).")
    return hasattr(kind, "predict")


def _between(predictors: Sequence[str], place: Domain) -> list[str]:
    """The predictors between constant velocity and the oracle, each once."""
    oracle = [place.card.oracle] if place.card.oracle else []
    return list(dict.fromkeys([BASELINE, *predictors, *oracle]))


def _say(text: str) -> None:
    """Print as it is: no markup, no colours, no lines broken."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def _list(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    shown = Table(title=f"[bold]{title}", title_justify="left", header_style="bold", box=None, padding=(0, 2, 0, 0))
    for name in header:
        shown.add_column(name)
    for row in rows:
        shown.add_row(*(escape(cell) for cell in row))
    console.print(shown)
    console.print()


if __name__ == "__main__":
    main()
