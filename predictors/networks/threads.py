"""Jobs side by side: each with kernels and matrix products of its own, in as many threads as torch is set to."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import TypeVar

import numpy as np
import torch

Part = TypeVar("Part")
Result = TypeVar("Result")

CACHED = 160_000
"""Values that a job works on at a time: about a third of the second-level cache of a core."""


def slices(count: int, values: int) -> list[slice]:
    """Cut ``count`` things of so many values each into pieces that stay in the cache and keep all threads busy."""
    pieces = count * values / CACHED
    threads = torch.get_num_threads()
    pieces = math.ceil(pieces / threads) * threads if pieces > 1 / 4 else 1
    limits = np.linspace(0, count, max(min(pieces, count), 1) + 1).astype(int).tolist()
    return [slice(first, last) for first, last in pairwise(limits)]


def side_by_side(job: Callable[[Part], Result], parts: list[Part]) -> list[Result]:
    """Results of a job that needs no autograd for each of the parts."""
    threads = torch.get_num_threads()
    if threads == 1 or len(parts) == 1:
        return [job(part) for part in parts]
    return list(_pool(os.getpid(), threads).map(torch.no_grad()(job), parts))


@cache
def _pool(process: int, threads: int) -> ThreadPoolExecutor:
    """Threads that use no further threads in torch; of this process, as threads do not survive a fork."""
    pool = ThreadPoolExecutor(threads, "motion_gym", _one_thread)
    everyone = threading.Barrier(threads)  # or a thread that is idle already would spare another's start for later
    list(pool.map(lambda _: everyone.wait(), range(threads)))
    # The setting of a thread is also that of threads which have not used torch yet.
    torch.set_num_threads(threads)
    return pool


def _one_thread() -> None:
    torch.get_num_threads()  # or the first use of torch in this thread would undo the setting
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)  # as the training does in its own thread
