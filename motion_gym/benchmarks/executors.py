"""Executors that compute the jobs of a benchmark: processes of this machine, or the nodes of a Ray cluster."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from motion_gym import cluster
from motion_gym.specs import whole_number

Opener = Callable[[int], concurrent.futures.Executor | None]
"""Opens the executor of a number of jobs; None where this process computes them."""


class _Pool(concurrent.futures.ProcessPoolExecutor):
    """Processes that are ended, with what they compute, when an exception leaves the pool, as by Ctrl-C."""

    def __exit__(self, kind: Any, value: Any, traceback: Any) -> None:
        if kind is not None:
            workers = list((self._processes or {}).values())
            self.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.terminate()
        super().__exit__(kind, value, traceback)


def here(jobs: int) -> None:
    """Compute in this process, one job after the other."""


def processes(most: int) -> Opener:
    """Compute with at most this number of processes of this machine.

    Raises:
        SpecError: the number is below 1 or far above the number of cores.
    """
    most = whole_number("jobs", most, 1, 4 * (os.cpu_count() or 1))

    def open_pool(jobs: int) -> concurrent.futures.Executor | None:
        if most == 1 or jobs < 2:
            return None
        context = multiprocessing.get_context("spawn")
        # Ctrl-C reaches every process of a terminal: this one ends the others.
        ignore = (signal.SIGINT, signal.SIG_IGN)
        return _Pool(min(most, jobs), mp_context=context, initializer=signal.signal, initargs=ignore)

    return open_pool


def ray(address: str | None = None, gpus: float = 0.0, results: Path | None = None) -> Opener:
    """Compute on the nodes of a Ray cluster, each job a task.

    Args:
        address: Address of the head node, see ``cluster.connect``.
        gpus: GPUs that a task reserves; a fraction lets several tasks share a GPU.
        results: Folder of results, which is not sent to the nodes.

    Raises:
        SpecError: Ray is not installed.
    """
    cluster.check_installed()

    def open_tasks(jobs: int) -> concurrent.futures.Executor | None:
        if not jobs:
            return None
        cluster.connect(address, results)
        return cluster.Tasks(gpus)

    return open_tasks
