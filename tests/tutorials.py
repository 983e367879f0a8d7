"""Runs a tutorial of the docs as a newcomer does: its files are saved, its commands run, its output compared."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(r'^```(?:{ \.)?(\w+)(?: title="([^"]+)")?(?: })?\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def follow(page, folder):
    """Run the blocks of a page in order: titled blocks are files, `sh` and `python` run, `text` must be printed.

    Returns:
        What the last block printed, with its whitespace collapsed.
    """
    said, ran = "", 0
    for language, name, text in BLOCK.findall((ROOT / "docs" / page).read_text()):
        text = re.sub(r'--8<-- "([^"]+)"\n', lambda match: (ROOT / match[1]).read_text(), text)
        if name:
            (folder / name).write_text(text)
        elif language == "text":
            missing = [line for line in text.splitlines() if " ".join(line.split()) not in said]
            assert not missing, f"{missing} is not in the output of the commands before: {said}"
        elif language == "python":
            said, ran = _run(folder, ["-c", text]), ran + 1
        elif language == "sh":
            commands = [shlex.split(line, comments=True) for line in text.replace("\\\n", " ").splitlines()]
            said, ran = " ".join(_run(folder, _arguments(command)) for command in commands), ran + len(commands)
    assert ran, f"{page} has no command"
    return said


def _arguments(command):
    program, *arguments = command
    return {"motion-gym": ["-m", "motion_gym"], "python": []}[program] + arguments


def _run(folder, arguments):
    """What a program prints, with its whitespace collapsed."""
    paths = [path for path in (str(ROOT), os.environ.get("PYTHONPATH")) if path]
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "COLUMNS": "250", "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, f"{arguments}: {done.stdout}{done.stderr}"
    return " ".join(done.stdout.split())
