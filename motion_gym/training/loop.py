"""Training of several seeds in one pass: stages, checkpoints, selection.

What is trained is a ``Program``: it gives first weights, losses and validation scores. Every tensor has a leading axis
M, one model for each seed, and nothing ties the models together, so that a seed's result does not depend on which
others are trained along (but for the last bits of sums). All randomness of an epoch comes from (seed, epoch) alone: a
training that was killed and resumed gives what an uninterrupted one gives, bit for bit on a CPU with as many threads.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.catalog import whole_number
from motion_gym.contract import PredictorError, SpecError
from motion_gym.data.storage import write_atomic
from motion_gym.training.program import Program, Stage, Weights

TRAINING, VALIDATION = 0, 1
"""Purposes of random numbers."""


@dataclass(frozen=True)
class Progress:
    """Where a training is, after each epoch.

    Attributes:
        epoch: Epochs done.
        epochs: Epochs in all.
        stage: Name of the stage.
        loss: Mean loss of the epoch over steps and seeds.
        score: Mean validation score over seeds; None in stages that do not select.
        seconds: Since the training began, earlier sessions included.
    """

    epoch: int
    epochs: int
    stage: str
    loss: float
    score: float | None
    seconds: float


@dataclass(frozen=True)
class Trained:
    """What came out.

    Attributes:
        weights: Of the best epoch of each seed, [M, ...], on the CPU; of the last one if no stage selects.
        score: [M] its validation score; infinite if no stage selects.
        epoch: [M] when it was.
        curve: Mean loss over seeds of each epoch, and the validation scores of the seeds where there are some.
        seconds: Of the whole training.
    """

    weights: Weights
    score: list[float]
    epoch: list[int]
    curve: list[dict[str, Any]]
    seconds: float


def train(
    program: Program,
    seeds: Sequence[int],
    *,
    device: torch.device | str = "cpu",
    checkpoint: Path | None = None,
    resume: bool = False,
    every: int = 10,
    report: Callable[[Progress], None] = lambda progress: None,
) -> Trained:
    """Train all seeds in one pass.

    Args:
        program: What to train; it works on ``device``.
        seeds: Seed of each model.
        device: Where the tensors are.
        checkpoint: File of the checkpoints; None for none.
        resume: Go on from the checkpoint if there is one.
        every: Epochs from one checkpoint to the next.
        report: Called after each epoch.

    Raises:
        SpecError: the checkpoint is of another configuration, or cannot be read.
        PredictorError: a loss or a validation score is not finite; the last checkpoint stays.
        StorageError: a checkpoint could not be written.
    """
    every = whole_number("every", every, 1, 1_000_000)
    run = _Run(program, list(seeds), torch.device(device))
    if resume and checkpoint is not None and checkpoint.exists():
        run.load(checkpoint)
    last = sum(stage.epochs for stage in program.stages)
    if run.epoch > last:
        raise SpecError(
            f"{checkpoint} has {run.epoch} epochs, more than the {last} asked for: ask for as many or more."
        )
    with no_denormals():
        while run.epoch < last:
            report(run.step())
            if checkpoint is not None and (run.epoch % every == 0 or run.epoch == last):
                run.save(checkpoint)
    selected = run.best if any(stage.selects for stage in program.stages) else run.weights
    best = {name: value.detach().cpu() for name, value in selected.items()}
    return Trained(best, run.score.tolist(), run.score_epoch.tolist(), run.curve, run.seconds)


def score(
    program: Program, weights: Weights, trained: Trained, seeds: Sequence[int], device: torch.device | str = "cpu"
) -> list[float]:
    """Validation scores of other weights of the same models, as rounded ones, with the draws of their best epochs."""
    generators = [
        _generator(seed, epoch - 1, VALIDATION, torch.device(device))
        for seed, epoch in zip(seeds, trained.epoch, strict=True)
    ]
    with torch.no_grad():
        return program.validate({k: v.to(device) for k, v in weights.items()}, generators).tolist()


@contextmanager
def no_denormals() -> Iterator[None]:
    """Let numbers under 1e-38 be zero in this thread: gradients come to hold many, and CPUs are slow with them."""
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)


def device_named(name: str) -> torch.device:
    """``cpu`` or ``cuda``, if it is there.

    Raises:
        SpecError: it is not.
    """
    if name not in ("cpu", "cuda"):
        raise SpecError(f"`--device {name}` is not known: cpu or cuda.")
    if name == "cuda" and not torch.cuda.is_available():
        raise SpecError("`--device cuda`: PyTorch finds no CUDA device on this machine. Use --device cpu.")
    return torch.device(name)


class _Run:
    """A training under way: everything that a checkpoint holds."""

    def __init__(self, program: Program, seeds: list[int], device: torch.device):
        self.program, self.seeds, self.device = program, seeds, device
        rates = [dict(stage.rates) for stage in program.stages]
        config = {**program.config, "seeds": seeds, "rates": rates, "device": self.device.type}
        if any(stage.decays for stage in program.stages):
            config["decay_over"] = [stage.epochs if stage.decays else 0 for stage in program.stages]
        self.config = json.loads(json.dumps(config))
        self.weights = {k: v.to(device).requires_grad_() for k, v in program.initial(seeds).items()}
        self.state = program.state(len(seeds))
        self.best = {name: value.detach().clone() for name, value in self.weights.items()}
        self.score = torch.full((len(seeds),), torch.inf)
        self.score_epoch = torch.zeros(len(seeds), dtype=torch.int64)
        self.epoch, self.seconds = 0, 0.0
        self.curve: list[dict[str, Any]] = []
        # Together go those that have the same rate in every stage.
        self.groups: dict[tuple[float, ...], list[str]] = {}
        for name in self.weights:
            self.groups.setdefault(tuple(_rate(stage, name) for stage in program.stages), []).append(name)
        groups = [{"params": [self.weights[name] for name in names]} for names in self.groups.values()]
        self.adam = torch.optim.Adam(groups, lr=0.0, fused=True)

    def stage(self) -> int:
        """Index of the stage of the current epoch."""
        ends = np.cumsum([stage.epochs for stage in self.program.stages])
        return int(np.searchsorted(ends, self.epoch, side="right"))

    def generators(self, purpose: int) -> list[torch.Generator]:
        """A generator for each seed, for this epoch and purpose."""
        return [_generator(seed, self.epoch, purpose, self.device) for seed in self.seeds]

    def step(self) -> Progress:
        """One epoch."""
        began = time.perf_counter()
        index = self.stage()
        stage = self.program.stages[index]
        done = self.epoch - sum(s.epochs for s in self.program.stages[:index])
        if not done:
            self.state = self.program.state(len(self.seeds))
        decay = (1 + math.cos(math.pi * done / stage.epochs)) / 2 if stage.decays else 1.0
        for group, rates in zip(self.adam.param_groups, self.groups, strict=True):
            group["lr"] = decay * rates[index]
            for value in group["params"]:
                value.requires_grad_(group["lr"] > 0)
        losses = []
        for loss in self.program.losses(self.weights, self.state, index, self.generators(TRAINING), self.epoch):
            self.adam.zero_grad()
            loss.sum().backward()
            self.adam.step()
            losses.append(loss.detach())
        table = torch.stack(losses).cpu()
        self._check(table, stage)
        for name, value in self.weights.items():
            finite = torch.isfinite(value.detach()).flatten(1).all(dim=1).cpu()
            self._check(torch.where(finite, 0.0, torch.nan)[None], stage, f"weight {name}")
        entry: dict[str, Any] = {"epoch": self.epoch + 1, "stage": stage.name, "loss": float(table.mean())}
        score = None
        if stage.selects:
            with torch.no_grad():
                scores = self.program.validate(self.weights, self.generators(VALIDATION)).cpu()
            self._check(scores[None], stage, "validation score")
            better = scores < self.score
            self.score[better] = scores[better]
            self.score_epoch[better] = self.epoch + 1
            where = better.to(self.device)
            for name, value in self.weights.items():
                self.best[name][where] = value.detach()[where]
            score = float(scores.mean())
            entry["score"] = [round(float(s), 4) for s in scores]
        self.curve.append(entry)
        self.epoch += 1
        self.seconds += time.perf_counter() - began
        return Progress(
            self.epoch, sum(s.epochs for s in self.program.stages), stage.name, entry["loss"], score, self.seconds
        )

    def _check(self, losses: Tensor, stage: Stage, what: str = "loss") -> None:
        """Raise PredictorError if a number of some step and seed is not finite."""
        bad = (~torch.isfinite(losses)).nonzero()
        if len(bad):
            step, model = bad[0].tolist()
            raise PredictorError(
                f"The {what} of seed {self.seeds[model]} is {losses[step, model].item()} in epoch {self.epoch + 1} "
                f"({stage.name}), step {step + 1}: training stopped, and the last checkpoint is kept. Lower the "
                "penalty or the learning rate, or look for values that are not finite in the data."
            )

    def save(self, path: Path) -> None:
        """Write everything, whole or not at all."""
        content = {
            "config": json.dumps(self.config, sort_keys=True),
            "weights": {name: value.detach().cpu() for name, value in self.weights.items()},
            "best": {name: value.cpu() for name, value in self.best.items()},
            "adam": self.adam.state_dict(),
            "state": self.state.cpu(),
            "score": self.score,
            "score_epoch": self.score_epoch,
            "epoch": self.epoch,
            "seconds": self.seconds,
            "curve": self.curve,
        }
        buffer = BytesIO()
        torch.save(content, buffer)
        write_atomic(path, buffer.getvalue())

    def load(self, path: Path) -> None:
        """Go on from a checkpoint."""
        damaged = f"{path} is no checkpoint, or is damaged. Delete it, and start again without --resume."
        try:
            content = torch.load(path, map_location="cpu", weights_only=True)
            config = dict(json.loads(content["config"]))
        except Exception:  # of the library's own types; its text tells how to open the file unsafely
            raise SpecError(damaged) from None
        if config != self.config:
            keys = sorted(k for k in {*config, *self.config} if config.get(k) != self.config.get(k))
            told = "; ".join(f"{k}: {_short(config.get(k))}, now {_short(self.config.get(k))}" for k in keys)
            raise SpecError(
                f"{path} is the checkpoint of another configuration ({told}). Train as before, choose another folder, "
                "or start again without --resume."
            )
        try:
            self._take(content)
        except Exception:
            raise SpecError(damaged) from None

    def _take(self, content: dict[str, Any]) -> None:
        """Take the content of a checkpoint; whatever is raised means that it is damaged."""
        for name, value in self.weights.items():
            for kept in (content["weights"][name], content["best"][name]):
                if kept.shape != value.shape or not torch.isfinite(kept).all():
                    raise ValueError(name)
        if content["score"].shape != self.score.shape or content["score"].isnan().any() or content["epoch"] < 1:
            raise ValueError("score")
        with torch.no_grad():
            for name, value in self.weights.items():
                value.copy_(content["weights"][name])
        self.best = {name: content["best"][name].to(self.device) for name in self.weights}
        self.adam.load_state_dict(content["adam"])
        self.state = content["state"].to(self.device)
        self.score, self.score_epoch = content["score"].cpu(), content["score_epoch"].cpu()
        self.epoch, self.seconds, self.curve = content["epoch"], content["seconds"], content["curve"]


def _generator(seed: int, epoch: int, purpose: int, device: torch.device) -> torch.Generator:
    state = np.random.SeedSequence([seed, epoch, purpose]).generate_state(1, np.uint64)[0]
    return torch.Generator(device).manual_seed(int(state))


def _rate(stage: Stage, name: str) -> float:
    return next((stage.rates[key] for key in (name, name.split(".")[0], "") if key in stage.rates), 0.0)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
