"""The commands for results of others: checking a file, and comparing two."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Annotated

import tyro

from motion_gym.benchmarks import comparison, validation
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.json_schema import json_schema
from motion_gym.benchmarks.reports.table import Table
from motion_gym.cli.output import Json, Text, console, print_json, progress_bar, reporter
from motion_gym.contract import SpecError
from motion_gym.scoring.cards import in_json
from motion_gym.specs import whole_number

Names = Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="DOMAIN")]
MOST_SHOWN = 40


def validate(
    file: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")] = None,
    recompute: int = 3,
    seed: int = 0,
    schema: bool = False,
    as_json: Json = False,
) -> None:
    """Check results of others: their form, versions, digests of weights and data, and a sample computed again.

    Exit status 1 if a run is wrong.

    Args:
        file: A .json of one run, a .jsonl.xz of packed runs, or a folder of results.
        recompute: Number of runs that are computed again, drawn at random.
        seed: Seed of that choice.
        schema: Print the JSON Schema of a run, and check nothing.
        as_json: Print JSON in place of a table.
    """
    if schema:
        print_json(json_schema())
        return
    if file is None:
        raise SpecError("Name a file or folder of results to check, or --schema to print their JSON Schema.")
    whole_number("recompute", recompute, 0, 10**6)
    with progress_bar() as progress:
        findings = validation.validate(validation.read(file), recompute, seed, reporter(progress, str(file)))
    if as_json:
        print_json([dataclasses.asdict(finding) for finding in findings])
    else:
        order = sorted(findings, key=lambda finding: finding.verdict != validation.MISMATCH)
        rows = [[finding.verdict, finding.reason, finding.run] for finding in order]
        notes = [f"{len(rows) - MOST_SHOWN} more: --json prints all"] if len(rows) > MOST_SHOWN else []
        console.print(Table(str(file), ["verdict", "reason", "run"], rows[:MOST_SHOWN], notes))
    if any(finding.verdict == validation.MISMATCH for finding in findings):
        sys.exit(1)


def compare(
    a: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="A")],
    b: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="B")],
    domain: Names,
    split: str = "test",
    k: int = 1,
    protocol: str = "honest",
    row: Text = None,
    as_json: Json = False,
) -> None:
    """Compare two predictors, or two files of results, in pairs of the same people.

    Args:
        a: A predictor (name, spec or module:Class), or a file or folder of results.
        b: Another of the same sort.
        domain: Domain that two predictors are scored on; once for each.
        split: Split to score.
        k: Samples per agent.
        protocol: honest or paper.
        row: Predictor to take from files that have several.
        as_json: Print JSON in place of a table.
    """
    files = [Path(name).exists() for name in (a, b)]
    if all(files) and not domain:
        runs = []
        for name in (a, b):
            content = validation.read(Path(name))
            problems = [f for f in validation.validate(content, 0) if f.verdict == validation.MISMATCH]
            if problems:
                raise SpecError(f"{name} has wrong runs, as {problems[0].run}: {problems[0].reason}.")
            runs.append([run for run in content if row is None or row_name(run.get("predictor", "")) == row])
        comparisons = comparison.compare_results(*runs)
    elif any(files) and not domain:
        missing = a if not files[0] else b
        raise SpecError(f"There is no file `{missing}`: compare two files, or two predictors with --domain.")
    elif not domain:
        raise SpecError("No domain was named: add --domain eth. (To compare files of results, name two that exist.)")
    else:
        options = {"split": split, "k": k, "protocol": protocol}
        comparisons = [each for place in domain for each in comparison.compare_predictors(a, b, place, **options)]
    if as_json:
        print_json(in_json(comparisons))
    else:
        console.print(comparison.comparison_table(comparisons))
