"""Calls of the command line, in this process and in a shell."""

import os
import re
import shlex
import subprocess
import sys

import pytest

from motion_gym.cli.main import main


def call(capsys, line, said=""):
    """Run a command line in this process; returns its output, which fits 80 columns.

    ``said`` is part of what it says on the error stream, which is empty otherwise.
    """
    main(shlex.split(line))
    captured = capsys.readouterr()
    assert said in captured.err if said else captured.err == ""
    assert (
        max(map(len, captured.out.splitlines()), default=0) <= 80
        or line.startswith(("run", "weights"))
        or "data" in line
    )
    return captured.out


def fail(capsys, line):
    """Run a command line that must end with status 2 and one message; returns its output."""
    with pytest.raises(SystemExit) as stopped:
        main(shlex.split(line))
    captured = capsys.readouterr()
    assert stopped.value.code == 2
    assert "error: " in captured.err and "Traceback" not in captured.err
    return captured


def shell(line, cwd, **environment):
    """Run a command line in a shell."""
    return subprocess.run(
        [sys.executable, "-m", "motion_gym", *shlex.split(line)],
        cwd=cwd,
        env={**os.environ, "COLUMNS": "80", **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def rows(out):
    """Predictor and mean ADE of each line of the printed tables."""
    return [(m[1], m[2]) for m in re.finditer(r"^  ([a-z_:]\S*)(?: \(oracle\))? +(\d*\.\d{3}) ", out, re.MULTILINE)]
