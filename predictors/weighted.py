"""What all predictors with trained weights share: their name, weights on disk, and the training of several seeds."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from motion_gym.catalog import whole_number
from motion_gym.contract import Observation, PredictorError, SpecError, Truth
from motion_gym.predictors.settings import check_settings, name_of_settings, optional, whole
from motion_gym.training import loop as training
from motion_gym.training.loop import Progress, device_named
from motion_gym.training.program import Program, Weights
from motion_gym.training.provenance import commit, versions
from motion_gym.training.weight_files import check_shapes, locate, read, write

if TYPE_CHECKING:
    from typing_extensions import Self

DT = 0.4
"""Seconds per step of weights whose card does not say it."""
SEED = optional(whole(0, 2**31))


@dataclasses.dataclass(eq=False, repr=False)
class Weighted:
    """A predictor with trained weights, of one seed or several.

    A subclass names itself, declares its settings as fields, gives the shapes of its weights, and names the program
    that ``fit`` trains. A setting makes another row of a table and another file of weights.

    Args:
        weights: Name of shipped weights (``spurious``, ``style``), or a ``.safetensors`` file; by default those that
            are shipped for these settings.
        seed: Seed of the model to use, one of those that were trained; by default the first.

    Raises:
        SpecError: a setting is not allowed.
        PredictorError: there are no such weights, or they are of another predictor.
    """

    weights: str | Path | None = None
    seed: int | None = None
    kind: ClassVar[str]
    shipped: ClassVar[str]
    """Name of the weights that are used where none are named."""
    hints: ClassVar[Mapping[str, str]] = {}
    """What it means if a weight, by name, has another shape than expected."""
    program: ClassVar[Callable[..., Program]]
    """Class of the training program; takes the predictor, both sets, a device, and the options of ``fit``."""
    fit_on_demand: ClassVar[bool] = False
    """Training takes too long for an evaluation: ``predict`` says where weights are missing and how to train them."""

    def __post_init__(self) -> None:
        self.seed = SEED("seed", self.seed)
        check_settings(self)
        self.tensors: Weights | None = None
        self.stacked: Weights = {}
        self.card: dict[str, Any] = {}
        if self.weights is not None:
            self.load(locate(str(self.weights), self.name))

    @property
    def expected(self) -> dict[str, tuple[int, ...]]:
        """Shape of every weight, without the axis of models."""
        raise NotImplementedError

    @property
    def name(self) -> str:
        """The predictor with those settings that are not at their defaults."""
        return name_of_settings(self)

    @property
    def fitted(self) -> bool:
        """Whether there are weights: given, trained, or shipped for these settings."""
        if self.tensors is None:
            try:
                locate(self.shipped, self.name)
            except PredictorError:
                return False
        return True

    @property
    def fingerprint(self) -> str:
        """sha256 of the weights, so that a result tells which they were."""
        digest = hashlib.sha256()
        for name, value in sorted(self._ready().items()):
            digest.update(name.encode() + value.numpy().tobytes())
        return digest.hexdigest()

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Names of the domains whose windows the weights were trained on."""
        self._ready()
        return tuple(self.card.get("trained_on", ()))

    @property
    def selection(self) -> str:
        """How the weights were selected, as their card says."""
        self._ready()
        return str(self.card.get("selection", "not stated by the weights"))

    def fit(
        self,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        seed: int | Sequence[int] = 0,
        *,
        names: Sequence[str] = (),
        device: str = "cpu",
        checkpoint: Path | None = None,
        resume: bool = False,
        every: int = 10,
        report: Callable[[Progress], None] = lambda progress: None,
        **options: Any,
    ) -> Self:
        """Train, all seeds in one pass.

        Args:
            train: Windows of each environment.
            validation: Windows that weights are selected on, of the same environments in the same order.
            seed: Seed, or several.
            names: Names of the domains of ``train``, for the card.
            device: ``cpu`` or ``cuda``.
            checkpoint: File of the checkpoints; None for none.
            resume: Go on from the checkpoint if there is one; the last stage may have become longer.
            every: Epochs from one checkpoint to the next.
            report: Called after each epoch.
            **options: Of ``program``, as ``epochs``.

        Returns:
            Itself, with the weights of the best epoch of each seed.

        Raises:
            PredictorError: the sets cannot be trained on, or a loss is not finite.
            SpecError: an option is not allowed, the device is not there, or the checkpoint is of another configuration.
        """
        seeds = [whole_number("seed", s, 0, 2**31) for s in (seed if isinstance(seed, Iterable) else [seed])]
        if not seeds or len(set(seeds)) < len(seeds):
            raise SpecError(f"`seed={seed}` must name at least one seed to train, and each once.")
        if self.seed is not None and self.seed not in seeds:
            raise SpecError(f"{self.name} is to use seed {self.seed}, and is to be trained with {seeds}: drop `seed`.")
        program = self.program(self, train, validation, device=device_named(device), **options)
        trained = training.train(
            program,
            seeds,
            device=device_named(device),
            checkpoint=checkpoint,
            resume=resume,
            every=every,
            report=report,
        )
        kept = {name: value.half().float() for name, value in program.finished(trained.weights).items()}
        each = [stage.epochs for stage in program.stages]
        card = {
            "predictor": self.name,
            "seeds": seeds,
            "dt": train[0].observation.dt,
            "trained_on": list(names),
            "selection": "the epoch of the last stage with the lowest ADE on the validation windows of the sources; "
            f"trained for {'/'.join(map(str, each))} epochs",
            "validation_ade": [round(score, 4) for score in training.score(program, kept, trained, seeds, device)],
            "epoch": trained.epoch,
            "training": {**program.config, "epochs": each},
            "seconds": round(trained.seconds, 1),
            "device": device,
            "commit": commit(),
            "versions": versions(),
            "precision": "trained in single, kept in half precision",
            "curve": trained.curve,
        }
        self.use(kept, card)
        return self

    def _ready(self, observation: Observation | None = None) -> Weights:
        """The weights of the seed; the shipped ones if there are no others.

        Raises:
            PredictorError: there are no weights, or the observation has another time step than they were trained on.
        """
        if self.tensors is None:
            self.load(locate(self.shipped, self.name))
        dt = float(self.card.get("dt", DT))
        if observation is not None and not math.isclose(observation.dt, dt, rel_tol=1e-3):
            raise PredictorError(
                f"{self.name} was trained on time steps of {dt:.3g} s, and the observation has steps of "
                f"{observation.dt:.3g} s: resample the data to {dt:.3g} s, or train on such steps."
            )
        return cast(Weights, self.tensors)

    def use(self, tensors: Weights, card: dict[str, Any], source: str = "the weights") -> None:
        """Take weights [M, ...] of M seeds, and their card.

        Raises:
            PredictorError: they are of another model, not finite, or lack the seed.
        """
        check_shapes(tensors, self.expected, source, self.hints)
        written = card.get("predictor", self.name)
        if written != self.name:
            raise PredictorError(f"{source} has the weights of {written}, not of {self.name}: name that predictor.")
        models = len(next(iter(tensors.values())))
        seeds = card.get("seeds", [None] * models)
        if len(seeds) != models or (self.seed is not None and self.seed not in seeds):
            raise PredictorError(f"{source} of {self.name} hold no seed {self.seed}: {seeds} of {models} are there.")
        index = 0 if self.seed is None else seeds.index(self.seed)
        self.stacked, self.card = tensors, card
        self.tensors = {name: value[index : index + 1].contiguous() for name, value in tensors.items()}
        self.reset()

    def reset(self) -> None:
        """Forget everything that was observed; nothing here."""

    def save(self, path: str | Path) -> None:
        """Write the weights of all seeds to ``path`` and their card beside it, as ``.json``.

        Raises:
            PredictorError: there are no weights.
            StorageError: a file could not be written; neither is then half written.
        """
        self._ready()
        write(Path(path), self.stacked, {**self.card, "predictor": self.name})

    def load(self, path: str | Path) -> None:
        """Read what ``save`` wrote.

        Raises:
            PredictorError: the file is missing, damaged, or has the weights of another model.
        """
        self.use(*read(Path(path)), str(path))
