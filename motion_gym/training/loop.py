"""Training of several seeds in one pass: stages, checkpoints, model selection.

A ``Program`` defines the initial weights, losses and validation scores. Every tensor has a leading model axis M, with
one model per seed. Models are independent: the result of a seed does not depend on the other seeds, except for the
rounding of sums. All random numbers of an epoch are derived from (seed, epoch). A training that is killed and resumed
is therefore bit-identical to an uninterrupted one on a CPU with the same number of threads.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import PredictorError, SpecError
from motion_gym.data.storage import write_atomic
from motion_gym.specs import one_of, whole_number
from motion_gym.training.program import Program, Stage, Weights

TRAINING, VALIDATION = 0, 1
"""Purposes of random numbers."""


@dataclass(frozen=True)
class Progress:
    """Progress of a training after an epoch.

    Attributes:
        epoch: Completed epochs.
        epochs: Total number of epochs.
        stage: Name of the stage.
        loss: Mean loss of the epoch over steps and seeds.
        score: Mean validation score over seeds; None in stages without selection.
        seconds: Training time, including earlier sessions.
    """

    epoch: int
    epochs: int
    stage: str
    loss: float
    score: float | None
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
) -> Run:
    """Train all seeds in one pass.

    Args:
        program: The training program, with its tensors on ``device``.
        seeds: Seed of each model.
        device: Device of the tensors.
        checkpoint: File for checkpoints; None for none.
        resume: Continue from the checkpoint if it exists.
        every: Epochs between checkpoints.
        report: Called after each epoch.

    Raises:
        SpecError: the checkpoint has another configuration, or cannot be read.
        PredictorError: a loss or a validation score is not finite; the last checkpoint is kept.
        StorageError: a checkpoint could not be written.
    """
    every = whole_number("every", every, 1, 1_000_000)
    run = Run(program, list(seeds), torch.device(device))
    if resume and checkpoint is not None and checkpoint.exists():
        run.load(checkpoint)
    if run.epoch > run.epochs:
        raise SpecError(
            f"{checkpoint} has {run.epoch} epochs, more than the {run.epochs} asked for: ask for as many or more."
        )
    torch.set_flush_denormal(True)  # gradients contain many denormal numbers, which are slow on CPUs
    try:
        while run.epoch < run.epochs:
            report(run.step())
            if checkpoint is not None and (run.epoch % every == 0 or run.epoch == run.epochs):
                run.save(checkpoint)
    finally:
        torch.set_flush_denormal(False)
    return run


def device_named(name: str) -> torch.device:
    """The device ``cpu`` or ``cuda``.

    Raises:
        SpecError: the name is unknown, or there is no CUDA device.
    """
    if one_of("device", name, ("cpu", "cuda")) == "cuda" and not torch.cuda.is_available():
        raise SpecError("`--device cuda`: PyTorch finds no CUDA device on this machine. Use --device cpu.")
    return torch.device(name)


class Run:
    """One training run. A checkpoint holds all of its state.

    Attributes:
        weights: Current weights, [M, ...].
        best: Weights of the best epoch of each seed, [M, ...].
        best_score: [M] validation scores of ``best``; infinite before the first selection.
        best_epoch: [M] epochs of ``best``, from 1.
        state: State of the objective.
        epoch: Completed epochs.
        seconds: Training time, including earlier sessions.
        curve: For each epoch its number, stage, mean loss over seeds, and the validation scores of the seeds if any.
    """

    def __init__(self, program: Program, seeds: list[int], device: torch.device):
        self.program, self.seeds, self.device = program, seeds, device
        self.epochs = sum(stage.epochs for stage in program.stages)
        rates = [dict(stage.rates) for stage in program.stages]
        config = {**program.config, "seeds": seeds, "rates": rates, "device": self.device.type}
        if any(stage.decays for stage in program.stages):
            config["decay_over"] = [stage.epochs if stage.decays else 0 for stage in program.stages]
        self.config = json.loads(json.dumps(config))
        self.weights = {k: v.to(device).requires_grad_() for k, v in program.initial(seeds).items()}
        self.state = program.state(len(seeds))
        self.best = {name: value.detach().clone() for name, value in self.weights.items()}
        self.best_score = torch.full((len(seeds),), torch.inf)
        self.best_epoch = torch.zeros(len(seeds), dtype=torch.int64)
        self.epoch, self.seconds = 0, 0.0
        self.curve: list[dict[str, Any]] = []
        # Weights with the same rate in every stage share a group of the optimiser.
        self.groups: dict[tuple[float, ...], list[str]] = {}
        for name in self.weights:
            self.groups.setdefault(tuple(_rate(stage, name) for stage in program.stages), []).append(name)
        groups = [{"params": [self.weights[name] for name in names]} for names in self.groups.values()]
        self.adam = torch.optim.Adam(groups, lr=0.0, fused=True)

    @property
    def selected(self) -> Weights:
        """Weights of the best epoch of each seed, on the CPU; the last weights if no stage selects."""
        weights = self.best if any(stage.selects for stage in self.program.stages) else self.weights
        return {name: value.detach().cpu() for name, value in weights.items()}

    def scores_of(self, weights: Weights) -> list[float]:
        """Validation scores of other weights, such as rounded ones, with the random numbers of the best epochs."""
        generators = [
            _generator(seed, epoch - 1, VALIDATION, self.device)
            for seed, epoch in zip(self.seeds, self.best_epoch.tolist(), strict=True)
        ]
        with torch.no_grad():
            return self.program.validate({k: v.to(self.device) for k, v in weights.items()}, generators).tolist()

    def step(self) -> Progress:
        """Train for one epoch."""
        start = time.perf_counter()
        ends = np.cumsum([stage.epochs for stage in self.program.stages])
        index = int(np.searchsorted(ends, self.epoch, side="right"))
        stage = self.program.stages[index]
        done = self.epoch - int(ends[index] - stage.epochs)
        if not done:
            self.state = self.program.state(len(self.seeds))
        decay = (1 + math.cos(math.pi * done / stage.epochs)) / 2 if stage.decays else 1.0
        for group, rates in zip(self.adam.param_groups, self.groups, strict=True):
            group["lr"] = decay * rates[index]
            for value in group["params"]:
                value.requires_grad_(group["lr"] > 0)
        losses = []
        for loss in self.program.losses(self.weights, self.state, index, self._generators(TRAINING), self.epoch):
            self.adam.zero_grad()
            loss.sum().backward()
            self.adam.step()
            losses.append(loss.detach())
        table = torch.stack(losses).cpu()
        self._check_finite(table, stage)
        for name, value in self.weights.items():
            finite = torch.isfinite(value.detach()).flatten(1).all(dim=1).cpu()
            self._check_finite(torch.where(finite, 0.0, torch.nan)[None], stage, f"weight {name}")
        entry: dict[str, Any] = {"epoch": self.epoch + 1, "stage": stage.name, "loss": float(table.mean())}
        score = None
        if stage.selects:
            with torch.no_grad():
                scores = self.program.validate(self.weights, self._generators(VALIDATION)).cpu()
            self._check_finite(scores[None], stage, "validation score")
            better = scores < self.best_score
            self.best_score[better] = scores[better]
            self.best_epoch[better] = self.epoch + 1
            for name, value in self.weights.items():
                self.best[name][better.to(self.device)] = value.detach()[better.to(self.device)]
            score = float(scores.mean())
            entry["score"] = [round(float(s), 4) for s in scores]
        self.curve.append(entry)
        self.epoch += 1
        self.seconds += time.perf_counter() - start
        return Progress(self.epoch, self.epochs, stage.name, entry["loss"], score, self.seconds)

    def _generators(self, purpose: int) -> list[torch.Generator]:
        """A generator for each seed, for this epoch and purpose."""
        return [_generator(seed, self.epoch, purpose, self.device) for seed in self.seeds]

    def _check_finite(self, values: Tensor, stage: Stage, name: str = "loss") -> None:
        """Raise PredictorError if a value [steps, M] is not finite."""
        bad = (~torch.isfinite(values)).nonzero()
        if len(bad):
            step, model = bad[0].tolist()
            raise PredictorError(
                f"The {name} of seed {self.seeds[model]} is {values[step, model].item()} in epoch {self.epoch + 1} "
                f"({stage.name}), step {step + 1}: training stopped, and the last checkpoint is kept. Lower the "
                "penalty or the learning rate, or look for values that are not finite in the data."
            )

    def save(self, path: Path) -> None:
        """Write a checkpoint, completely or not at all."""
        content = {
            "config": json.dumps(self.config, sort_keys=True),
            "weights": {name: value.detach().cpu() for name, value in self.weights.items()},
            "best": {name: value.cpu() for name, value in self.best.items()},
            "adam": self.adam.state_dict(),
            "state": self.state.cpu(),
            "score": self.best_score,
            "score_epoch": self.best_epoch,
            "epoch": self.epoch,
            "seconds": self.seconds,
            "curve": self.curve,
        }
        buffer = BytesIO()
        torch.save(content, buffer)
        write_atomic(path, buffer.getvalue())

    def load(self, path: Path) -> None:
        """Continue from a checkpoint."""
        damaged = f"{path} is no checkpoint, or is damaged. Delete it, and start again without --resume."
        try:
            content = torch.load(path, map_location="cpu", weights_only=True)
            config = dict(json.loads(content["config"]))
        except Exception:  # torch raises its own types; its message explains how to open the file unsafely
            raise SpecError(damaged) from None
        if config != self.config:
            keys = sorted(k for k in {*config, *self.config} if config.get(k) != self.config.get(k))
            changes = "; ".join(f"{k}: {_short(config.get(k))}, now {_short(self.config.get(k))}" for k in keys)
            raise SpecError(
                f"{path} is the checkpoint of another configuration ({changes}). Train as before, choose another "
                "folder, or start again without --resume."
            )
        try:
            self._restore(content)
        except Exception:
            raise SpecError(damaged) from None

    def _restore(self, content: dict[str, Any]) -> None:
        """Use the content of a checkpoint; any exception means that the content is damaged."""
        for name, value in self.weights.items():
            for stored in (content["weights"][name], content["best"][name]):
                if stored.shape != value.shape or not torch.isfinite(stored).all():
                    raise ValueError(name)
        if content["score"].shape != self.best_score.shape or content["score"].isnan().any() or content["epoch"] < 1:
            raise ValueError("score")
        with torch.no_grad():
            for name, value in self.weights.items():
                value.copy_(content["weights"][name])
        self.best = {name: content["best"][name].to(self.device) for name in self.weights}
        self.adam.load_state_dict(content["adam"])
        self.state = content["state"].to(self.device)
        self.best_score, self.best_epoch = content["score"].cpu(), content["score_epoch"].cpu()
        self.epoch, self.seconds, self.curve = content["epoch"], content["seconds"], content["curve"]


def _generator(seed: int, epoch: int, purpose: int, device: torch.device) -> torch.Generator:
    state = np.random.SeedSequence([seed, epoch, purpose]).generate_state(1, np.uint64)[0]
    return torch.Generator(device).manual_seed(int(state))


def _rate(stage: Stage, name: str) -> float:
    return next((stage.rates[key] for key in (name, name.split(".")[0], "") if key in stage.rates), 0.0)


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
