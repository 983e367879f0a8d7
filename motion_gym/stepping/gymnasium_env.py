"""The Gymnasium views of the windows clock: one padded window a step, alone or many at once."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from motion_gym import catalog
from motion_gym.contract import (
    FUTURE,
    MOST_SAMPLES,
    ActionError,
    Domain,
    Forecast,
    SpecError,
    check_action,
)
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import distance, mean_over_known
from motion_gym.stepping.clocks import WindowsClock
from motion_gym.stepping.harness import windows_of_domain
from motion_gym.stepping.render import Canvas, check_render_mode


class Padded:
    """The windows of a split as arrays of equal size.

    Args:
        domain: A name, a spec, ``"module:Class"`` or a domain.
        split: Which split.
        max_agents: Rows of an observation; by default those of the largest window.
        samples: K.
        **parameters: Parameters of the domain.
    """

    def __init__(self, domain: str | Domain, split: str, max_agents: int | None, samples: int, **parameters: Any):
        self.domain = catalog.domain(domain, **parameters)
        self.truth = windows_of_domain(self.domain, split)
        self.sizes = np.diff(self.truth.observation.scene)
        if not len(self.sizes):
            raise SpecError(f"Split `{split}` of `{self.domain!r}` has no window to play.")
        samples = catalog.whole_number("samples", samples, 1, MOST_SAMPLES)
        if max_agents is not None:
            max_agents = catalog.whole_number("max_agents", max_agents, 1, 10_000)
        largest = int(self.sizes.max())
        if max_agents is not None and max_agents < largest:
            raise SpecError(
                f"`max_agents={max_agents}` is too small: a window of `{self.domain.card.name}` has {largest} agents. "
                f"Leave max_agents out, or give {largest} or more."
            )
        self.samples, self.max_agents = samples, max_agents or largest
        # Padded once, so that a step only picks rows.
        self.mask = np.arange(self.max_agents) < self.sizes[:, None]
        self.history = self._pad(self.truth.observation.history)
        self.future = self._pad(self.truth.future)
        self.known = self._pad(self.truth.known)
        infinite = np.inf
        self.observation_space = gymnasium.spaces.Dict(
            history=gymnasium.spaces.Box(-infinite, infinite, self.history.shape[1:], np.float32),
            mask=gymnasium.spaces.MultiBinary(self.max_agents),
        )
        self.action_space = gymnasium.spaces.Box(-infinite, infinite, (self.max_agents, samples, FUTURE, 2), np.float32)

    def observe(self, windows: np.ndarray) -> dict[str, np.ndarray]:
        """History [N, max_agents, 8, F] and mask [N, max_agents] of the given windows."""
        return {"history": self.history[windows], "mask": self.mask[windows].astype(np.int8)}

    def score(self, windows: np.ndarray, actions: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Score [N, max_agents, K, 12, 2] forecasts.

        Returns:
            Reward [N], minus the mean ADE, and what is revealed: future [N, max_agents, 12, 2], known
            [N, max_agents, 12] and ade [N, max_agents], 0 where the mask is 0.

        Raises:
            ActionError: a forecast of an agent whose mask is 1 is not finite.
        """
        mask, future, known = self.mask[windows], self.future[windows], self.known[windows]
        with np.errstate(invalid="ignore", over="ignore"):  # Where the mask is 0 there may be anything.
            finite = np.isfinite(actions.sum())
            error = distance(actions[:, :, 0].astype(np.float64) - future)
        if not finite:
            bad = np.argwhere(mask & ~np.isfinite(actions).all(axis=(2, 3, 4)))
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


class WindowEnv(gymnasium.Env):
    """One window a step, all its agents at once, padded to ``max_agents``.

    ## Observation space
    ``Dict(history=Box(max_agents, 8, F), mask=MultiBinary(max_agents))``: rows whose mask is 0 are zero.

    ## Action space
    ``Box(max_agents, K, 12, 2)``, float32, metres; rows whose mask is 0 are ignored.

    ## Reward
    Minus the ADE of the most likely (first) sample, averaged over the window's agents.

    ## Info
    After a step: ``future`` [max_agents, 12, 2], ``known`` [max_agents, 12], ``ade`` [max_agents] of the window that
    was forecast (0 where the mask was 0), and ``window``, its number.

    ## Episode end
    Terminates after the last window of the split; a full episode is the published test set.

    Args:
        domain: A name, a spec, ``"module:Class"`` or a domain.
        split: Which split to play.
        samples: K.
        max_agents: Rows of an observation; by default those of the largest window of the split.
        render_mode: ``"rgb_array"``, ``"human"`` or None.
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
        **parameters: Any,
    ):
        check_render_mode(render_mode)
        self.padded = Padded(domain, split, max_agents, samples, **parameters)
        self.domain = self.padded.domain
        self.observation_space = self.padded.observation_space
        self.action_space = self.padded.action_space
        self.render_mode = render_mode
        self.window = -1
        self.forecast: Forecast | None = None  # Of the last window, as it arrived here through any wrappers.
        card = self.domain.card
        extent = WindowsClock(self.padded.truth).extent
        self._canvas = Canvas(card.name, extent, card.unit, self.metadata["render_fps"])

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict[str, np.ndarray], dict]:
        """Go to the first window. The data is what it is: seed and options change nothing."""
        super().reset(seed=seed)
        self.window, self.forecast = 0, None
        self._show(0)
        return self._observe(), {}

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Score the forecasts of this window, and go to the next.

        Raises:
            ActionError: the action is not a float32 array of the action space's shape, or has NaN where the mask is
                1, or the episode is over. The environment has not moved then.
        """
        last = len(self.padded.sizes) - 1
        if not 0 <= self.window <= last:
            raise ActionError("The episode is over, or was not begun: call reset().")
        check_action(action, self.action_space.shape or (), "The action")
        reward, revealed = self.padded.score(np.array([self.window]), action[None])
        info = {key: value[0] for key, value in revealed.items()} | {"window": self.window}
        self.forecast = Forecast(action[: self.padded.sizes[self.window]].copy())
        self._show(self.window)
        self.window += 1
        return self._observe(), float(reward[0]), self.window > last, False, info

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """The last step as an image [H, W, 3] uint8 (``rgb_array``); None in ``human`` mode."""
        return self._canvas.image(self.render_mode)

    def close(self) -> None:
        """Close the window, if one was opened."""
        self._canvas.close()

    def _observe(self) -> dict[str, np.ndarray]:
        at = min(self.window, len(self.padded.sizes) - 1)
        return {key: value[0] for key, value in self.padded.observe(np.array([at])).items()}

    def _show(self, window: int) -> None:
        if not self.render_mode:
            return
        truth = pick_scenes(self.padded.truth, slice(window, window + 1))
        self._canvas.update(window, truth.observation, None if self.forecast is None else truth, self.forecast)
        if self.render_mode == "human":
            self._canvas.show()


class WindowVectorEnv(VectorEnv):
    """Many windows a step, as one array operation.

    The windows of the split are dealt out: sub-environment i of n plays windows i, i + n, i + 2n, ... so that one
    round of all sub-environments is the published test set, each window once. Spaces, rewards and infos are those of
    ``WindowEnv`` with a leading axis; a sub-environment that has ended is reset by the next step (its action is
    ignored and its reward 0), as in Gymnasium's ``NEXT_STEP`` mode.

    Args:
        domain: A name, a spec, ``"module:Class"`` or a domain.
        num_envs: n, at most the number of windows.
        split: Which split to play.
        samples: K.
        max_agents: Rows of an observation; by default those of the largest window of the split.
        **parameters: Parameters of the domain.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        domain: str | Domain,
        num_envs: int = 1,
        split: str = "test",
        samples: int = 1,
        max_agents: int | None = None,
        render_mode: str | None = None,
        **parameters: Any,
    ):
        if render_mode is not None:
            raise SpecError("The vector environment draws no pictures: leave render_mode out, or use one environment.")
        self.padded = Padded(domain, split, max_agents, samples, **parameters)
        self.domain = self.padded.domain
        windows = len(self.padded.sizes)
        num_envs = catalog.whole_number("num_envs", num_envs, 1, windows)
        self.num_envs = num_envs
        self.render_mode = None
        self.single_observation_space = self.padded.observation_space
        self.single_action_space = self.padded.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.window = np.arange(num_envs)
        self._ended = np.zeros(num_envs, bool)
        self._begun = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Each sub-environment goes to its first window. The data is what it is: seed and options change nothing."""
        self.window = np.arange(self.num_envs)
        self._ended[:] = False
        self._begun = True
        return self.padded.observe(self.window), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Score the forecasts of all current windows, and go to the next ones.

        Raises:
            ActionError: as for ``WindowEnv``; no sub-environment has moved then.
        """
        if not self._begun:
            raise ActionError("The episode was not begun: call reset().")
        check_action(actions, self.action_space.shape or (), "The action")
        playing = ~self._ended
        if not playing.all():
            actions = np.where(playing[:, None, None, None, None], actions, np.float32(0))
        reward, revealed = self.padded.score(self.window, actions)
        reward[self._ended] = 0
        infos: dict[str, Any] = {}
        for key, value in {**revealed, "window": self.window.copy()}.items():
            value[self._ended] = 0
            infos[key], infos[f"_{key}"] = value, playing.copy()
        following = self.window + self.num_envs
        ended = playing & (following >= len(self.padded.sizes))
        self.window = np.where(self._ended, np.arange(self.num_envs), np.where(ended, self.window, following))
        self._ended = ended
        return self.padded.observe(self.window), reward, ended.copy(), np.zeros(self.num_envs, bool), infos
