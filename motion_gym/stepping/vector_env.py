"""The Gymnasium vector view of the windows clock: many padded windows a step."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from motion_gym import catalog
from motion_gym.contract import ActionError, Domain, SpecError
from motion_gym.stepping.order import check_order, first_scenes, order_of
from motion_gym.stepping.padded import Padded
from motion_gym.stepping.spaces import checked_action


class WindowVectorEnv(VectorEnv):
    """Many windows a step, as one array operation.

    Sub-environment i of n plays windows i, i + n, i + 2n, ... of the split, so that one episode of all sub-environments
    is the published test set, each window once. With ``order="shuffled"`` each ``reset`` shuffles the windows first.
    Spaces, rewards and infos are those of ``WindowEnv`` with a leading axis. The next step resets a sub-environment
    that has ended (its action is ignored and its reward 0), as in Gymnasium's ``NEXT_STEP`` mode; it then plays its
    windows again.

    Args:
        domain: A name, a spec, ``"module:Class"`` or a domain.
        num_envs: n, at most the number of windows.
        split: Which split to play.
        samples: K.
        max_agents: Rows of an observation; by default those of the largest window of the split.
        render_mode: None.
        action: ``"position"`` or ``"displacement"``, see ``Actions``: displacements are scaled to ``Box(-1, 1)``.
        displacement_limit: Largest displacement along x and along y in one step; 1 m by default.
        observation_bound: Bound of every value of a history, for clients that need a finite space; None for none.
        order: ``"published"`` or ``"shuffled"``, see ``ORDERS``.
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
        action: str = "position",
        displacement_limit: float | None = None,
        observation_bound: float | None = None,
        order: str = "published",
        **parameters: Any,
    ):
        if render_mode is not None:
            raise SpecError("The vector environment draws no pictures: leave render_mode out, or use one environment.")
        self.padded = Padded(
            domain, split, max_agents, samples, action, displacement_limit, observation_bound, **parameters
        )
        self.domain = self.padded.domain
        windows = len(self.padded.sizes)
        num_envs = catalog.whole_number("num_envs", num_envs, 1, windows)
        self.num_envs = num_envs
        self.render_mode = None
        self.single_observation_space = self.padded.observation_space
        self.single_action_space = self.padded.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ordered = check_order(order)
        self.order, self.at = np.arange(windows), np.arange(num_envs)
        self._ended = np.zeros(num_envs, bool)
        self._begun = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Go to the first window of each sub-environment.

        Args:
            seed: One seed, or one for each sub-environment; together they determine the order of this and later
                episodes with ``order="shuffled"``.
            options: ``{"scene": n}`` or ``{"scene": [n, ...]}``, one number for each sub-environment: it begins with
                window n and goes on from there in the order of the episode.

        Raises:
            SpecError: A scene or a seed is not allowed, or there are not as many as sub-environments.
        """
        windows = len(self.order)
        scenes = first_scenes(options, windows, self.num_envs)
        several = isinstance(seed, (list, tuple, np.ndarray))
        listed = list(seed) if several else [seed]  # type: ignore[arg-type]
        if several and len(listed) != self.num_envs:
            raise SpecError(
                f"`seed` has {len(listed)} values: give one, or one for each of {self.num_envs} environments."
            )
        seeds = [catalog.whole_number("seed", s, 0, 2**63 - 1) for s in listed if s is not None]
        if seeds:
            self._np_random, self._np_random_seed = np.random.default_rng(seeds), seeds[0]
        self.order = order_of(windows, self._ordered, self.np_random)
        self.at = np.arange(self.num_envs) if scenes is None else np.argsort(self.order)[scenes]
        self._ended[:] = False
        self._begun = True
        return self.padded.observe(self.window), {}

    @property
    def window(self) -> np.ndarray:
        """[n] number of the current window of each sub-environment."""
        return self.order[self.at]

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Score the forecasts of all current windows, and go to the next windows.

        Raises:
            ActionError: As for ``WindowEnv``; no sub-environment moves then.
        """
        if not self._begun:
            raise ActionError("The episode has not begun: call reset().")
        actions, window = checked_action(actions, self.action_space.shape or (), "The action"), self.window
        playing = ~self._ended
        if not playing.all():
            actions = np.where(playing[:, None, None, None, None], actions, np.float32(0))
        reward, revealed = self.padded.score(window, self.padded.forecasts(window, actions))
        reward[self._ended] = 0
        infos: dict[str, Any] = {}
        for key, value in {**revealed, "window": window}.items():
            value[self._ended] = 0
            infos[key], infos[f"_{key}"] = value, playing.copy()
        following = self.at + self.num_envs
        ended = playing & (following >= len(self.order))
        self.at = np.where(self._ended, np.arange(self.num_envs), np.where(ended, self.at, following))
        self._ended = ended
        return self.padded.observe(self.window), reward, ended.copy(), np.zeros(self.num_envs, bool), infos
