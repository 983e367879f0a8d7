"""STGAT, the base model of the paper's experiments on spurious shifts, as a predictor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from safetensors.torch import load as load_safetensors
from safetensors.torch import save as save_safetensors

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation, PredictorError
from motion_gym.predictors.graph_attention import Layout
from motion_gym.predictors.stgat_network import Draws, Weights, shapes, stage3
from motion_gym.storage import write_atomic
from motion_gym.windows import pick_scenes_of

SCENES_AT_ONCE = 64
"""Scenes of one forward pass, so that memory does not grow with the test set."""


class Stgat:
    """Spatio-temporal graph attention (Huang et al., ICCV 2019), with the sizes of the paper's released program.

    Reads the displacements of the 8 observed steps, rounded to 4 decimals (the first is 0), and sigma as a third value.
    Stochastic: initial states and decoder noise are drawn from N(0, 1), the noise once per scene, so that sample k of
    a scene is one joint forecast.

    Args:
        weights: File that ``save`` or ``motion-gym import-weights`` wrote; None for a model without weights.
    """

    counterfactual: ClassVar[bool] = False
    sigma: ClassVar[bool] = True
    name: ClassVar[str] = "stgat"

    def __init__(self, weights: str | Path | None = None):
        self.weights: str | None = None if weights is None else str(weights)
        self.tensors: Weights | None = None
        self.card: dict[str, Any] = {}
        if weights is not None:
            self.load(weights)

    @property
    def fitted(self) -> bool:
        """Whether there are weights."""
        return self.tensors is not None

    @property
    def selection(self) -> str:
        """How the weights were selected, as their card says."""
        return str(self.card.get("selection", "not stated by the weights"))

    @property
    def features(self) -> int:
        """Values per observed step."""
        return 3 if self.sigma else 2

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres.

        Raises:
            PredictorError: there are no weights, or the observation has no sigma.
        """
        if self.tensors is None:
            raise PredictorError(f"{self.name} has no weights: give a file, as {self.name}:weights=FILE.safetensors.")
        if observation.history.shape[2] < self.features:
            raise PredictorError(
                f"{self.name} was trained with sigma, and this domain gives x and y alone: use a domain with sigma, as "
                "eth:alpha=8."
            )
        generator = torch.Generator().manual_seed(seed)
        weights = {key: value.expand(samples, *value.shape[1:]) for key, value in self.tensors.items()}
        parts = [np.zeros((0, samples, FUTURE, 2), np.float32)]
        with torch.no_grad():
            for first in range(0, observation.scenes, SCENES_AT_ONCE):
                part = pick_scenes_of(observation, slice(first, first + SCENES_AT_ONCE))
                parts.append(self._positions(part, weights, samples, generator))
        return Forecast(np.concatenate(parts))

    def _positions(
        self, observation: Observation, weights: Weights, samples: int, generator: torch.Generator
    ) -> np.ndarray:
        layout = Layout.of(observation.scene)
        draws = Draws.from_generator(generator, samples, layout)
        steps = torch.from_numpy(displacements(observation, self.features))
        moves = stage3(steps, draws, layout, weights, self.counterfactual)
        last = torch.from_numpy(observation.xy[:, -1].copy())
        return (last + moves.cumsum(dim=0)).permute(2, 1, 0, 3).contiguous().numpy()

    @classmethod
    def from_released(cls, path: str | Path) -> Stgat:
        """A predictor with the weights of the paper's released program; see ``import_released``."""
        made = cls()
        tensors, card = import_released(path)
        check_weights(tensors, made.features, str(path))
        made.tensors, made.card = tensors, card
        return made

    def save(self, path: str | Path) -> None:
        """Write the weights to ``path`` and their card beside it, as ``.json``.

        Raises:
            PredictorError: there are no weights.
            StorageError: a file could not be written; neither is then half written.
        """
        if self.tensors is None:
            raise PredictorError(f"{self.name} has no weights to save.")
        card = {**self.card, "predictor": self.name, "features": self.features}
        write_atomic(Path(path).with_suffix(".json"), (json.dumps(card, indent=1) + "\n").encode())
        write_atomic(path, save_safetensors(self.tensors))

    def load(self, path: str | Path) -> None:
        """Read what ``save`` wrote.

        Raises:
            PredictorError: the file is missing, damaged, or has the weights of another model.
        """
        path = Path(path)
        try:
            tensors = load_safetensors(path.read_bytes())
            card = json.loads(path.with_suffix(".json").read_text())
        except FileNotFoundError as error:
            raise PredictorError(
                f"There is no file {error.filename}: weights are a .safetensors and a .json."
            ) from None
        except Exception as error:  # a damaged archive raises types of the library's own
            raise PredictorError(f"{path} cannot be read, it is damaged or no safetensors file: {error}.") from None
        check_weights(tensors, self.features, str(path))
        self.tensors, self.card, self.weights = tensors, card, str(path)


class Erm(Stgat):
    """STGAT trained by empirical risk minimisation: the sum of all environments' errors (the paper's Eq. 1)."""

    name = "erm"


class Invariant(Stgat):
    """STGAT trained with a penalty on the gradient of each environment's risk (the paper's Eq. 3, IRMv1)."""

    name = "invariant"


class Counterfactual(Stgat):
    """STGAT whose decoder subtracts what it would forecast without the trajectory (Chen et al., ICCV 2021)."""

    name = "counterfactual"
    counterfactual = True


def displacements(observation: Observation, features: int) -> np.ndarray:
    """Input of the network: [8, A, F] float32, displacements in metres (0 at the first step), then sigma."""
    xy = observation.xy.astype(np.float64)
    steps = np.zeros((len(xy), HISTORY, features), np.float32)
    steps[:, 1:, :2] = np.round(np.diff(xy, axis=1), 4)
    if features == 3:
        steps[:, :, 2] = observation.history[:, :, 2]
    return np.ascontiguousarray(steps.transpose(1, 0, 2))


def check_weights(tensors: Weights, features: int, source: str) -> None:
    """Raise PredictorError unless these are finite weights of this network, for inputs of ``features`` values."""
    expected = shapes(features)
    found = {key: tuple(value.shape[1:]) for key, value in tensors.items()}
    if found.keys() != expected.keys():
        lacking, unknown = sorted(expected.keys() - found.keys()), sorted(found.keys() - expected.keys())
        raise PredictorError(
            f"{source} has the weights of another model: it lacks {lacking or 'nothing'}, and has "
            f"{unknown or 'nothing'} besides."
        )
    for key, shape in expected.items():
        if found[key] != shape:
            with_sigma = " It was trained " + ("without" if features == 3 else "with") + " sigma."
            hint = with_sigma if key == "trajectory.input" else ""
            raise PredictorError(f"{source}: {key} has shape {found[key]}, expected {shape}.{hint}")
        if not torch.isfinite(tensors[key]).all():
            raise PredictorError(f"{source}: {key} has values that are not finite: the weights are damaged.")


LSTMS = {"traj_lstm_model": "trajectory", "graph_lstm_model": "graph", "pred_lstm_model": "decoder"}
HEADS = {"traj_hidden2pos": "stage1", "traj_gat_hidden2pos": "stage2", "pred_hidden2pos": "stage3"}


def import_released(path: str | Path) -> tuple[Weights, dict[str, Any]]:
    """Read a weight file of the paper's released program.

    Args:
        path: A ``.pth.tar`` with a ``state_dict``.

    Returns:
        Weights of one model (M = 1), and a card.

    Raises:
        PredictorError: the file is missing or damaged, holds anything but tensors and plain values (it is then not
            opened), or is of another model.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise PredictorError(f"There is no file {path}.") from None
    except Exception as error:
        raise PredictorError(
            f"{path} was refused: it is damaged, or holds something besides tensors and plain values, which could run "
            f"code when opened. ({str(error).splitlines()[0]})"
        ) from None
    state = content.get("state_dict") if isinstance(content, dict) else None
    if not isinstance(state, dict):
        raise PredictorError(f"{path} has no `state_dict`: it is no weight file of the released program.")
    tensors: Weights = {}
    for key, value in state.items():
        name, axes = _released_name(key)
        value = value.float()
        tensors[name] = (value.T if axes == "transposed" else value[..., 0] if axes == "squeezed" else value)[None]
    tensors = {key: value.contiguous() for key, value in tensors.items()}
    card = {
        "source": f"released program of the paper, {Path(path).name}",
        "epoch": content.get("epoch"),
        "best_ade": float(content["best_ade"]) if "best_ade" in content else None,
        "selection": "published weights; best ADE on the source validation split, as the released program selects",
    }
    return tensors, card


def _released_name(key: str) -> tuple[str, str]:
    """Our name of a tensor of the released program, and what to do with its axes."""
    module, _, kind = key.rpartition(".")
    if module in LSTMS:
        part, side = kind.split("_")
        end = "input" if side == "ih" else "hidden"
        return f"{LSTMS[module]}.{'bias_' * (part == 'bias')}{end}", "transposed" if part == "weight" else ""
    if module in HEADS:
        return f"{HEADS[module]}.{kind}", "transposed" if kind == "weight" else ""
    if module.startswith("gatencoder.gat_net.layer_stack."):
        layer = int(module.rsplit(".", 1)[1]) + 1
        name = {"a_src": "source", "a_dst": "target"}.get(kind, kind)
        return f"attention{layer}.{name}", "squeezed" if kind.startswith("a_") else ""
    return key, ""
