"""The Gymnasium view of the windows clock: one padded window a step."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from motion_gym.contract import ActionError, Domain, Forecast
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.clocks import extent_of_windows
from motion_gym.stepping.order import check_order, first_scene, order_of
from motion_gym.stepping.padded import Padded
from motion_gym.stepping.render import Canvas
from motion_gym.stepping.spaces import checked_action


class WindowEnv(gymnasium.Env):
    """One window a step, all its agents at once, padded to ``max_agents``.

    ## Observation space
    ``Dict(history=Box(max_agents, 8, F), mask=MultiBinary(max_agents))``: rows whose mask is 0 are zero.

    ## Action space
    ``Box(max_agents, K, 12, 2)``, float32; rows whose mask is 0 are ignored. float64 is cast. ``action="position"``:
    metres; the bounds (``BOUND``) are wider than any recording and are not enforced. ``action="displacement"``:
    consecutive displacements from the last observed position, -1 to 1 times ``displacement_limit``; values beyond
    are clipped.

    ## Reward
    Minus the ADE of the most likely (first) sample, averaged over the window's agents.

    ## Info
    After a step: ``future`` [max_agents, 12, 2], ``known`` [max_agents, 12] and ``ade`` [max_agents] of the window that
    was forecast (0 where the mask was 0), and ``window``, the number of this window.

    ## Episode end
    Terminates after the last window of the split; a full episode is the published test set. Windows are played in the
    order of time. With ``order="shuffled"`` each ``reset`` draws a random order, so that copies of this environment
    with different seeds play different windows.

    Args:
        domain: A name, a spec, ``"module:Class"`` or a domain.
        split: Which split to play.
        samples: K.
        max_agents: Rows of an observation; by default those of the largest window of the split.
        render_mode: ``"rgb_array"``, ``"human"`` or None.
        action: ``"position"`` or ``"displacement"``, see ``Actions``: displacements are scaled to ``Box(-1, 1)``.
        displacement_limit: Largest displacement along x and along y in one step; 1 m by default.
        observation_bound: Bound of every value of a history, for clients that need a finite space; None for none.
        order: ``"published"`` or ``"shuffled"``, see ``ORDERS``.
        **parameters: Parameters of the domain.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 5}  # noqa: RUF012

    def __init__(
        self,
        domain: str | Domain,
        split: str = "test",
        samples: int = 1,
        max_agents: int | None = None,
        render_mode: str | None = None,
        action: str = "position",
        displacement_limit: float | None = None,
        observation_bound: float | None = None,
        order: str = "published",
        **parameters: Any,
    ):
        self.padded = Padded(
            domain, split, max_agents, samples, action, displacement_limit, observation_bound, **parameters
        )
        self.domain = self.padded.domain
        self.observation_space = self.padded.observation_space
        self.action_space = self.padded.action_space
        self.render_mode = render_mode
        self._ordered = check_order(order)
        self.order = np.arange(len(self.padded.sizes))
        self.at = -1
        self.forecast: Forecast | None = None  # of the last window, after any wrappers
        extent, fps = extent_of_windows(self.padded.truth), self.metadata["render_fps"]
        self._canvas = Canvas(render_mode, self.domain, split, self.domain.card.name, extent, fps)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict[str, np.ndarray], dict]:
        """Go to the first window.

        Args:
            seed: Determines the order of this and later episodes with ``order="shuffled"``.
            options: ``{"scene": n}`` begins with window n and goes on from there in the order of the episode.
        """
        windows = len(self.padded.sizes)
        scene = first_scene(options, windows)
        super().reset(seed=seed)
        self.order = order_of(windows, self._ordered, self.np_random, scene)
        self.at, self.forecast = 0, None
        self._show(self.window)
        return self._observe(), {}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Score the forecasts of this window, and go to the next.

        Raises:
            ActionError: The action is not an array of the action space's shape, or has NaN where the mask is 1, or the
                episode is over. The environment does not move then.
        """
        if not 0 <= self.at < len(self.order):
            raise ActionError("The episode is over or has not begun: call reset().")
        action, window = checked_action(action, self.action_space.shape or (), "The action"), self.window
        here = np.array([window])
        action = self.padded.forecasts(here, action[None])[0]
        reward, revealed = self.padded.score(here, action[None])
        info = {key: value[0] for key, value in revealed.items()} | {"window": window}
        self.forecast = Forecast(action[: self.padded.sizes[window]].copy())
        self._show(window)
        self.at += 1
        return self._observe(), float(reward[0]), self.at == len(self.order), False, info

    @property
    def window(self) -> int:
        """Number of the current window; after the end, of the last one."""
        return int(self.order[min(self.at, len(self.order) - 1)])

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """The last step as an image [H, W, 3] uint8 (``rgb_array``); None in ``human`` mode."""
        return self._canvas.image()

    def close(self) -> None:
        """Close the window, if one was opened."""
        self._canvas.close()

    def _observe(self) -> dict[str, np.ndarray]:
        return {key: value[0] for key, value in self.padded.observe(np.array([self.window])).items()}

    def _show(self, window: int) -> None:
        if not self.render_mode:
            return
        truth = pick_scenes(self.padded.truth, slice(window, window + 1))
        self._canvas.update(window, truth.observation, None if self.forecast is None else truth, self.forecast)
