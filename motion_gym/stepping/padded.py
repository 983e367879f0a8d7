"""The windows of a split as arrays of equal size, for the Gymnasium environments."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from motion_gym import catalog
from motion_gym.contract import MOST_SAMPLES, ActionError, Domain, SpecError
from motion_gym.metrics.errors import distance, mean_over_known
from motion_gym.stepping.harness import windows_of_domain
from motion_gym.stepping.spaces import Actions, history_space


class Padded:
    """The windows of a split as arrays of equal size.

    Args:
        domain: A name, a spec, ``"module:Class"`` or a domain.
        split: The split.
        max_agents: Rows of an observation; by default those of the largest window.
        samples: K.
        action: Kind of the actions; see ``Actions``.
        displacement_limit: See ``Actions``.
        observation_bound: Bound of every value of a history; None for an unbounded space.
        **parameters: Parameters of the domain.
    """

    def __init__(
        self,
        domain: str | Domain,
        split: str,
        max_agents: int | None,
        samples: int,
        action: str,
        displacement_limit: float | None,
        observation_bound: float | None,
        **parameters: Any,
    ):
        self.domain = catalog.domain(domain, **parameters)
        self.actions = Actions(action, displacement_limit, self.domain.card.unit)
        self.truth = windows_of_domain(self.domain, split)
        self.sizes = np.diff(self.truth.observation.scene)
        if not len(self.sizes):
            raise SpecError(f"Split `{split}` of `{self.domain!r}` has no window to play.")
        samples = catalog.whole_number("samples", samples, 1, MOST_SAMPLES)
        largest = int(self.sizes.max())
        max_agents = largest if max_agents is None else catalog.whole_number("max_agents", max_agents, 1, 10_000)
        if max_agents < largest:
            raise SpecError(
                f"`max_agents={max_agents}` is too small: a window of `{self.domain.card.name}` has {largest} agents. "
                f"Leave max_agents out, or give {largest} or more."
            )
        self.samples, self.max_agents = samples, max_agents
        # Padded once, so that a step only selects rows.
        self.mask = np.arange(self.max_agents) < self.sizes[:, None]
        self.history = self._pad(self.truth.observation.history)
        self.future = self._pad(self.truth.future)
        self.known = self._pad(self.truth.known)
        reach = float(np.abs(self.history).max())
        self.observation_space = gymnasium.spaces.Dict(
            history=history_space(self.history.shape[1:], observation_bound, reach, self.domain.card.name),
            mask=gymnasium.spaces.MultiBinary(self.max_agents),
        )
        self.action_space = self.actions.space(self.max_agents, samples)

    def observe(self, windows: np.ndarray) -> dict[str, np.ndarray]:
        """History [N, max_agents, 8, F] and mask [N, max_agents] of the given windows."""
        return {"history": self.history[windows], "mask": self.mask[windows].astype(np.int8)}

    def forecasts(self, windows: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Forecast positions of actions, both [N, max_agents, K, 12, 2]."""
        return self.actions.positions(actions, self.history[windows][:, :, -1, :2])

    def score(self, windows: np.ndarray, forecasts: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Score [N, max_agents, K, 12, 2] forecasts.

        Returns:
            Reward [N], minus the mean ADE, and the revealed arrays: future [N, max_agents, 12, 2], known
            [N, max_agents, 12] and ade [N, max_agents], 0 where the mask is 0.

        Raises:
            ActionError: A forecast is not finite where the mask is 1.
        """
        mask, future, known = self.mask[windows], self.future[windows], self.known[windows]
        with np.errstate(invalid="ignore", over="ignore"):  # rows where the mask is 0 may have any values
            finite = np.isfinite(forecasts.sum())
            error = distance(forecasts[:, :, 0].astype(np.float64) - future)
        if not finite:
            bad = np.argwhere(mask & ~np.isfinite(forecasts).all(axis=(2, 3, 4)))
            if len(bad):
                raise ActionError(
                    f"The action has NaN or infinite positions in row {bad[0, 1]} of window {windows[bad[0, 0]]}; "
                    "where the mask is 1, every position must be finite."
                )
        ade = np.where(mask, mean_over_known(error, known), 0.0)
        reward = -ade.sum(axis=1) / np.maximum(mask.sum(axis=1), 1)
        return reward, {"future": future, "known": known, "ade": ade}

    def _pad(self, rows: np.ndarray) -> np.ndarray:
        padded = np.zeros((*self.mask.shape, *rows.shape[1:]), rows.dtype)
        padded[self.mask] = rows
        return padded
