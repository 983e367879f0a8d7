"""Mutants of the metrics and clocks, as mutmut makes and tests them in the folder ``mutants``; messages are left out.

``python -m tests.soak.mutants names FOLDER`` prints the names of the mutants that change more than the text of an error
or a warning, for ``mutmut run``; ``... page FOLDER PAGE`` writes the outcome into a block of a page.
"""

from __future__ import annotations

import ast
import collections
import difflib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

from motion_gym.benchmarks.reports.marked_block import insert
from motion_gym.benchmarks.reports.table import Code, Table

KILLED, SURVIVED, UNTESTED = "killed", "survived", "not tested"
SHOWN = 60
"""Characters of a line of a survivor."""


class _WithoutMessages(ast.NodeTransformer):
    """Drops the arguments of exceptions that are raised, of warnings, and docstrings."""

    def visit_Raise(self, node: ast.Raise) -> ast.Raise:
        if isinstance(node.exc, ast.Call):
            node.exc.args, node.exc.keywords = [], []
        return node

    def visit_Call(self, node: ast.Call) -> ast.Call:
        self.generic_visit(node)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "warn":
            node.args, node.keywords = [], []
        return node


def mutants(file: Path) -> Iterator[tuple[str, str, bool]]:
    """The name of each mutant of a file, the changed line, and whether only a message changed."""
    text = file.read_text()
    functions = {
        node.name: node
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }
    for name, node in functions.items():
        base, mark, number = name.rpartition("__mutmut_")
        if not mark or not number.isdigit():
            continue
        original = functions[f"{base}__mutmut_orig"]
        for each in (original, node):
            each.name = base
        before, after = (ast.unparse(each).splitlines() for each in (original, node))
        changed = [line[1:].strip() for line in difflib.ndiff(before, after) if line.startswith("+ ")]
        plain = [ast.dump(_WithoutMessages().visit(ast.parse(ast.unparse(each)))) for each in (original, node)]
        original.name, node.name = f"{base}__mutmut_orig", name
        yield name, (changed or [""])[0], plain[0] == plain[1]


def _name_of(function: str) -> str:
    """Name of the function that a mutant was made of."""
    return function.rpartition("__mutmut_")[0].removeprefix("x_").removeprefix("xǁ").replace("ǁ", ".")


def outcomes(folder: Path) -> Iterator[tuple[str, str, str, str]]:
    """Full name, module, changed line and outcome of each mutant that is no message."""
    for meta in sorted(folder.rglob("*.py.meta")):
        codes = json.loads(meta.read_text())["exit_code_by_key"]
        file = meta.with_suffix("")
        lines = {name: (line, message) for name, line, message in mutants(file)} if codes else {}
        for key, code in codes.items():
            line, message = lines[key.rpartition(".")[2]]
            if not message:
                outcome = UNTESTED if code is None else SURVIVED if code in (0, 33) else KILLED
                yield key, file.relative_to(folder).as_posix(), line, outcome


def page(folder: Path, path: Path) -> None:
    """Write two tables into a page: the counts of each module, and the survivors."""
    counts: dict[str, collections.Counter[str]] = {}
    survivors = []
    for key, module, line, outcome in outcomes(folder):
        counts.setdefault(module, collections.Counter())[outcome] += 1
        if outcome == SURVIVED:
            survivors.append([Code(module), Code(_name_of(key.rpartition(".")[2])), Code(line[:SHOWN])])
    total = sum(counts.values(), collections.Counter())
    rows = [
        [Code(module) if module else "all", *(str(each[name]) for name in (KILLED, SURVIVED, UNTESTED)), _share(each)]
        for module, each in [*counts.items(), ("", total)]
    ]
    tables = [
        Table("", ["module", KILLED, SURVIVED, UNTESTED, "killed, of those tested"], rows),
        Table("", ["module", "function", "changed line of the survivor"], survivors),
    ]
    insert(path, "mutants", "\n\n".join(table.markdown() for table in tables))


def _share(counts: collections.Counter[str]) -> str:
    tested = counts[KILLED] + counts[SURVIVED]
    return f"{100 * counts[KILLED] / tested:.0f} %" if tested else "-"


if __name__ == "__main__":
    if sys.argv[1] == "names":
        print(*(key for key, _, _, outcome in outcomes(Path(sys.argv[2])) if outcome == UNTESTED), sep="\n")
    else:
        page(Path(sys.argv[2]), Path(sys.argv[3]))
