"""What to write for a class of one's own that is named in another form than ``module:Class``."""

from __future__ import annotations

import ast
import os
import re
from pathlib import Path

CALL = re.compile(r"([\w./]+):+([A-Za-z_]\w*)(?:,(.*=.*)|\((.*=.*)?\))?", re.DOTALL)
"""A class whose parameters follow a comma or are in parentheses, or a class after two colons."""


def class_hint(name: str, made_by: str | None = None, classes: bool = True) -> str:
    """Sentence for an unknown name that is a Python file, its module or an object of it; empty for other names.

    The file is parsed, not run.

    Args:
        name: ``steady``, ``steady.Damped``, ``steady.py`` or ``steady.py:Damped``.
        made_by: Name of a class whose objects are looked for; None to look for none.
        classes: Whether classes themselves are looked for.
    """
    module, _, class_name = name.partition(":")
    file = module if module.endswith(".py") else f"{module.replace('.', '/')}.py"
    dotted, elsewhere = _module_of(file)
    if class_name:
        return f" Write `{dotted}:{class_name}`, without .py{elsewhere}." if file == module else ""
    if os.path.isfile(file):
        names = _names_in(file, made_by, classes) or ["Class" if classes else "OBJECT"]
        choice = " or ".join(f"`{dotted}:{known}`" for known in names)
        return f" {file} is here: write {choice}{elsewhere}."
    package, _, class_name = module.rpartition(".")
    file = f"{package.replace('.', '/')}.py"
    return f" Did you mean `{package}:{class_name}`?" if class_name in _names_in(file, made_by, classes) else ""


def call_hint(spec: str) -> str | None:
    """The spec that is meant by ``steady:Damped,damping=0.9``, ``steady:Damped(damping=0.9)`` or ``steady::Damped``.

    None for other specs.
    """
    match = CALL.fullmatch(spec.strip())
    if match is None:
        return None
    parameters = match[3] or match[4]
    return f"{match[1].removesuffix('.py')}:{match[2]}" + (f":{parameters}" if parameters else "")


def _module_of(file: str) -> tuple[str, str]:
    """The module of a file, and from where to run if it cannot be imported from the working folder."""
    path, folder = Path(os.path.abspath(file)), Path.cwd()
    if not path.is_relative_to(folder):
        return path.stem, f", and run from {path.parent}"
    missing = "" if path.is_file() else f", and run from the folder that holds {path.name}"
    return ".".join(path.relative_to(folder).with_suffix("").parts), missing


def _names_in(file: str, made_by: str | None, classes: bool) -> list[str]:
    """The public objects of a class and classes of a file; none if the file cannot be read or parsed."""
    try:
        nodes = ast.parse(Path(file).read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return []
    assigned = ((node.targets[0], node.value) for node in nodes if isinstance(node, ast.Assign))
    calls = ((target, value.func) for target, value in assigned if isinstance(value, ast.Call))
    names = [ast.unparse(target) for target, maker in calls if ast.unparse(maker).rpartition(".")[2] == made_by]
    names += [node.name for node in nodes if isinstance(node, ast.ClassDef) and classes]
    return [name for name in names if not name.startswith("_")]
