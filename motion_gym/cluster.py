"""A Ray cluster: connecting to it, and calling functions on its nodes."""

from __future__ import annotations

import concurrent.futures
import importlib.util
import logging
import os
import socket
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from motion_gym.contract import PredictorError, SpecError
from motion_gym.training.provenance import versions

RETRIES = 3
"""How often Ray starts a task again whose node or process has died."""
SECONDS_TO_CONNECT = 5.0
"""Longest time until the head node accepts a connection; Ray itself would try for minutes."""
NOT_SENT = (".git", ".venv*", "__pycache__")
"""Parts of the working folder that the nodes do not receive, besides what .gitignore names."""


def check_installed() -> None:
    """Raise SpecError unless Ray is installed."""
    if importlib.util.find_spec("ray") is None:
        raise SpecError(
            'The executor `ray` needs Ray, which is not installed: pip install "motion-gym[ray]" (from a checkout: '
            'pip install ".[ray]").'
        )


def connect(address: str | None, results: Path | None = None) -> None:
    """Connect this process to a cluster until the process ends; a connection that is there already is used.

    The nodes receive the working folder, once each: the modules, weights and tracks in it are found there by the same
    relative paths. Data sets are read from the data folder of each node.

    Args:
        address: Address of the head node, as ``10.0.0.1:6379``; by default the cluster of this machine, which is
            started if there is none.
        results: Folder of results, which is not sent.

    Raises:
        SpecError: the cluster cannot be used, or the working folder cannot be sent.
    """
    if address:  # read when Ray is imported: one attempt of 40 s where another server answers, instead of 20
        os.environ.setdefault("RAY_NUM_REDIS_GET_RETRIES", "1")
    import ray

    if ray.is_initialized():
        return
    where = f"The Ray cluster `{address}`" if address else "The Ray cluster of this machine"
    host, _, port = (address or "").rpartition(":")
    if address and not (host and port.isdecimal()):
        raise SpecError(f"`--address {address}` is no address: write HOST:PORT of the head node, as 10.0.0.1:6379.")
    if address:
        try:
            socket.create_connection((host, int(port)), SECONDS_TO_CONNECT).close()
        except (OSError, OverflowError) as error:
            raise SpecError(
                f"{where} does not answer: {error}. Start its head node, `ray start --head --port=6379`, or name the "
                "address that this command printed."
            ) from None
    excludes = [*NOT_SENT]
    if results is not None and results.absolute().is_relative_to(Path.cwd()):
        excludes.append(f"/{results.absolute().relative_to(Path.cwd())}")
    try:
        ray.init(
            address=address,
            runtime_env={"working_dir": os.getcwd(), "excludes": excludes},
            logging_level=logging.ERROR,
        )
    except (OSError, ValueError, RuntimeError) as error:
        reason = str(error).rstrip(". ")
        raise SpecError(
            f"{where} cannot be used: {reason}. Run on a node of the cluster, in a folder that holds little more than "
            "your modules, weights and tracks."
        ) from None


class Tasks(concurrent.futures.Executor):
    """Calls functions as Ray tasks.

    Args:
        gpus: GPUs that a task reserves.
    """

    def __init__(self, gpus: float):
        import ray

        self.task = ray.remote(_on_node).options(num_cpus=1, num_gpus=gpus, max_retries=RETRIES)
        self.pending: dict[concurrent.futures.Future[Any], Any] = {}
        if not any(
            node["Alive"] and node["Resources"].get("CPU", 0) >= 1 and node["Resources"].get("GPU", 0) >= gpus
            for node in ray.nodes()
        ):
            needs = f"1 CPU and {gpus:g} GPUs" if gpus else "1 CPU"
            warnings.warn(f"No node has {needs}: the tasks wait until one joins.", RuntimeWarning, stacklevel=2)

    def submit(self, function: Any, /, *arguments: Any, **options: Any) -> concurrent.futures.Future[Any]:
        """Call a function of an importable module on a node."""
        reference = self.task.remote(function, arguments, options, sys.argv, versions()["motion-gym"])
        future: concurrent.futures.Future[Any] = concurrent.futures.Future()
        self.pending[future] = reference

        def finish(done: concurrent.futures.Future[Any]) -> None:
            self.pending.pop(future, None)
            if error := done.exception():
                future.set_exception(_cause(error))
            else:
                future.set_result(done.result())

        reference.future().add_done_callback(finish)
        return future

    def __exit__(self, kind: Any, value: Any, traceback: Any) -> None:
        self.shutdown(wait=kind is None, cancel_futures=kind is not None)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Cancel the tasks that are not finished, if they are to be cancelled, or wait for them."""
        import ray

        for future, reference in list(self.pending.items()):
            if cancel_futures:
                ray.cancel(reference, force=True)
            elif wait:
                concurrent.futures.wait([future])


def _on_node(function: Any, arguments: Sequence[Any], options: dict[str, Any], command: list[str], version: str) -> Any:
    """Call a function in a process of a node, for a command with these arguments."""
    sys.argv = command  # provenance names it
    if (here := versions()["motion-gym"]) != version:
        raise SpecError(
            f"motion-gym {here} is installed on the node {socket.gethostname()}, and {version} where the command runs: "
            "install the same version on all nodes."
        )
    return function(*arguments, **options)


def _cause(error: BaseException) -> BaseException:
    """The exception that a task raised, or a PredictorError if Ray could not finish the task."""
    from ray.exceptions import RayError, RayTaskError

    if isinstance(error, RayTaskError) and isinstance(error.cause, BaseException):
        return error.cause
    if isinstance(error, RayError):
        first = str(error).strip().partition("\n")[0]
        return PredictorError(f"Ray could not finish it, after {RETRIES} retries: {type(error).__name__}: {first}")
    return error
