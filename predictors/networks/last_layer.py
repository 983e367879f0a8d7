"""Interfaces of adaptable predictors: weights that can be tuned by gradients, and a linear last layer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from torch import Tensor

from motion_gym.contract import FUTURE, Observation, PredictorError, Truth
from motion_gym.specs import one_of
from motion_gym.stepping.harness import name_of
from motion_gym.training.program import Weights


@runtime_checkable
class Tunable(Protocol):
    """A predictor whose weights can be tuned by gradients.

    Attributes:
        tensors: The weights, by name, with a leading axis of 1.
        parts: Tunable parts, by name: prefixes of the names of weights. Includes ``all``.
    """

    tensors: Weights | None
    parts: Mapping[str, tuple[str, ...]]

    def offsets(self, observation: Observation, weights: Weights, seed: int = 0, shown: Truth | None = None) -> Tensor:
        """Forecast with given weights.

        Args:
            observation: A agents.
            weights: Weights [M, ...] of M models.
            seed: Seed of a stochastic forecast, whose first sample is returned.
            shown: Scenes to read the style from; None for the style observed so far.

        Returns:
            [M, A, 12, 2], metres from the last observed position; differentiable with respect to the weights.
        """


@dataclass(frozen=True)
class LastLayer:
    """The linear last layer of a predictor, for the A agents of an observation.

    The forecast is a function of ``inputs @ weight``, the outputs. A row of the outputs holds 2D vectors of successive
    future steps, of one agent or of all agents of a scene one after another: 12 A / R vectors in each of the R rows, in
    the order of agents and steps.

    Attributes:
        inputs: [R, C] float64; the last column is 1, for the bias.
        weight: [C, O] float64, of the trained predictor; O = 24 A / R.
        last: [A, 1 or 12, 2] float64, positions that the vectors start from, metres, world frame: the last observed
            ones, or those of a simpler forecast.
        turn: [A, 2, 2] matrices that turn world row vectors into the frame of the outputs; None for the world frame.
        moves: Whether the vectors are displacements from step to step instead of offsets from ``last``.
        scale: [A] float64, length of a vector of length 1 of each agent, in the unit of positions; None for 1.
    """

    inputs: np.ndarray
    weight: np.ndarray
    last: np.ndarray
    turn: np.ndarray | None = None
    moves: bool = True
    scale: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray):
                view = value.view()
                view.flags.writeable = False  # copies of an adapter share the arrays
                object.__setattr__(self, name, view)

    def positions(self, outputs: np.ndarray) -> np.ndarray:
        """Positions [A, 12, 2], metres, world frame, of outputs [R, O]."""
        vectors = outputs.reshape(-1, FUTURE, 2)
        if self.moves:
            vectors = vectors.cumsum(axis=1)
        if self.turn is not None:
            vectors = vectors @ self.turn.transpose(0, 2, 1)
        if self.scale is not None:
            vectors = vectors * self.scale[:, None, None]
        return np.asarray(self.last + vectors)

    def outputs(self, positions: np.ndarray) -> np.ndarray:
        """Outputs [R, O] of positions [A, 12, 2]: the inverse of ``positions``."""
        vectors = positions - self.last
        if self.scale is not None:
            vectors = vectors / np.where(self.scale > 0, self.scale, 1.0)[:, None, None]
        if self.turn is not None:
            vectors = vectors @ self.turn
        if self.moves:
            vectors = np.diff(vectors, axis=1, prepend=0)
        return np.asarray(vectors.reshape(len(self.inputs), self.weight.shape[1]))

    def known_rows(self, known: np.ndarray) -> np.ndarray:
        """[R] bool, the rows whose vectors are all known, if positions are known where ``known`` [A, 12] is True."""
        vectors = known.copy()
        if self.moves:
            vectors[:, 1:] &= known[:, :-1]
        return np.asarray(vectors.reshape(len(self.inputs), -1).all(axis=1))

    def by_step(self, values: np.ndarray) -> np.ndarray:
        """Values [R] of the rows, repeated for the agents and steps of each row: [A, 12]."""
        return np.repeat(values, len(self.last) * FUTURE // max(len(values), 1)).reshape(-1, FUTURE)


def with_bias_input(inputs: np.ndarray) -> np.ndarray:
    """Inputs [R, C] with a further column of ones, for the bias: [R, C + 1]."""
    return np.concatenate([inputs, np.ones((len(inputs), 1))], axis=1)


@runtime_checkable
class Linearised(Protocol):
    """A predictor with a replaceable linear last layer."""

    def last_layer(self, observation: Observation, seed: int = 0) -> LastLayer:
        """The last layer for the agents of an observation."""


def tunable(predictor: Any, parts: str) -> list[str]:
    """Names of the weights of a part of a predictor.

    Raises:
        PredictorError: the predictor cannot be tuned, or lacks this part.
        SpecError: no predictor has this part.
    """
    name = name_of(predictor)
    if not isinstance(predictor, Tunable):
        raise PredictorError(
            f"{name} has no weights that gradients reach (`tensors`, `parts`, `offsets`): use one of the STGAT or "
            "modular family, such as erm or modular_invariant, or kalman_residual, or heatmap; `linear` is adapted by "
            "kalman."
        )
    one_of("parts", parts, {"all", "style", "modulator", "last_layer", *predictor.parts})
    if parts not in predictor.parts:
        raise PredictorError(
            f"{name} has no part `{parts}`, as it reads no style: it has {', '.join(predictor.parts)}. For a style, "
            "use modular_invariant or modular_stgat."
        )
    return sorted(key for key in predictor.tensors or {} if key.startswith(predictor.parts[parts]))
