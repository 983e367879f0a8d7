"""Pages of the site that are made when it is built: the reference, and the files that pages link to outside docs.

mkdocs calls ``on_config``, ``on_files`` and ``on_page_markdown``. Everything is read from the tables of names, the
classes and their docstrings.
"""

from __future__ import annotations

import inspect
import os
import posixpath
import re
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import motion_gym
from motion_gym import catalog, contract
from motion_gym.benchmarks.objects import Benchmark
from motion_gym.benchmarks.page import page, scenes
from motion_gym.benchmarks.running import BENCHMARKS, benchmark
from motion_gym.benchmarks.store import SHIPPED
from motion_gym.metrics.errors import METRICS

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"(\]\()([^)#\s:]+)((?:#[^)]*)?\))")
AT_THE_ROOT = {"index.md": "README.md", "contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
"""Pages of the site that are files at the root of the repository."""
AS_THEY_ARE = (".md", ".svg")
"""Endings of linked files outside docs that are pages or pictures; others become pages that show the file."""
RESULTS_PAGE = "motion-gym-results.html"
"""The results page, as ``motion-gym report`` writes it."""
PICTURES = {
    "orca": ("orca:agents=10,d=0.5,scenes=50", "constant_velocity"),
    "highway": ("highway:scenario=roundabout,runs=1", "constant_velocity"),
    "walkers": ("walkers:people=3,turn=10,noise=0.1,scenes=1", "kalman_velocity"),
}
"""Simulated domains that are drawn: spec, and predictor."""
EXAMPLES = {
    "tracks": "tracks:path=walk.csv,fps=25",
    "highway": "highway:style=aggressive",
    "orca": "orca:d=0.6",
    "sdd": "sdd:speed=3.25-3.75",
    "orca_oracle": "orca:d=0.6",
    "idm_oracle": "highway:style=aggressive",
}
"""Specs in the example commands of domains, and domains in those of predictors that need a certain one."""


def pages() -> dict[str, str]:
    """Every generated page of the reference, by its path in the site."""
    kinds: tuple[tuple[str, Iterable[str], Callable[[str], str]], ...] = (
        ("domains", catalog.DOMAINS, _domain),
        ("predictors", catalog.PREDICTORS, _predictor),
        ("adapters", catalog.ADAPTERS, _adapter),
        ("benchmarks", BENCHMARKS, _benchmark),
    )
    made = {f"reference/{kind}/{name}.md": page(name) for kind, names, page in kinds for name in names}
    made["reference/metrics.md"] = _metrics()
    made["reference/contract.md"] = _contract()
    return made


def on_config(config: Any) -> Any:
    """Put the reference into the navigation, where mkdocs.yml has ``Reference``, and the results page."""
    nested: dict[str, Any] = {}
    for path in pages():
        kind, _, name = path.removeprefix("reference/").partition("/")
        if name:
            nested.setdefault(kind.capitalize(), []).append({name.removesuffix(".md"): path})
        else:
            nested[kind.removesuffix(".md").capitalize()] = path
    for entry in config.nav:
        if "Reference" in entry:
            entry["Reference"] = [{title: below} for title, below in nested.items()]
        if "Results" in entry:
            entry["Results"].append({"Open the results page": RESULTS_PAGE})
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages at the root of the repository, the reference, its pictures, and each linked file outside docs."""
    from mkdocs.structure.files import File  # the tests read the pages without mkdocs

    def add(path: str, **content: Any) -> None:
        files.append(File.generated(config, path, **content))

    for path, name in AT_THE_ROOT.items():
        add(path, content=LINK.sub(_from_the_root, (ROOT / name).read_text()))
    for path, text in pages().items():
        add(path, content=text)
    for name, (spec, predictor) in PICTURES.items():
        drawn = Path(tempfile.mkdtemp()) / f"{name}.svg"
        motion_gym.show(spec, predictor, out=drawn)
        add(f"reference/domains/{name}.svg", content=drawn.read_bytes())
    page.write(results := Path(tempfile.mkdtemp()) / RESULTS_PAGE, None, scenes.read(None))
    add(RESULTS_PAGE, content=results.read_bytes())
    for path in sorted(_outside() - set(map(Path, AT_THE_ROOT.values()))):
        if path.suffix in AS_THEY_ARE:
            add(str(path), abs_src_path=str(ROOT / path))
        else:
            language = {".py": "python", ".cff": "yaml"}[path.suffix]
            add(f"{path}.md", content=f"# {path.name}\n\n```{language}\n{(ROOT / path).read_text()}```\n")
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn links to files outside docs into links to their pages."""
    folder = posixpath.dirname(page.file.src_uri)

    def turned(match: re.Match[str]) -> str:
        target = _root_path(folder, match[2])
        if target is None:
            return match[0]
        there = target if target.endswith(AS_THEY_ARE) else f"{target}.md"
        there = {name: path for path, name in AT_THE_ROOT.items()}.get(target, there)
        return match[1] + posixpath.relpath(there, folder or ".") + match[3]

    return LINK.sub(turned, markdown)


def _root_path(folder: str, link: str) -> str | None:
    """A link that leads out of docs, or from there to a file beside it, as a path from the root of the repository."""
    inside = posixpath.normpath(posixpath.join(folder, link))
    if inside.startswith("../"):
        return inside.removeprefix("../")
    return inside if folder and not folder.startswith("reference") and (ROOT / inside).is_file() else None


def _outside() -> set[Path]:
    """Files outside docs that pages link to, and files that those link to."""
    found: set[Path] = set()
    ahead = [(path.parent, path) for path in (*(ROOT / "docs").glob("*.md"), *map(ROOT.joinpath, AT_THE_ROOT.values()))]
    ahead += [(path.parent, path) for path in SHIPPED.glob("*/tables.md")]
    found |= {path.relative_to(ROOT) for ending in AS_THEY_ARE for path in SHIPPED.glob(f"*/*{ending}")}
    while ahead:
        folder, page = ahead.pop()
        for _, link, _ in LINK.findall(page.read_text()):
            path = Path(os.path.normpath(folder / link))
            inside = path.is_relative_to(ROOT) and not path.is_relative_to(ROOT / "docs") and path.is_file()
            if inside and path.relative_to(ROOT) not in found:
                found.add(path.relative_to(ROOT))
                ahead += [(path.parent, path)] if path.suffix == ".md" else []
    return found


def _from_the_root(match: re.Match[str]) -> str:
    """A link of a page at the root of the repository, as seen from docs."""
    link = match[2]
    return match[1] + (link.removeprefix("docs/") if link.startswith("docs/") else f"../{link}") + match[3]


def _domain(name: str) -> str:
    entry = catalog.DOMAINS[name]
    spec = EXAMPLES.get(name, name)
    picture = ""
    if name in PICTURES:
        drawn, predictor = PICTURES[name]
        picture = f"![One scene of {name}]({name}.svg)\n\n`motion-gym show {drawn} --predictor {predictor}`\n"
    command = f"motion-gym score constant_velocity linear --domain {spec}"
    return _page(name, entry, command, picture + f"\nEnvironment: `motion_gym/{entry.env_id}`\n")


def _predictor(name: str) -> str:
    spec = EXAMPLES.get(name)
    if spec is None:
        sigma = "needs PyTorch and sigma" in catalog.PREDICTORS[name].summary
        spec = "eth:alpha=8" if sigma else "orca:d=0.6" if "two agents" in catalog.PREDICTORS[name].summary else "zara1"
    return _page(name, catalog.PREDICTORS[name], f"motion-gym score {name} --domain {spec}")


def _adapter(name: str) -> str:
    command = f"motion-gym adapt modular_invariant --adapter {name} --stream orca:d=0.3 --stream orca:d=0.6"
    return _page(name, catalog.ADAPTERS[name], command)


def _page(name: str, entry: catalog.Entry, command: str, further: str = "") -> str:
    """Name, summary, example, parameters and docstring of an entry of a table of names."""
    kind = catalog.load_class(entry.target)
    implied = f" Implies `{catalog.format_spec('', dict(entry.parameters))[1:]}`." if entry.parameters else ""
    return "\n\n".join(
        [
            f"# `{name}`",
            f"{entry.summary[0].upper()}{entry.summary[1:]}.{implied}",
            f"```sh\n{command}\n```",
            further,
            _parameters(kind, entry),
            _prose(kind),
            f"Class: `{entry.target}`",
        ]
    )


def _parameters(kind: type, entry: catalog.Entry) -> str:
    """Table of the parameters of a class: default, what is allowed, and what the docstring says."""
    rows = []
    with tempfile.NamedTemporaryFile("w", suffix=".csv") as file:
        file.write("frame,id,x,y\n" + "".join(f"{10 * i},1,{i},0\n" for i in range(60)))
        file.flush()
        for name, parameter in inspect.signature(kind).parameters.items():
            default = entry.parameters.get(name, parameter.default)
            shown = "required" if default is parameter.empty else f"`{default}`"
            known = {"path": file.name, "of": "modular_invariant"}
            needed = {key: value for key, value in known.items() if key in inspect.signature(kind).parameters}
            allowed = _allowed(kind, {**needed, **entry.parameters}, name)
            rows.append((f"`{name.rstrip('_')}`", shown, allowed, _meaning(kind, name)))
    if not rows:
        return "It has no parameters."
    return "## Parameters\n\n" + _table(("parameter", "default", "allowed", "meaning"), rows)


def _allowed(kind: type, arguments: Mapping[str, Any], name: str) -> str:
    """What a parameter may be, as the message says that refuses the value ``?``; empty if the class accepts it."""
    if name == "of":
        return "a predictor"
    if name == "weights":
        return "a name of shipped weights, or a file"
    try:
        kind(**{**arguments, name: "?"})
    except contract.SpecError as error:
        text = str(error)
    except (contract.MotionGymError, TypeError):
        return ""
    else:
        return ""
    if " must be " in text:
        return text.split(" must be ", 1)[1].split(":")[0].rstrip(".").replace("e+0", "e")
    more = "a number of steps, " if "(or a number of steps)" in text else ""
    return more + text.split(" Known: ")[1].rstrip(".") if " Known: " in text else ""


def _meaning(kind: type, name: str) -> str:
    """The text of a parameter in the docstring of the class, or of the class that the docstring refers to."""
    for owner in kind.__mro__:
        text = _arguments(owner).get(name, "")
        if text and not (refers := re.match(r"See ``(\w+)``[.;] ?(.*)", text)):
            return text
        if text:
            others = {k.__name__: k for e in (catalog.PREDICTORS | catalog.ADAPTERS).values() for k in _classes(e)}
            there = _meaning(others[refers[1]], name) if refers[1] in others else ""
            return f"{there} {refers[2][:1].upper()}{refers[2][1:]}".strip()
    return ""


def _classes(entry: catalog.Entry) -> tuple[type, ...]:
    return catalog.load_class(entry.target).__mro__


def _arguments(kind: type) -> dict[str, str]:
    """Texts of the parameters in the own docstring of a class."""
    match = re.search(r"^Args:\n((?:    .*\n?|\n)+)", inspect.cleandoc(vars(kind).get("__doc__") or ""), re.MULTILINE)
    parts = re.split(r"^    (\w+): ", match[1], flags=re.MULTILINE)[1:] if match else []
    return {name: " ".join(text.split()) for name, text in zip(parts[::2], parts[1::2], strict=True)}


def _prose(kind: type) -> str:
    """The docstring without its sections of arguments; with that of the parent where it describes the domain."""
    parents = [k for k in kind.__mro__[1:] if "## Arguments" in (vars(k).get("__doc__") or "")]
    described = [kind, *parents[:1]] if "## Arguments" not in (kind.__doc__ or "") else [kind]
    texts = [_markdown(inspect.getdoc(k) or "") for k in described]
    return "\n\n".join(texts)


def _markdown(text: str) -> str:
    """A Google docstring as Markdown: its arguments are left out, its other sections become lists."""
    text = re.sub(r"(## Arguments\n)?^Args:\n(?:    .*\n?|\n)+", "", text, flags=re.MULTILINE)
    text = re.sub(r"^(>>> .*\n(?:.+\n?)*)", r"```python\n\1\n```\n", text, flags=re.MULTILINE)
    return re.sub(r"^(Raises|Returns|Attributes):\n((?:    .*\n?|\n)+)", _section, text, flags=re.MULTILINE)


def _section(match: re.Match[str]) -> str:
    """A section of a Google docstring as a list."""
    lines = inspect.cleandoc("\n" + match[2])
    items = re.sub(r"^(?! )(\w+): ", r"- `\1`: ", lines, flags=re.MULTILINE)
    return f"**{match[1]}**\n\n{items}\n\n"


def _benchmark(name: str) -> str:
    chosen: Benchmark = benchmark(name)
    parts = [f"# `{name}`", f"{chosen.title}.", f"```sh\nmotion-gym run {name}\n```"]
    if (SHIPPED / name / "tables.md").exists():
        figures = "".join(
            f"\n\n![{f.stem.replace('_', ' ')}](../../motion_gym/results/{name}/{f.name})"
            for f in sorted((SHIPPED / name).glob("*.svg"))
        )
        parts.append(f"[All tables](../../motion_gym/results/{name}/tables.md){figures}")
    for part in chosen.parts:
        columns = ", ".join(f"{short}: `{spec}`" for short, spec in part.domains.items())
        rows = ", ".join(f"`{row}`" for row in (*part.plain, *part.trained, *(row.name for row in part.external)))
        facts = f"Protocol {part.protocol}, k = 1 and {part.samples}"
        weights = f"; weights `{part.weights}`" if part.weights else ""
        parts.append(f"## {part.title}\n\n{facts}{weights}.\n\n- Columns: {columns}\n- Rows: {rows}")
    for short, shifts in chosen.shifts.items():
        rows = ", ".join(f"`{row}`" for row in shifts.all_rows())
        parts.append(
            f"## {shifts.title}\n\n```sh\nmotion-gym run {name} --shift {short}\n```\n\n"
            f"- Adapted: `{shifts.source}` with weights `{shifts.weights}`\n"
            f"- Streams: {', '.join(shifts.streams)}\n- Rows: {rows}"
        )
    for drives in chosen.drives:
        parts.append(f"## {drives.title}\n\n- Rows: {', '.join(f'`{row}`' for row in drives.rows())}")
    for study in chosen.studies:
        parts.append(f"Further values: `{study.name}`, computed by `{study.compute}`.")
    return "\n\n".join(parts)


def _metrics() -> str:
    """Every metric: unit, direction, description, and the docstring of its function."""
    rows = [(f"`{m.name}`", m.unit, "lower" if m.lower_is_better else "higher", m.description) for m in METRICS]
    functions = {f.__name__: f for m in METRICS if inspect.isfunction(f := getattr(m.function, "func", m.function))}
    texts = [f"## `{name}`\n\n{_markdown(inspect.getdoc(f) or '')}" for name, f in functions.items()]
    table = _table(("name", "unit", "better", "description"), rows).replace("{k}", "k")
    example = "```sh\nmotion-gym score kalman_velocity --domain orca:d=0.6 --k 20 --json\n```"
    return "\n\n".join(["# Metrics", example, table, *texts])


def _contract() -> str:
    """The docstrings of the contract."""
    names = ("Observation", "Truth", "Forecast", "Recording", "Card", "Predictor", "Domain")
    texts = [f"# Contract\n\n{_markdown(inspect.getdoc(contract) or '')}"]
    for name in names:
        kind = getattr(contract, name)
        texts.append(f"## `{name}`\n\n{_markdown(inspect.getdoc(kind) or '')}")
    texts.append(f"## `predict`\n\n{_markdown(inspect.getdoc(contract.Predictor.predict) or '')}")
    return "\n\n".join(texts)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |" for line in lines)
