"""What ``ls NAME`` says about each kind of thing that has the name."""

from __future__ import annotations

import inspect
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from motion_gym import catalog
from motion_gym.benchmarks.objects import Benchmark
from motion_gym.benchmarks.running import BENCHMARKS, benchmark
from motion_gym.contract import SpecError
from motion_gym.data.datasets import DATASETS
from motion_gym.metrics.errors import METRICS
from motion_gym.own_classes import class_hint
from motion_gym.scoring.evaluation import PROTOCOLS

ARGUMENT = re.compile(r"^    (\w+): (.*(?:\n {8,}.*)*)", re.MULTILINE)
"""An argument of a docstring and its text."""
REFERENCE = re.compile(r"See ``(\w+)``(?:; (.*))?\.", re.DOTALL)
"""The text of an argument that another class describes, and what is different here."""
STARS: Mapping[Any, str] = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
"""What precedes the name of an argument, by its kind."""
WIDTH = 120
"""Characters of a line of a docstring."""
CLASSES = {"domain": catalog.DOMAINS, "predictor": catalog.PREDICTORS, "adapter": catalog.ADAPTERS}
"""Tables of classes, by their kind."""


def explanations(name: str) -> list[dict[str, str]]:
    """Kind, name, signature and description of everything that has a name.

    Args:
        name: Domain, predictor, adapter, benchmark, protocol, metric or data set; or ``module:Class``, or a benchmark
            ``module:OBJECT``.

    Raises:
        SpecError: nothing has the name.
    """
    found = [*_classes(name), *_others(name)]
    if not found:
        known = {*BENCHMARKS, *PROTOCOLS, *DATASETS, *(metric.name for metric in METRICS)}.union(*CLASSES.values())
        hint = class_hint(name, Benchmark.__name__) or f"{catalog.suggest(name, known)} Your own: `module:Class`."
        raise SpecError(f"There is nothing of the name `{name}`.{hint}")
    keys = ("kind", "name", "signature", "description")
    return [dict(zip(keys, values, strict=True)) for values in found]


def _classes(name: str) -> Iterator[tuple[str, str, str, str]]:
    target, _ = catalog.parse_spec(name)
    if ":" in target:
        loaded = catalog.load_object(target, "class or benchmark", (type, Benchmark))
        if isinstance(loaded, Benchmark):
            yield "benchmark", name, "", _described(loaded, name)
        else:
            loaded = catalog.load_class(target)  # says what is no class
            yield "class", name, signature(loaded), documentation(loaded)
    entries = {kind: table[target] for kind, table in CLASSES.items() if target in table}
    for entry in {id(entry): entry for entry in entries.values()}.values():
        kinds = " and ".join(kind for kind, other in entries.items() if other is entry)
        loaded = catalog.load_class(entry.target)
        yield kinds, name, signature(loaded, entry.parameters), documentation(loaded)


def _others(name: str) -> Iterator[tuple[str, str, str, str]]:
    if name in BENCHMARKS:
        yield "benchmark", name, "", _described(benchmark(name), name)
    if name in PROTOCOLS:
        yield "protocol", name, "", f"{PROTOCOLS[name]}\n\nmotion-gym score PREDICTOR --domain DOMAIN --protocol {name}"
    for metric in METRICS:
        number = re.fullmatch(re.escape(metric.name).replace(r"\{k\}", r"(\d+|\{k\})"), name)
        if number:
            text = metric.description.replace("{k}", number[1] if metric.needs_samples else "")
            better = "lower" if metric.lower_is_better else "higher"
            units = {"m": "m, or the unit of the domain", "1": "none, a share from 0 to 1"}
            unit = units.get(metric.unit, metric.unit)
            yield "metric", name, "", f"{text}\n\nUnit: {unit}; {better} is better."
    if name in DATASETS:
        yield "data set", name, "", f"{DATASETS[name].title}\n\nmotion-gym data verify {name}"


def signature(kind: type, implied: Mapping[str, Any] | None = None) -> str:
    """Names, plain types and defaults of the arguments of a class; a name of the table may imply other defaults."""
    arguments = []
    for argument in inspect.signature(kind).parameters.values():
        stars = STARS.get(argument.kind, "")
        default = (implied or {}).get(argument.name, argument.default)
        plain_type = _type_of(argument.annotation)
        equals = " = " if plain_type else "="
        written = "" if default is argument.empty else f"{equals}{default!r}"
        arguments.append(f"{stars}{argument.name}{plain_type}{written}")
    return f"({', '.join(arguments)})"


def _type_of(annotation: Any) -> str:
    """``: type`` without the InitVar of a dataclass; empty for any type."""
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    text = re.sub(r"^(?:dataclasses\.)?InitVar\[(.*)\]$", r"\1", text.strip("'\""))
    return "" if annotation is inspect.Parameter.empty or text in ("Any", "typing.Any") else f": {text}"


def documentation(kind: type) -> str:
    """The docstring of a class, with the texts of arguments that other classes describe."""

    def written_out(match: re.Match[str]) -> str:
        text = _text_of(kind, match[1], match[2])
        return match[0] if text == match[2] else _wrapped(f"{match[1]}: {text}", " " * 4, " " * 8)

    texts = [inspect.getdoc(kind) or "It has no docstring."]
    parent = next((k for k in kind.__mro__[1:] if k.__doc__ and "## Arguments" in k.__doc__), None)
    if parent is not None and "## Arguments" not in (kind.__doc__ or ""):
        texts.append(inspect.getdoc(parent) or "")
    return ARGUMENT.sub(written_out, "\n\n".join(texts))


def _text_of(kind: type, argument: str, text: str) -> str:
    """The text of an argument; in place of ``See ``Class```` that of the class."""
    reference = REFERENCE.fullmatch(text)
    owner = _class_of(kind, reference[1]) if reference else None
    texts = dict(ARGUMENT.findall(inspect.getdoc(owner) or "")) if owner is not None else {}
    if reference is None or owner is None or argument not in texts:
        return text
    further = reference[2] and f" {reference[2][0].upper()}{reference[2][1:]}."
    return _text_of(owner, argument, texts[argument]) + (further or "")


def _class_of(kind: type, name: str) -> type | None:
    """The class that a docstring of another class names: a parent, or a class of the same module."""
    parents = {parent.__name__: parent for parent in kind.__mro__}
    return parents.get(name) or getattr(sys.modules[kind.__module__], name, None)


def _described(shown: Benchmark, name: str) -> str:
    """The tables of a benchmark, with their columns and rows."""
    tables: list[tuple[str, Sequence[str], Sequence[str]]] = [
        (
            part.title,
            [column if column == spec else f"{column} ({spec})" for column, spec in part.domains.items()],
            [*part.plain, *part.trained, *(row.name for row in part.external)],
        )
        for part in shown.parts
    ]
    tables += [(shifts.title, [*shifts.streams], shifts.all_rows()) for shifts in shown.shifts.values()]
    tables += [(drives.title, [*drives.domains], drives.rows()) for drives in shown.drives]
    lines = [shown.title, f"`motion-gym run {name}` prints the main table, with `--out FOLDER` it writes all."]
    for title, columns, rows in tables:
        texts = (f"columns: {', '.join(columns)}", f"rows: {', '.join(rows)}")
        lines.append("\n".join([title, *(_wrapped(text, " " * 4, " " * 8) for text in texts)]))
    return "\n\n".join(lines)


def _wrapped(text: str, first: str, further: str) -> str:
    return textwrap.fill(
        " ".join(text.split()),
        WIDTH,
        initial_indent=first,
        subsequent_indent=further,
        break_long_words=False,
        break_on_hyphens=False,
    )
