"""The commands that write weights: by training, and from a file of the released program."""

from __future__ import annotations

import contextlib
import fcntl
import inspect
import os
import platform
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from motion_gym import catalog, cluster
from motion_gym.cli.output import Text, progress_bar, reporter, say
from motion_gym.contract import SpecError
from motion_gym.data.storage import check_writable
from motion_gym.training import on_cluster
from motion_gym.training import plans as training_plans

RELEASED = ("erm", "counterfactual", "invariant")
"""Predictors that the paper's released program trains on ETH-UCY."""
MOST_SEEDS = 1000


def train(
    predictor: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PREDICTOR")],
    benchmark: Text = None,
    domain: Text = None,
    seeds: str = "0-4",
    device: str = "cpu",
    resume: bool = False,
    epochs: Annotated[tuple[int, ...] | None, tyro.conf.arg(metavar="INT [INT ...]")] = None,
    every: int = 10,
    executor: Literal["here", "ray"] = "here",
    address: Text = None,
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("weights"),
) -> None:
    """Train a predictor for a benchmark or on a domain of your own, all seeds in one pass.

    Writes OUT/NAME/PREDICTOR.safetensors, its card, .json, and its last checkpoint, from which --resume continues with
    more epochs of the last stage; NAME is that of the benchmark or the domain. The card says on what the weights were
    trained: places, time step, measurement noise and windows. Score them: motion-gym score PREDICTOR --weights
    OUT/NAME/PREDICTOR.safetensors --domain ...

    Args:
        predictor: Name or spec, as erm or invariant:penalty=1.
        benchmark: What to train for: spurious (test on eth), spurious/hotel, original/hotel, style, ...
        domain: Instead of a benchmark: name, spec or your own (module:Class); the sources of the domain are trained on.
        seeds: Seeds, as 0-4 or 0,2,5.
        device: cpu or cuda.
        resume: Resume from the last checkpoint; without this option, an existing checkpoint is an error.
        epochs: Epochs of each stage of the predictor; by default those of the benchmarks.
        every: Number of epochs between checkpoints.
        executor: Where to train: on this machine (`here`), or on a node of a Ray cluster (`ray`), with a GPU for cuda.
        address: Head node of the Ray cluster, as 10.0.0.1:6379; by default the cluster of this machine.
        out: Folder for weights and checkpoints.
    """
    instance: Any = catalog.predictor(predictor)
    if not hasattr(instance, "fit") or "checkpoint" not in inspect.signature(instance.fit).parameters:
        raise SpecError(f"`{predictor}` is not trained in epochs: there is nothing to train. See `motion-gym ls`.")
    from motion_gym.training import weight_files  # imports torch

    if (benchmark is None) == (domain is None):
        raise SpecError("Name what to train for: either --benchmark style, or --domain my_module:MyDomain.")
    if executor == "ray":
        cluster.check_installed()
    elif address:
        raise SpecError("`--address` is an option of the executor `ray`: add --executor ray.")
    plan = training_plans.training(benchmark) if benchmark else training_plans.training_for(str(domain), instance)
    path = out / (benchmark or plan.folder) / weight_files.file_name(instance.name)
    checkpoint = path.with_suffix(".checkpoint")
    numbers, unit = _seeds(seeds), plan.unit
    check_writable(path.parent)
    options = {**plan.options_of(instance), **({"epochs": epochs} if epochs else {}), "device": device, "every": every}
    with _locked(path.with_suffix(".lock")), progress_bar() as progress:
        for existing in (checkpoint, path):
            if existing.exists() and not resume:
                raise SpecError(f"{existing} is there already: add --resume to go on, or delete it to start again.")
        show_epoch = reporter(progress, instance.name)

        def report(state: Any) -> None:
            score = "" if state.score is None else f", validation ADE {state.score:.3f} {unit}"
            show_epoch(state.epoch, state.epochs, f"{state.stage}: loss {state.loss:.3f}{score}")

        options |= {"checkpoint": checkpoint, "report": report}
        if executor == "ray":
            gpus = float(device == "cuda")
            instance = on_cluster.fit(instance, plan, numbers, address=address, gpus=gpus, **options)
        else:
            instance.fit(*plan.data(), numbers, names=plan.names(), resume=resume, **options)
        instance.save(path)
    card = instance.card
    scores = ", ".join(f"{score:.3f}" for score in card["validation_ade"])
    say(f"Written: {path}")
    say(f"{len(card['seeds'])} seeds in {card['seconds']:.0f} s; validation ADE {scores} {unit}.")
    if domain:
        for source in card.get("sources", ()):
            noise = "unknown" if source["noise"] is None else f"up to {source['noise']:g} {unit}"
            say(f"Trained on {source['domain']}, steps of {source['dt']:g} s:")
            say(f"  {source['agent_windows']} agent-windows in {source['scenes']} scenes, measurement noise {noise}")
        say(f"Score it:\n  motion-gym score {predictor} --domain {shlex.quote(domain)} \\\n    --weights {path}")


def import_weights(
    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")],
    predictor: str,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None,
) -> None:
    """Convert a weight file of the paper's released program (.pth.tar) to .safetensors.

    The file is read safely: a file with anything but tensors and plain values is refused.

    Args:
        file: The .pth.tar.
        predictor: The trained predictor: erm, counterfactual or invariant.
        out: File of the weights; by default beside FILE, ending in .safetensors.
    """
    instance: Any = catalog.predictor(predictor)
    if getattr(instance, "kind", "") not in RELEASED:
        raise SpecError(f"`{predictor}` has no weights of the released program: erm, counterfactual or invariant have.")
    target = out if out is not None else file.with_name(file.name.split(".pth")[0] + ".safetensors")
    if target.suffix != ".safetensors":
        raise SpecError(f"`--out {target}` must end in .safetensors.")
    if target.exists():
        raise SpecError(f"{target} is there already: choose another place with --out, or delete it.")
    instance.from_released(file).save(target)
    say(f"Written: {target} and its card. Score it:")
    say(f"  motion-gym score {predictor} --weights {target} --domain eth:alpha=8 --k 20")


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold a lock file that names this process, so that no second training writes the same weights.

    The system releases the lock when a process ends, so that the lock file of a killed process locks nothing.

    Raises:
        SpecError: another process holds the lock.
    """
    new_folders = [folder for folder in path.parents if not folder.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "a+") as file:
        held = False
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # The process that held the lock before deletes the file.
            held = path.exists() and os.path.samestat(os.fstat(file.fileno()), path.stat())
        if not held:
            file.seek(0)
            other = file.read() or "another process"
            raise SpecError(
                f"{path.with_suffix('')} is being trained by {other}: wait for it, or choose another folder with "
                "--out. Train several seeds in one command, as --seeds 0,1."
            )
        file.truncate(0)
        print(f"process {os.getpid()} on {platform.node()}", end="", file=file, flush=True)
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # the folder is not empty
                for folder in new_folders:
                    folder.rmdir()


def _seeds(text: str) -> list[int]:
    """Parse ``0-4`` or ``0,2,5``."""
    numbers: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not first.strip().isdecimal() or (dash and not last.strip().isdecimal()):
            raise SpecError(f"`--seeds {text}` cannot be read: write 0-4, or 0,2,5.")
        if int(last or first) - int(first) > MOST_SEEDS:
            raise SpecError(f"`--seeds {text}` names more than {MOST_SEEDS} seeds: train fewer at a time.")
        numbers += range(int(first), int(last or first) + 1)
    if not numbers or len(set(numbers)) < len(numbers):
        raise SpecError(f"`--seeds {text}` must name at least one seed, and each once.")
    return numbers
