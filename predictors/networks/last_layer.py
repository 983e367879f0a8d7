"""What a predictor offers to be adapted: weights that forecasts depend on smoothly, and a last layer that is linear."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from torch import Tensor

from motion_gym import catalog
from motion_gym.contract import FUTURE, Observation, PredictorError, SpecError, Truth
from motion_gym.stepping.harness import name_of

Weights = dict[str, Tensor]


@runtime_checkable
class Tunable(Protocol):
    """A predictor whose weights can be tuned by gradients.

    Attributes:
        tensors: The weights, by name, with a leading axis of 1.
        parts: What can be tuned, by name: beginnings of names of weights. ``all`` is one of them.
    """

    tensors: Weights | None
    parts: Mapping[str, tuple[str, ...]]

    def offsets(self, observation: Observation, weights: Weights, seed: int = 0, shown: Truth | None = None) -> Tensor:
        """Forecast by given weights.

        Args:
            observation: A agents.
            weights: Of M models, [M, ...].
            seed: Of what is random; the first sample is given.
            shown: Scenes of which all is known, to read the style from; None for the style observed so far.

        Returns:
            [M, A, 12, 2], metres from the last observed position; differentiable with respect to the weights.
        """
        ...


@dataclass(frozen=True)
class LastLayer:
    """What a predictor's forecasts are a linear map of.

    Attributes:
        inputs: [R, C] float64, the last one a 1 for the bias.
        weight: [C, O] float64, of the trained predictor.
        positions: Forecast positions [A, 12, 2], metres, from outputs [R, O].
        outputs: What the outputs should have been [R, O], from true positions [A, 12, 2].
        by_row: [R] bool, which rows are known, from what is known [A, 12].
        by_step: [A, 12] from values [R] of the rows.
    """

    inputs: np.ndarray
    weight: np.ndarray
    positions: Callable[[np.ndarray], np.ndarray]
    outputs: Callable[[np.ndarray], np.ndarray]
    by_row: Callable[[np.ndarray], np.ndarray]
    by_step: Callable[[np.ndarray], np.ndarray]

    def __post_init__(self) -> None:
        for name in ("inputs", "weight"):  # copies of an adapter share them
            array = getattr(self, name).view()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def of_moves(cls, observation: Observation, inputs: np.ndarray, weight: np.ndarray, moves: int) -> LastLayer:
        """A last layer whose outputs are ``moves`` successive displacements, rows in order of agents and steps.

        Args:
            observation: A agents.
            inputs: [R, C - 1], without the one; R is 12 A / moves.
            weight: [C, 2 moves].
            moves: Displacements of a row.
        """
        last = observation.xy[:, -1:].astype(np.float64)

        def positions(outputs: np.ndarray) -> np.ndarray:
            return last + outputs.reshape(-1, FUTURE, 2).cumsum(axis=1)

        def outputs(future: np.ndarray) -> np.ndarray:
            return np.diff(np.concatenate([last, future], axis=1), axis=1).reshape(-1, 2 * moves)

        def by_row(known: np.ndarray) -> np.ndarray:
            ends = known[:, :1], known[:, 1:] & known[:, :-1]  # of each displacement
            return np.asarray(np.concatenate(ends, axis=1).reshape(-1, moves).all(axis=1))

        return cls(
            np.concatenate([inputs, np.ones((len(inputs), 1))], axis=1),
            weight,
            positions,
            outputs,
            by_row,
            lambda values: np.repeat(values, moves).reshape(-1, FUTURE),
        )


@runtime_checkable
class Linearised(Protocol):
    """A predictor whose last layer can be replaced."""

    def last_layer(self, observation: Observation, seed: int = 0) -> LastLayer:
        """The last layer for the agents of an observation."""
        ...


def tunable(predictor: Any, parts: str) -> list[str]:
    """Names of the weights of some parts of a predictor.

    Raises:
        PredictorError: the predictor cannot be tuned, or has not this part.
        SpecError: no predictor has it.
    """
    name = name_of(predictor)
    if not isinstance(predictor, Tunable):
        raise PredictorError(
            f"{name} has no weights that gradients reach (`tensors`, `parts`, `offsets`): use one of the STGAT or "
            "modular family, as erm or modular_invariant; `linear` is adapted by kalman."
        )
    known = ("all", "style", "modulator", "last_layer")
    if parts not in {*known, *predictor.parts}:
        raise SpecError(f"There is no `parts={parts}` to tune.{catalog.suggest(str(parts), known)}")
    if parts not in predictor.parts:
        raise PredictorError(
            f"{name} has no part `{parts}`, as it reads no style: it has {', '.join(predictor.parts)}. For a style, "
            "use modular_invariant or modular_stgat."
        )
    return sorted(key for key in predictor.tensors or {} if key.startswith(predictor.parts[parts]))
