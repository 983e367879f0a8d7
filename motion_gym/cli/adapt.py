"""The command that adapts a predictor on a stream."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import tyro

from motion_gym import catalog
from motion_gym.benchmarks import store
from motion_gym.benchmarks.identity import canonical, digest_of, stream_identity
from motion_gym.benchmarks.jobs import Job, Runner
from motion_gym.benchmarks.objects import BASELINE, NONE, ORACLE
from motion_gym.benchmarks.reports.online_tables import stream_table
from motion_gym.cli.output import Json, Out, begin, console, end, print_json, progress_bar, reporter, say
from motion_gym.contract import SpecError
from motion_gym.data.storage import cache_folder
from motion_gym.online.evaluation import check_options, evaluate_online
from motion_gym.online.streams import stream
from motion_gym.online.target_oracle import TargetOracle
from motion_gym.stepping.harness import ready

DEFAULTS = {"labels": "matured", "scope": "stream", "realtime": False, "cost": None, "seed": 0}
"""Defaults of options of ``evaluate_online``, which are left out of the identity of a run."""


def adapt(
    predictor: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PREDICTOR")],
    adapter: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="ADAPTER")],
    on: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(name="stream", metavar="DOMAIN")],
    kind: str = "sudden",
    frames: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    cycles: int = 2,
    split: str = "test",
    labels: str = "matured",
    scope: str = "stream",
    realtime: bool = False,
    cost: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None,
    oracle: Annotated[str | None, tyro.conf.arg(metavar="PREDICTOR")] = None,
    seed: int = 0,
    out: Out = None,
    resume: bool = False,
    as_json: Json = False,
) -> None:
    """Let adapters learn on a stream, and compare them with constant velocity, the source model, and an oracle.

    Each forecast is stored, and scored when its ground truth is known; only then does the adapter learn.

    Args:
        predictor: The source model: name or spec, as modular_invariant:weights=style,seed=0.
        adapter: Name or spec of an adapter (see `motion-gym ls`), or your own (module:Class); once for each adapter.
        on: Domain of the stream; give it once for each domain, in order.
        kind: sudden: one domain after the other; recurring: and all over again; gradual: in blocks, of which more and
            more are of the next; mixed: in blocks in random order.
        frames: Frames of each visit of a domain, 200 or more where there are blocks; by default as many as the
            shortest one has, at most 4000.
        cycles: Visits of each domain where they recur or mix.
        split: Split of the domains.
        labels: matured: each scene's ground truth is revealed once, after its last step; stepwise: step by step.
        scope: The adapter forgets at the end of a: stream, place, or agent.
        realtime: The stream does not wait for an update; ground truth that arrives meanwhile is lost.
        cost: Declared duration of an update in seconds, with --realtime; measured by default.
        oracle: A predictor that was trained on these domains, for the adaptation gain.
        seed: Seed of the stream and of a predictor's samples.
        out: Folder for one JSON file per run. Runs of shipped predictors, adapters and domains are reused; your own are
            run each time, since changes of their code and files are not noticed.
        resume: Resume the same command after an interruption: its runs in OUT are reused, your own included.
        as_json: Print JSON in place of tables.
    """
    if not adapter:
        raise SpecError(f"No adapter was named: add --adapter {next(iter(catalog.ADAPTERS))}, or see `motion-gym ls`.")
    if not on:
        raise SpecError("No domain was named: add --stream orca:d=0.3 --stream orca:d=0.6.")
    check_options(labels, scope, realtime, cost)
    played = stream(list(on), kind, frames, cycles=cycles, seed=seed, split=split)
    source = ready(predictor, played.domains[0], seed, played.domains[1:])
    learners: dict[str, Any] = {BASELINE: catalog.predictor(BASELINE)}
    learners |= {row: catalog.adapter(row, source) for row in dict.fromkeys([NONE, *adapter])}
    if oracle is not None:
        learners[ORACLE] = TargetOracle(oracle)
    options: dict[str, Any] = {"labels": labels, "scope": scope, "realtime": realtime, "cost": cost, "seed": seed}
    arguments = ["adapt", predictor, *adapter, "on", *on, played.name, str(oracle), str(sorted(options.items()))]
    out = None if out is None else out.absolute()  # a predictor may change the working folder
    session = begin(out, arguments, resume)
    changed = {name: value for name, value in options.items() if value != DEFAULTS[name]}
    runner = Runner(store.Store(None, out))
    rows: dict[str, list[store.Run]] = {}
    with progress_bar() as progress:
        for row, learner in learners.items():
            inner = {BASELINE: [], ORACLE: [oracle]}.get(row, [predictor])
            identity = stream_identity(row, [row, *inner], predictor, played.name, played.domains, changed, session)

            def compute(row: str = row, learner: Any = learner, identity: Any = identity) -> list[dict[str, Any]]:
                report, checkpoint = reporter(progress, row), checkpoint_of(identity)
                card = evaluate_online(learner, played, checkpoint=checkpoint, report=report, **options)
                return [{"row": row, "of": predictor, **card.as_dict()}]

            rows |= {key[-1]: runs for key, runs in runner.rows([Job(row, (), row, "", [identity], compute)]).items()}
            if row in (BASELINE, NONE) and row not in rows:
                end(out, runner)  # raises, since every table needs these rows
    if as_json:
        print_json([run for runs in rows.values() for run in runs])
    else:
        console.print(stream_table(played.name, rows))
    end(out, runner)
    if out is not None and not as_json:
        say(f"Results are in {out}.")


def checkpoint_of(identity: dict[str, Any]) -> Path:
    """File from which an interrupted run is resumed; in the user's cache, where nobody else can place files."""
    folder = cache_folder() / "checkpoints"
    return folder / f"{digest_of(json.dumps(canonical(identity), sort_keys=True))}.checkpoint"
