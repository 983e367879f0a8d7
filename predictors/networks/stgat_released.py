"""Reads the weights of the paper's released program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from motion_gym.contract import PredictorError
from motion_gym.training.program import Weights

LSTMS = {"traj_lstm_model": "trajectory", "graph_lstm_model": "graph", "pred_lstm_model": "decoder"}
HEADS = {"traj_hidden2pos": "stage1", "traj_gat_hidden2pos": "stage2", "pred_hidden2pos": "stage3"}


def import_released(path: str | Path) -> tuple[Weights, dict[str, Any]]:
    """Read a weight file of the paper's released program.

    Args:
        path: A ``.pth.tar`` with a ``state_dict``.

    Returns:
        Weights of one model (M = 1), and a card.

    Raises:
        PredictorError: the file is missing or damaged, belongs to another model, or holds anything but tensors and
            plain values (such a file is not opened).
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise PredictorError(f"There is no file {path}.") from None
    except Exception as error:  # torch raises its own types; its message explains how to open the file unsafely
        raise PredictorError(
            f"{path} was refused: it is damaged, or holds objects other than tensors and plain values, which could run "
            f"code when opened ({type(error).__name__})."
        ) from None
    state = content.get("state_dict") if isinstance(content, dict) else None
    if not isinstance(state, dict):
        raise PredictorError(f"{path} has no `state_dict`: it is not a weight file of the released program.")
    tensors: Weights = {}
    for key, value in state.items():
        try:
            name, axes = _released_name(key)
            value = value.float()
            value = value.T if axes == "transposed" else value[..., 0] if axes == "squeezed" else value
        except Exception:  # the key or the value can be anything
            raise PredictorError(f"{path}: `{key}` is not a tensor of the released program's STGAT.") from None
        if name in tensors:
            raise PredictorError(f"{path} has two tensors for {name}.")
        tensors[name] = value[None].contiguous()
    card = {
        "dt": 0.4,
        "source": f"released program of the paper, {Path(path).name}",
        "selection": "published weights; best ADE on the source validation split, as the released program selects",
    }
    return tensors, card


def _released_name(key: str) -> tuple[str, str]:
    """The name of a tensor in this library, and the operation on its axes: "transposed", "squeezed" or none."""
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
