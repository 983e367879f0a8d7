"""A training on a node of a Ray cluster, whose checkpoints are kept where the command runs."""

from __future__ import annotations

import concurrent.futures
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from motion_gym import cluster
from motion_gym.data.storage import write_atomic
from motion_gym.training.plans import Training

SECONDS_BETWEEN_REPORTS = 1.0


class Desk:
    """An actor on the machine of the command: the last checkpoint and the progress of a training.

    Args:
        checkpoint: Absolute path of the checkpoint.
    """

    def __init__(self, checkpoint: Path):
        self.checkpoint, self.state = checkpoint, None

    def last(self) -> bytes | None:
        """The last checkpoint: of an interrupted command, or of a node that died."""
        return self.checkpoint.read_bytes() if self.checkpoint.exists() else None

    def keep(self, checkpoint: bytes) -> None:
        """Write a checkpoint."""
        write_atomic(self.checkpoint, checkpoint)

    def hear(self, state: Any) -> None:
        """Note the progress."""
        self.state = state

    def progress(self) -> Any:
        """The last progress that was heard of; None before the first epoch."""
        return self.state


def fit(
    predictor: Any,
    plan: Training,
    seeds: Sequence[int],
    *,
    address: str | None,
    gpus: float,
    checkpoint: Path,
    report: Callable[[Any], None],
    **options: Any,
) -> Any:
    """Train all seeds of a predictor in one task. If its node dies, another goes on from the last checkpoint.

    Args:
        predictor: The predictor, whose ``fit`` takes a checkpoint.
        plan: What it is trained on; the node reads the data.
        seeds: Seeds.
        address: Address of the head node, see ``cluster.connect``.
        gpus: GPUs that the training reserves.
        checkpoint: File of the checkpoint; the training goes on from it if it is there.
        report: Called with the progress about every second.
        **options: Further options of ``fit``.

    Returns:
        The trained predictor.
    """
    cluster.connect(address)
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    desk = ray.remote(Desk).options(num_cpus=0, scheduling_strategy=here).remote(checkpoint.absolute())
    future = cluster.Tasks(gpus).submit(_fit_on_node, predictor, plan, seeds, desk, options)
    while not future.done():
        concurrent.futures.wait([future], timeout=SECONDS_BETWEEN_REPORTS)
        if state := ray.get(desk.progress.remote()):
            report(state)
    return future.result()


def _fit_on_node(predictor: Any, plan: Training, seeds: Sequence[int], desk: Any, options: dict[str, Any]) -> Any:
    import ray

    with tempfile.TemporaryDirectory() as folder:
        checkpoint = Path(folder) / "training.checkpoint"
        last = ray.get(desk.last.remote())
        if last is not None:
            checkpoint.write_bytes(last)
        sent = time_of(checkpoint)

        def report(state: Any) -> None:
            nonlocal sent
            desk.hear.remote(state)
            if time_of(checkpoint) != sent:
                sent = time_of(checkpoint)
                ray.get(desk.keep.remote(checkpoint.read_bytes()))

        options = {**options, "checkpoint": checkpoint, "resume": last is not None, "report": report}
        predictor.fit(*plan.data(), seeds, names=plan.names(), **options)
        ray.get(desk.keep.remote(checkpoint.read_bytes()))
    return predictor


def time_of(checkpoint: Path) -> int:
    """When a file was written, in nanoseconds; 0 if there is none."""
    return checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0
