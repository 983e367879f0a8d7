"""The Gymnasium environment in which an agent drives the ego vehicle: ``motion_gym/Drive-v0``."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium
import numpy as np

from motion_gym import catalog
from motion_gym.contract import FUTURE, HISTORY, ActionError, Domain, Forecast, Observation, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.driving.episodes import OTHERS, STEPS
from motion_gym.driving.evaluation import episodes_of
from motion_gym.driving.pictures import Picture
from motion_gym.driving.planner import SHORTEST_TTC, composite, is_comfortable, plan
from motion_gym.driving.proposals import BRAKE, DT, Plans, propose
from motion_gym.driving.run import Run
from motion_gym.specs import one_of, suggest, whole_number

ACTIONS = {
    "proposal": "the number of a proposal, 0 to 14, or 15 for the emergency brake",
    "control": "acceleration in m/s^2, and steering angle in radians to the left",
}
LIMITS = np.array([[-6.0, -0.5], [3.0, 0.5]], np.float32)
"""Smallest and largest acceleration and steering angle."""
SPACING, POINTS = 5.0, 12
"""Distance, in metres, and number of the points of the path that are observed."""
MODES = ("rgb_array",)


class DriveEnv(gymnasium.Env):
    """Drive an ego vehicle among others, by choosing proposals or by acceleration and steering.

    ## Description
    Each episode begins at a moment of a recording: one vehicle becomes the ego vehicle, and those near it are the
    others. A step is 0.4 s, an episode 14 steps. The proposals are 5 speeds by 3 lateral positions, see ``Plans``.

    ## Observation space
    ``Dict(history=Box(M, 8, 2), mask=MultiBinary(M), ego=Box(6), path=Box(12, 2))``, metres and seconds, y up. The
    histories are those of the others, then that of the ego vehicle; rows whose mask is 0 are zero. ``ego``: x, y,
    heading, speed, acceleration and lateral position on the path. ``path``: points of the path ahead, 5 m apart.

    ## Action space
    ``action="proposal"``: ``Discrete(16)``, a proposal or, 15, the emergency brake. ``action="control"``: ``Box(2)``,
    acceleration in m/s^2 and steering angle in radians to the left; values beyond the bounds are clipped.

    ## Reward
    The composite of the step, 0 to 1: 0 after a collision or off the road, else the weighted mean (5, 5, 2) of: time
    to collision 0.95 s or more; progress as a share of that at the target speed; comfort.

    ## Info
    The scores of the episode so far, see ``METRICS``, and ``episode``, the number of the moment.

    ## Episode end
    Terminates after a collision and at the end of the path; truncates after 14 steps.

    Args:
        domain: A domain with roads: a name, a spec or a domain.
        split: Split of the domain.
        others: ``"react"`` or ``"replay"``, see ``OTHERS``.
        action: ``"proposal"`` or ``"control"``.
        render_mode: ``"rgb_array"`` or None.
        **parameters: Parameters of the domain, as ``style`` and ``scenario``.

    Raises:
        SpecError: A name or a value is not known or not allowed, or highway-env is not installed.
    """

    metadata: dict[str, Any] = {"render_modes": list(MODES), "render_fps": 5}  # noqa: RUF012

    def __init__(
        self,
        domain: str | Domain = "highway",
        split: str = "test",
        others: str = "react",
        action: str = "proposal",
        render_mode: str | None = None,
        **parameters: Any,
    ):
        self.others, self.action = one_of("others", others, OTHERS), one_of("action", action, ACTIONS)
        if render_mode is not None:
            one_of("render_mode", render_mode, MODES)
        self.render_mode = render_mode
        self.domain = catalog.domain(domain, **parameters)
        self.episodes = episodes_of(self.domain, split)
        self.most = self.episodes.most + 1
        box = gymnasium.spaces.Box
        self.observation_space = gymnasium.spaces.Dict({
            "history": box(-np.inf, np.inf, (self.most, HISTORY, 2), np.float32),
            "mask": gymnasium.spaces.MultiBinary(self.most),
            "ego": box(-np.inf, np.inf, (6,), np.float32),
            "path": box(-np.inf, np.inf, (POINTS, 2), np.float32),
        })  # fmt: skip
        self.action_space: Any = (
            gymnasium.spaces.Discrete(BRAKE + 1)
            if action == "proposal"
            else box(LIMITS[0], LIMITS[1], dtype=np.float32)
        )
        self.run: Run | None = None
        self.plans: Plans | None = None
        self.number = 0
        self.forecast: Forecast | None = None
        self._picture = Picture(self.domain)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict[str, np.ndarray], dict]:
        """Begin an episode at a moment, and with an ego vehicle, that are drawn by the seed.

        Args:
            seed: Seed of this and later episodes.
            options: ``{"episode": n}`` begins at moment n of the split.
        """
        super().reset(seed=seed)
        number = self._chosen(options)
        number = int(self.np_random.integers(len(self.episodes))) if number is None else number
        self.run = Run(self.domain, self.episodes.episode(number, self.np_random), self.others)
        self.plans = self.forecast = None
        return self._observe(), {"episode": number}

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Drive for 0.4 s.

        Raises:
            ActionError: The action is none of the action space, or the episode is over. The environment does not move.
        """
        run = self.run
        if run is None or run.over or run.step >= STEPS:
            raise ActionError("The episode is over or has not begun: call reset().")
        before = run.ego.s
        if self.action == "proposal":
            self.number = self._proposal(action)
            if self.forecast is None or self.plans is None:
                self.plans = propose(run.ego, run.episode.path, run.forecast_paths(self._at_constant_velocity()))
            run.follow(self.plans, self.number)
        else:
            acceleration, steering = self._control(action)
            run.steer(acceleration, steering)
        self.plans = self.forecast = None
        comfort = is_comfortable(*np.array(run.driven[-2:]).T[:, None])
        share = np.clip((run.ego.s - before) / (run.episode.path.speed * DT), 0.0, 1.0)
        allowed = not run.collision and run.on_road
        reward = float(allowed * composite(np.array(run.ttc[-1] >= SHORTEST_TTC), share, comfort[0]))
        info = {**run.scores(), "episode": run.episode.number}
        return self._observe(), reward, run.over, bool(run.step >= STEPS and not run.over), info

    @property
    def observation(self) -> Observation:
        """What a predictor sees: the others, and the ego vehicle as the last agent."""
        return self._running().observation()

    def best_proposal(self, forecast: Forecast | np.ndarray) -> int:
        """The proposal that the planner chooses for the forecast of ``observation``; the next step drives it.

        Args:
            forecast: A forecast, or its positions [A, K, 12, 2].
        """
        run = self._running()
        self.forecast = forecast if isinstance(forecast, Forecast) else Forecast(np.asarray(forecast))
        positions = self.forecast.most_likely()
        expected = (len(run.there) + 1, FUTURE, 2)
        if positions.shape != expected:
            raise ActionError(
                f"The forecast has the shape {positions.shape} without samples, and {expected} is needed."
            )
        paths = run.forecast_paths(positions)
        self.plans, _, self.number = plan(run.ego, run.episode.path, paths, run.others[run.there, 2])
        return self.number

    def render(self) -> np.ndarray:  # type: ignore[override]
        """The road, the vehicles, the forecast and the plan, as an image [H, W, 3] uint8."""
        if self.render_mode is None:
            raise SpecError("The environment was made without a render_mode: make it with render_mode='rgb_array'.")
        forecast = None if self.forecast is None else self.forecast.most_likely()
        return self._picture.image(self._running(), self.plans, self.number, forecast)

    def _running(self) -> Run:
        if self.run is None:
            raise SpecError("No episode has begun: call reset() first.")
        return self.run

    def _observe(self) -> dict[str, np.ndarray]:
        run = self._running()
        seen = run.observation().history
        history = np.zeros((self.most, HISTORY, 2), np.float32)
        history[: len(seen)] = seen
        ahead = run.ego.s + SPACING * np.arange(1, POINTS + 1)
        ego = [*run.states[-1], run.ego.acceleration, run.ego.d]
        return {
            "history": history,
            "mask": (np.arange(self.most) < len(seen)).astype(np.int8),
            "ego": np.array(ego, np.float32),
            "path": run.episode.path.position(ahead, np.zeros(POINTS)).astype(np.float32),
        }

    def _at_constant_velocity(self) -> np.ndarray:
        """Positions [N, 12, 2] of the others, by which proposals follow a leader if there is no forecast."""
        run = self._running()
        x, y, heading, speed = run.others[run.there].T
        velocity = np.stack([np.cos(heading), np.sin(heading)], axis=-1) * speed[:, None]
        return np.stack([x, y], axis=-1)[:, None] + velocity[:, None] * (np.arange(1, FUTURE + 1) * DT)[:, None]

    def _proposal(self, action: Any) -> int:
        value = np.asarray(action)
        if value.shape != () or value.dtype.kind not in "iu" or not 0 <= int(value) <= BRAKE:
            raise ActionError(f"The action is {action!r}: give {ACTIONS['proposal']}.")
        return int(value)

    def _control(self, action: Any) -> tuple[float, float]:
        try:
            value = np.asarray(action, np.float64)
        except (TypeError, ValueError):
            value = np.zeros(0)
        if value.shape != (2,) or not np.isfinite(value).all():
            raise ActionError(f"The action is {action!r}: give two finite numbers, {ACTIONS['control']}.")
        acceleration, steering = np.clip(value, LIMITS[0], LIMITS[1])
        return float(acceleration), float(steering)

    def _chosen(self, options: dict | None) -> int | None:
        for key in options or ():
            if key != "episode":
                warnings.warn(f"reset() has no option `{key}`.{suggest(str(key), ('episode',))}", stacklevel=3)
        number = (options or {}).get("episode")
        return None if number is None else whole_number("episode", number, 0, len(self.episodes) - 1)

    def __getstate__(self) -> dict[str, Any]:
        # The vehicle classes of the styles are made at run time and cannot travel: reset the copy.
        return {**vars(self), "run": None, "plans": None, "forecast": None}

    def __repr__(self) -> str:
        return f"DriveEnv({spec_of(self.domain)}, others={self.others}, action={self.action})"
