"""The command that runs a benchmark."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import tyro

from motion_gym.benchmarks import executors, running
from motion_gym.benchmarks.reports import marked_block
from motion_gym.cli.output import Out, Text, begin, console, end, progress_bar, reporter, say, shown
from motion_gym.contract import SpecError
from motion_gym.specs import number

FOLDER = Path("results")
"""Folder for computed runs, if no folder is named."""
DEFAULT_JOBS = min(os.cpu_count() or 1, 4)
MOST_GPUS = 64
"""Most GPUs of a task."""
Rows = tyro.conf.UseAppendAction


def run(
    benchmark: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="BENCHMARK")],
    predictor: Annotated[list[str], Rows, tyro.conf.arg(metavar="PREDICTOR")],
    adapter: Annotated[list[str], Rows, tyro.conf.arg(metavar="ADAPTER")],
    shift: Annotated[list[str], Rows, tyro.conf.arg(metavar="NAME")],
    only: Annotated[list[str], Rows, tyro.conf.arg(metavar="ROW")],
    of: Text = None,
    fresh: bool = False,
    resume: bool = False,
    jobs: int = DEFAULT_JOBS,
    executor: Literal["processes", "ray"] = "processes",
    address: Text = None,
    gpus: float = 0.0,
    out: Out = None,
    into: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
    pack: bool = False,
) -> None:
    """Show the table of a benchmark, and compute its missing runs.

    The runs of the shipped rows come with the package: they are shown without data, without PyTorch and without
    computing. Your own predictor or adapter is scored on every column, and shown as a further row.

    Args:
        benchmark: A name (see `motion-gym ls`), or your own: module:OBJECT, a motion_gym.benchmarks.objects.Benchmark.
        predictor: Further row: your own predictor (module:Class), or a spec, also with weights of your own. A predictor
            with `fit` is fitted to the sources of each column with five seeds. Give it once for each row.
        adapter: Further row on the streams of online: your own adapter (module:Class), or a spec. Once for each row.
        shift: Shift of online that is run; all by default. Give it once for each shift.
        only: Row that is computed; all by default. Give it once for each row.
        of: Predictor that the adapter is put around; by default that of each shift.
        fresh: Compute stored runs again.
        resume: Resume the same command after an interruption: your own rows that are scored already are reused.
        jobs: Number of processes of this machine, for the executor `processes`.
        executor: Where the runs are computed: processes of this machine, or the nodes of a Ray cluster (`ray`).
        address: Head node of the Ray cluster, as 10.0.0.1:6379; by default the cluster of this machine.
        gpus: GPUs that each Ray task reserves, as 0.25, for rows of your own that use them.
        out: Folder for tables and figures, OUT/BENCHMARK/, and for one JSON file per computed run. Without it, only
            computed runs are written, to results/BENCHMARK/.
        into: File with the lines `<!-- results: BENCHMARK -->` and `<!-- results end -->`, for the table.
        pack: Move the runs of OUT into OUT/BENCHMARK.jsonl.xz, the form in which runs ship.
    """
    from motion_gym.benchmarks.reports import pages

    chosen = running.benchmark(benchmark)
    start = Path.cwd()
    place = (out or FOLDER).absolute()  # a predictor may change the working folder
    folder = place / chosen.name
    if into is not None:
        marked_block.check_markers(into, chosen.name)
    if executor == "ray":
        opener = executors.ray(address, number("gpus", gpus, most=MOST_GPUS), folder)
    elif address or gpus:
        raise SpecError("`--address` and `--gpus` are options of the executor `ray`: add --executor ray.")
    else:
        opener = executors.processes(jobs)
    own = predictor or adapter or ":" in benchmark
    arguments = ["run", benchmark, *predictor, "adapters", *adapter, "shifts", *shift, "of", str(of)]
    session = begin(folder, arguments, resume) if own else None
    with progress_bar() as progress:
        results = running.run(
            chosen,
            predictor,
            folder,
            adapters=adapter,
            of=of,
            shifts=shift,
            fresh=fresh,
            only=only or None,
            executor=opener,
            session=session,
            report=reporter(progress, benchmark),
        )
    tables = pages.short(results)
    for table in tables:
        console.print(table)
    if computed := len(results.runner.computed):
        say(f"Computed: {computed} runs, written to {shown(folder, start)}; the others are stored runs.")
    else:
        say("Stored runs: nothing was computed.")
    if into is not None:
        text = "\n\n".join(table.markdown(heading=0) for table in tables)
        changed = marked_block.insert(into, chosen.name, text)
        say(f"{into}: {'written' if changed else 'already up to date'}")
    if pack:
        results.runner.store.pack(place)
    if out is not None:
        for path in pages.write(results, folder):
            say(f"Written: {shown(path, start)}")
    end(folder if own else None, results.runner)
