"""The command line, ``motion-gym``: its commands, and how errors are shown."""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import tyro
from rich.markup import escape

from motion_gym.cli.adapt import adapt
from motion_gym.cli.check import check
from motion_gym.cli.claims import claims
from motion_gym.cli.data import data
from motion_gym.cli.exchange import compare, validate
from motion_gym.cli.inspect import inspect
from motion_gym.cli.ls import ls
from motion_gym.cli.output import Terminal, only_json
from motion_gym.cli.report import report, serve
from motion_gym.cli.run import run
from motion_gym.cli.score import score
from motion_gym.cli.show import show
from motion_gym.cli.stopping import Stopped, stop_on_signals
from motion_gym.cli.train import import_weights, train
from motion_gym.cli.weights import weights
from motion_gym.contract import MotionGymError
from motion_gym.specs import suggest

COMMANDS: dict[str, Callable[..., Any]] = {
    "score": score,
    "run": run,
    "adapt": adapt,
    "train": train,
    "import-weights": import_weights,
    "ls": ls,
    "check": check,
    "inspect": inspect,
    "show": show,
    "compare": compare,
    "validate": validate,
    "claims": claims,
    "report": report,
    "serve": serve,
    "data": data,
    "weights": weights,
}
PURPOSE = "Test motion forecasters where they will be used."
OWN_CODE = re.compile(r"(^|[=,])[^\W\d][\w.]*:[^\W\d]\w*($|[:,])")
"""An argument that names ``module:Class``, which finds modules of the working folder; no other command does."""
RESUMED = ("score", "run", "adapt", "train")
"""Commands with ``--resume``."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; errors are shown as one message, with exit status 2."""
    if arguments is None:
        stop_on_signals()
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    if arguments == ["--version"]:
        print(f"motion-gym {importlib.metadata.version('motion-gym')}")
        return
    if arguments and arguments[0] not in COMMANDS and not arguments[0].startswith("-"):
        _fail(f"There is no command `{arguments[0]}`.{suggest(arguments[0], COMMANDS)} See `motion-gym --help`.")
    if any(map(OWN_CODE.search, arguments)):
        sys.path.insert(0, os.getcwd())
    warnings.showwarning = _show_warning
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # not every locale has all characters of a table
    try:
        with only_json() if "--json" in arguments else contextlib.nullcontext():
            tyro.extras.subcommand_cli_from_dict(
                COMMANDS,
                prog="motion-gym",
                description=f"{PURPOSE} `motion-gym --version` prints the version.",
                args=arguments,
            )
        sys.stdout.flush()
    except MotionGymError as error:
        _fail(str(error))
    except KeyboardInterrupt as stop:
        kept = "--out" in arguments or arguments[0] in ("run", "train")
        go_on = (
            " What is finished is kept, of a training its last checkpoint if it had one: the same command with "
            "--resume goes on."
            if kept
            else ""
        )
        _print(f"Stopped.{go_on if arguments[0] in RESUMED else ''}")
        sys.exit(128 + (stop.number if isinstance(stop, Stopped) else signal.SIGINT))
    except BrokenPipeError:
        os._exit(0)  # the reader of the output has ended
    except Exception as error:
        if os.environ.get("MOTION_GYM_DEBUG"):
            raise
        _fail(f"{type(error).__name__}: {error}. (MOTION_GYM_DEBUG=1 shows where.)")


def _fail(message: str) -> None:
    _print(f"[bold red]error:[/bold red] {escape(message)}")
    sys.exit(2)


def _show_warning(message: Warning | str, *where: Any, **more: Any) -> None:
    _print(f"[bold yellow]warning:[/bold yellow] {escape(str(message))}")


def _print(text: str) -> None:
    Terminal(stderr=True).print(text, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
