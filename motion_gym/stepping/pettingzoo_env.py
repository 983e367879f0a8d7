"""The PettingZoo environment: a dict of observations out, a dict of forecasts in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from pettingzoo import ParallelEnv

from motion_gym import catalog
from motion_gym.contract import FUTURE, HISTORY, MOST_SAMPLES, ActionError, Domain, Forecast, PredictorError, SpecError
from motion_gym.data.domains import observed_images
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.windows import positions_only
from motion_gym.specs import one_of
from motion_gym.stepping.clocks import Settled, Step, WindowsClock
from motion_gym.stepping.dicts import infos_of
from motion_gym.stepping.harness import windows_of_domain
from motion_gym.stepping.order import check_order, first_scene, order_of
from motion_gym.stepping.outstanding import Outstanding
from motion_gym.stepping.render import Canvas
from motion_gym.stepping.spaces import Actions, checked_action, history_space
from motion_gym.stepping.stream_clock import StreamClock

CLOCKS = ("windows", "stream")


class ForecastEnv(ParallelEnv):
    """Agents observe, forecast, and are scored when the ground truth is revealed.

    ## Observation space
    ``Box(8, F)``, float32: x and y in metres, oldest first, and the domain's further features.

    ## Action space
    ``Box(K, 12, 2)``, float32: K sampled forecasts. With K = 1, ``(12, 2)`` is accepted too; float64 is cast.
    ``action="position"``: the agent's next 12 positions, in metres, in the frame of the observation; the bounds
    (``BOUND``) are wider than any recording and are not enforced. ``action="displacement"``: consecutive displacements
    from the last observed position, -1 to 1 times ``displacement_limit``; values beyond are clipped.

    ## Clocks
    ``windows``: each step is the next window of the split. Agents live for one step: they enter, their forecast is
    scored, and they terminate. The reward is minus the ADE of the most likely (first) sample.
    ``stream``: each step is one frame of the recording. An agent enters with its 8th frame and terminates when it
    leaves; its id never returns. The reward that comes with the observation of a frame is minus the mean error of the
    points that became known with that frame, over the agent's outstanding forecasts. It cannot depend on the forecast
    that answers this observation.

    ## Infos
    The ground truth of a scene (all agents observed at one time) is revealed once, after its last forecast step or when
    its last agent has left. Infos then have ``agent`` [M], the numbers of the agents, ``row`` [M], their
    places in their scenes, ``history`` [M, 8, F], ``future`` [M, 12, 2], ``known`` [M, 12] (future is zero where not
    known), ``forecast`` [M, K, 12, 2] and ``made`` [M], the time of each forecast. Every agent reports its own
    forecasts; those of an agent that left earlier are reported by another agent of the scene. ``truth_from_infos`` puts
    the scenes together. ``env.ledger`` keeps all settled forecasts.

    ## Episode end
    After the last window or frame; ``agents`` is then empty. Nothing is ever truncated.

    Args:
        domain: A name, a spec, ``"module:Class"`` or a domain.
        clock: ``"windows"`` or ``"stream"``.
        split: Which split to play.
        samples: K.
        render_mode: ``"rgb_array"``, ``"human"`` or None.
        action: ``"position"`` or ``"displacement"``, see ``Actions``: displacements are scaled to ``Box(-1, 1)``.
        displacement_limit: Largest displacement along x and along y in one step; 1 m by default.
        observation_bound: Bound of every value of a history, for clients that need a finite space; None for none.
        order: ``"published"`` or ``"shuffled"``, see ``ORDERS``; a stream is always played in the order of time.
        **parameters: Parameters of the domain.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "motion_gym",
        "render_modes": ["rgb_array", "human"],
        "render_fps": 5,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        domain: str | Domain,
        clock: str = "windows",
        split: str = "test",
        samples: int = 1,
        render_mode: str | None = None,
        action: str = "position",
        displacement_limit: float | None = None,
        observation_bound: float | None = None,
        order: str = "published",
        **parameters: Any,
    ):
        self.domain = catalog.domain(domain, **parameters)
        one_of("clock", clock, CLOCKS)
        self._ordered = check_order(order)
        if clock == "stream" and order == "shuffled":
            raise SpecError("order='shuffled' is for the windows clock: a stream is played in the order of time.")
        self._generator = np.random.default_rng()
        samples = catalog.whole_number("samples", samples, 1, MOST_SAMPLES)
        self.clock: WindowsClock | StreamClock
        if clock == "windows":
            self.clock = WindowsClock(windows_of_domain(self.domain, split))
        else:
            recordings = self.domain.recordings(split)
            images = observed_images(self.domain, recordings)
            self.clock = StreamClock(recordings, getattr(self.domain, "history", positions_only), images=images)
        if not self.clock.size:
            raise SpecError(f"Split `{split}` of `{self.domain!r}` has no agent to observe: there is nothing to play.")
        self.samples = samples
        self.render_mode = render_mode
        self.possible_agents = [self.clock.name(i) for i in range(self.clock.size)]
        self.agents: list[str] = []
        self._step = self.clock.reset()
        features = self._step.observation.history.shape[2]
        card, reach = self.domain.card, 0.0 if observation_bound is None else self.clock.reach
        self._observation_space = history_space((HISTORY, features), observation_bound, reach, card.name)
        self._actions = Actions(action, displacement_limit, card.unit)
        self._action_space = self._actions.space(samples)
        title, fps = f"{card.name}, {clock} clock", self.metadata["render_fps"]
        self._canvas = Canvas(render_mode, self.domain, split, title, self.clock.extent, fps)

    @property
    def images(self) -> tuple[SceneImage, ...] | None:
        """Image of the ground of the agents observed now, for ``observation_from_dict``; None for most domains."""
        return self._step.observation.images

    @property
    def ledger(self) -> Outstanding:
        """The forecasts of this episode."""
        return self.clock.ledger

    def observation_space(self, agent: str) -> gymnasium.spaces.Space:
        """Box(8, F), the same for all agents."""
        return self._observation_space

    def action_space(self, agent: str) -> gymnasium.spaces.Space:
        """Box(K, 12, 2), the same for all agents."""
        return self._action_space

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Go to the beginning.

        Args:
            seed: Determines the order of this and later episodes with ``order="shuffled"``.
            options: ``{"scene": n}`` begins with window n, or with the n-th frame with an observed agent, and goes on
                from there in the order of the episode.
        """
        scene = first_scene(options, self.clock.scenes)
        if seed is not None:
            self._generator = np.random.default_rng(seed)
        if isinstance(self.clock, StreamClock):
            self._enter(self.clock.reset(scene or 0))
        else:
            self._enter(self.clock.reset(order_of(self.clock.scenes, self._ordered, self._generator, scene)))
        self._show(None)
        return self._observations(), {name: {} for name in self.agents}

    def step(self, actions: Mapping[str, np.ndarray]) -> tuple[dict, dict, dict, dict, dict]:
        """Store one forecast per agent, step the clock, and reveal the ground truth that is due.

        Raises:
            ActionError: An action is missing, superfluous, or no finite array of the right shape. The environment does
                not move then.
        """
        forecast = self._forecast(actions)
        before, last = self.agents, self._step
        try:
            step = self.clock.step(forecast)
        except PredictorError:
            finite = np.isfinite(forecast.positions).all(axis=(1, 2, 3))
            bad = before[int(np.argmin(finite))]
            raise ActionError(
                f"Action of `{bad}` has NaN or infinite positions: every position must be finite."
            ) from None
        self._enter(step)
        stay = set(self.agents)
        left = [i for i, name in enumerate(before) if name not in stay]
        observations = self._observations()
        observations.update((before[i], last.observation.history[i].copy()) for i in left)
        names = list(observations)
        reward = dict.fromkeys(names, 0.0)
        reward.update(zip(before, step.reward.tolist(), strict=True))
        terminated = dict.fromkeys(names, False)
        terminated.update((before[i], True) for i in left)
        infos: dict[str, dict[str, Any]] = {name: {} for name in names}
        if step.settled is not None:
            here = dict(zip([*last.identity.tolist(), *step.identity.tolist()], [*before, *self.agents], strict=True))
            infos.update(infos_of(step.settled, here))
        self._show(step.settled)
        return observations, reward, terminated, dict.fromkeys(names, False), infos

    def render(self) -> np.ndarray | None:
        """The last step as an image [H, W, 3] uint8 (``rgb_array``); None in ``human`` mode, which draws by itself.

        Raises:
            SpecError: The environment was made without a render_mode.
        """
        return self._canvas.image()

    def close(self) -> None:
        """Close the window, if one was opened."""
        self._canvas.close()

    def _enter(self, step: Step) -> None:
        self._step = step
        self.agents = [self.possible_agents[i] for i in step.identity]

    def _observations(self) -> dict[str, np.ndarray]:
        return dict(zip(self.agents, self._step.observation.history.copy(), strict=True))

    def _forecast(self, actions: Mapping[str, np.ndarray]) -> Forecast:
        if not self.agents:
            raise ActionError("The episode is over or has not begun: call reset().")
        if not isinstance(actions, Mapping):
            raise ActionError(f"Actions are a dict from the names in `env.agents`, not {type(actions).__name__}.")
        here = set(self.agents)
        extra = [name for name in actions if name not in here]
        if extra:
            why = "is not here now" if extra[0] in self.possible_agents else "is not an agent of this environment"
            raise ActionError(f"Action for `{extra[0]}`, which {why}. Give actions for `env.agents` only.")
        missing = [name for name in self.agents if name not in actions]
        if missing:
            raise ActionError(
                f"No action for {len(missing)} of {len(here)} agents, {missing[0]} first: every agent of `env.agents` "
                "needs a forecast."
            )
        shape = (self.samples, FUTURE, 2)
        stacked = np.stack(
            [checked_action(actions[n], shape, f"Action of `{n}`", one_sample=True) for n in self.agents]
        )
        return Forecast(self._actions.positions(stacked, self._step.observation.xy[:, -1]))

    def _show(self, settled: Settled | None) -> None:
        if not self.render_mode:
            return
        observation, time, paths = self._step.observation, self.clock.time, None
        if isinstance(self.clock, StreamClock):
            paths = self.clock.latest_paths()
        elif settled is not None:
            observation, time = settled.truth.observation, int(settled.made[0])
        truth, forecast = (None, None) if settled is None else (settled.truth, settled.forecast)
        self._canvas.update(time, observation, truth, forecast, paths)


def parallel_env(domain: str | Domain, clock: str = "windows", **arguments: Any) -> ForecastEnv:
    """Make the PettingZoo environment of a domain; see ``ForecastEnv`` for the arguments."""
    return ForecastEnv(domain, clock=clock, **arguments)
