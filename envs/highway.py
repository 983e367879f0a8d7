"""Traffic on highway-env's roads: simulated vehicles whose style is how they follow, brake and change lane."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, WINDOW, Card, Recording, SpecError
from motion_gym.data.domains import RecordedDomain, shared
from motion_gym.data.storage import cached_arrays
from motion_gym.driving.episodes import World
from motion_gym.driving.paths import Path
from motion_gym.envs.highway_engine.package import ENGINE_VERSION, VERSION, check_package
from motion_gym.envs.highway_engine.styles import SOURCE_STYLES, STYLES
from motion_gym.specs import number, one_of, whole_number

RUNS = {
    "straight": {"train": 15, "val": 3, "test": 4, "reference": 2},
    "merge": {"train": 21, "val": 3, "test": 4, "reference": 2},
    "roundabout": {"train": 26, "val": 4, "test": 6, "reference": 2},
    "intersection": {"train": 27, "val": 4, "test": 6, "reference": 2},
}
"""Number of runs in each split: at least 10,000 agent-windows of every named style for train, and 2,000 for test."""
SCENARIOS = tuple(RUNS)
SOURCE_SCENARIO = "straight"
SOURCE_ALPHAS = (1.0, 2.0, 4.0)
STANDING = 0.5
"""Below this speed, in m/s, a vehicle keeps its last heading."""
STYLE_PARAMETERS = ("headway", "distance", "politeness", "acceleration", "braking", "speed")


class Highway(RecordedDomain):
    """Vehicles that follow each other by IDM and change lane by MOBIL; simulated on first use.

    ## Description
    The roads and vehicles of highway-env 1.12, stepped every 0.1 s without one of its environments. Vehicles enter at
    random times, drive and leave. All vehicles of a domain have one *style*; target speeds vary by 12 % around that of
    the style, and 15 % of the vehicles are slow. Scenarios: ``straight`` (three lanes, 600 m), ``merge`` (two lanes and
    a ramp), ``roundabout`` (one lane, four arms; vehicles on the circle pass first; target speeds are 35 % of those on
    a straight road) and ``intersection`` (four arms; traffic from east and west passes first, left turns give way;
    27 %). Vehicles that crash are removed at once, and their whole tracks are left out: the card counts them. The style
    ``brisk`` lies between ``normal`` and ``assertive``, and ``aggressive`` beyond ``assertive``.

    ## Observation
    x and y in metres, y up, the zero point in the middle of the roads. With ``motion``, heading (radians, from the
    x axis, anticlockwise) and speed (m/s) from the observed steps. With ``alpha``, the *observation-noise* feature
    sigma; alpha scales how strongly sigma correlates with braking. ``sigma="future"`` reads the braking over the next
    8 steps: it is an *oracle side channel* and labelled as such in all results. ``sigma="past"`` reads the braking
    since the previous step.

    ## Splits
    Runs of 120 s, each with its own random stream: by scenario 15 to 27 for ``train``, 3 or 4 for ``val``, 4 or 6 for
    ``test`` and 2 for ``reference``. A window starts every 4 steps.

    ## Arguments
    Args:
        style: ``"calm"``, ``"normal"``, ``"assertive"``, ``"brisk"`` or ``"aggressive"``.
        scenario: ``"straight"``, ``"merge"``, ``"roundabout"`` or ``"intersection"``.
        side: Side of the road on which vehicles drive, ``"right"`` or ``"left"``; ``"left"`` mirrors y.
        headway: Desired time headway, 0.5 to 4 s; None for that of the style, as for the next five.
        distance: Desired distance to the vehicle in front at a standstill, 1 to 10 m.
        politeness: Weight of the accelerations of others in changes of lane, 0 to 1.
        acceleration: Comfortable acceleration, 0.5 to 4 m/s^2.
        braking: Comfortable deceleration, 0.5 to 5 m/s^2.
        speed: Mean target speed on a straight road, 15 to 35 m/s.
        alpha: Scale of sigma, > 0; None for no sigma.
        sigma: ``"none"``, ``"future"`` or ``"past"``; by default ``"future"`` if alpha is set, else ``"none"``.
        motion: Whether heading and speed are features.
        stride: Steps between the starts of two windows.
        seed: Seed of all random values, 0 or more.
        runs: Number of runs in each split; None for the numbers above.
        seconds: Recorded time of a run, 8 s or more.

    ## Credits
    Leurent, "An environment for autonomous driving decision-making", 2018 (highway-env). Treiber, Hennecke, Helbing,
    "Congested traffic states in empirical observations and microscopic simulations", Physical Review E 2000 (IDM).
    Kesting, Treiber, Helbing, "General lane-changing model MOBIL for car-following models", TRR 2007.
    """

    name = "highway"
    terms = "free"
    oracle = "idm_oracle"
    headline = ("style", "scenario")
    same_world = (
        *("style", "scenario", "side", *STYLE_PARAMETERS),
        *("alpha", "sigma", "motion", "stride", "runs", "seconds"),
    )
    """With the same seed, a split has the same random streams in all domains."""
    draws_each_split = True
    dt = 0.4
    engine = f"{ENGINE_VERSION}, highway-env {VERSION}"

    def __init__(
        self,
        style: str = "normal",
        scenario: str = "straight",
        side: str = "right",
        headway: float | None = None,
        distance: float | None = None,
        politeness: float | None = None,
        acceleration: float | None = None,
        braking: float | None = None,
        speed: float | None = None,
        alpha: float | None = None,
        sigma: str | None = None,
        motion: bool = False,
        stride: int = 4,
        seed: int = 0,
        runs: int | None = None,
        seconds: float = 120.0,
    ):
        owner = "domain `highway`"
        self.style = one_of("style", style, STYLES, owner)
        self.scenario = one_of("scenario", scenario, SCENARIOS, owner)
        self.side = one_of("side", side, ("right", "left"), owner)
        self.headway, self.distance, self.politeness = headway, distance, politeness
        self.acceleration, self.braking, self.speed = acceleration, braking, speed
        self.driving = STYLES[style].replace({name: getattr(self, name) for name in STYLE_PARAMETERS}, owner)
        """The style with all its parameters."""
        self.sigma = one_of(
            "sigma",
            sigma if sigma is not None else "none" if alpha is None else "future",
            ("none", "future", "past"),
            owner,
        )
        if alpha is not None and self.sigma == "none":
            raise SpecError(
                f"`alpha={alpha}` has no effect with `sigma=none`: drop alpha, or use sigma=future or past."
            )
        self.alpha = None if alpha is None else number("alpha", alpha, 0, 1e6, above=True, owner=owner)
        if self.alpha is None and self.sigma != "none":
            self.alpha = 1.0
        if not isinstance(motion, bool):
            raise SpecError(f"`motion={motion}` of {owner} must be true or false.")
        if motion and self.sigma != "none":
            raise SpecError(
                f"`motion=true` and `sigma={self.sigma}` of {owner} exclude each other, because predictors read sigma "
                "as the third feature: drop one of them."
            )
        self.motion = motion
        self.stride = whole_number("stride", stride, 1, 1_000_000)
        self.seed = whole_number("seed", seed, 0, 2**63)
        self.runs = None if runs is None else whole_number("runs", runs, 1, 100_000)
        self.seconds = number("seconds", seconds, WINDOW * self.dt, 1e5, owner=owner)
        self.feature_names = ("heading", "speed") if motion else ("sigma",) if self.sigma == "past" else ()
        self.side_channel_names = ("sigma",) if self.sigma == "future" else ()

    def recordings(self, split: str) -> list[Recording]:
        """One recording: the runs of the split one after another, with a new id for each vehicle."""
        tracks = self.simulated(split)
        xy = tracks["xy"].astype(np.float64) * (1, 1 if self.side == "right" else -1)
        return [Recording(tracks["frame"].copy(), tracks["agent"].copy(), xy, self.dt, f"highway {split}", np.zeros(2))]

    def simulated(self, split: str) -> dict[str, np.ndarray]:
        """The result of ``simulate_runs`` for a split, from the cache if possible.

        Raises:
            SpecError: highway-env is not installed, or another version is.
        """
        self.check_split(split)
        runs = self.runs or RUNS[self.scenario][split]
        key = {
            "name": "highway",
            "scenario": self.scenario,
            **self.driving.parameters,
            "seconds": self.seconds,
            "seed": self.seed,
            "runs": runs,
            "split": split,
            "engine": self.engine,
        }
        make = functools.partial(self._simulate, split, runs)
        return self.kept(f"simulation of {split}", lambda: cached_arrays(key, make))

    def _simulate(self, split: str, runs: int) -> dict[str, np.ndarray]:
        check_package()
        from motion_gym.envs.highway_engine.runs import simulate_runs

        seeds = [(self.seed, self.splits.index(split), run) for run in range(runs)]
        label = f"highway, style {self.style}, scenario {self.scenario}, {split}"
        return simulate_runs(self.scenario, self.driving, self.seconds, seeds, label)

    @property
    def card(self) -> Card:
        """Description of the domain; counts have the vehicles that crashed and are left out, ``crashed_agents``."""
        card = super().card
        counts = {
            split: {**counted, "crashed_agents": int(self.simulated(split)["vehicles"][:, 1].sum())}
            for split, counted in card.counts.items()
        }
        crashed = ", ".join(f"{counted['crashed_agents']} in {split}" for split, counted in counts.items())
        left_out = f"; crashed vehicles left out: {crashed}" if counts else ""
        return dataclasses.replace(card, counts=counts, source=f"simulated with highway-env {VERSION}{left_out}")

    def continued(self, history: np.ndarray) -> np.ndarray:
        """Simulate the vehicles of a scene on: history [A, 8, 2] float64 -> [A, 12, 2], metres.

        The style and the scenario are those of the domain; everything else is estimated from the history.

        Raises:
            SpecError: highway-env is not installed, or another version is.
        """
        check_package()
        from motion_gym.envs.highway_engine.continuation import continued

        mirror = (1, 1 if self.side == "right" else -1)
        return continued(self.scenario, self.driving, history * mirror, FUTURE) * mirror

    def ego_path(self, track: np.ndarray) -> Path | None:
        """The path of the ego vehicle that takes the place of a recorded one, track [T, 2]; None if it cannot.

        Raises:
            SpecError: highway-env is not installed, or another version is.
        """
        check_package()
        from motion_gym.envs.highway_engine.ego_paths import ego_path

        mirror = (1, 1 if self.side == "right" else -1)
        path = ego_path(self.scenario, self.driving.speed, track * mirror)
        return path if path is None or self.side == "right" else path.mirrored()

    def reacting_world(self, history: np.ndarray, ego: np.ndarray, path: np.ndarray) -> World:
        """Vehicles that are simulated on from their histories [N, 8, 2], and that react to an ego vehicle.

        Args:
            history: [N, 8, 2] float64, metres.
            ego: [4] state of the ego vehicle: x, y, heading, speed.
            path: [P, 2] its path.
        """
        from motion_gym.envs.highway_engine.reacting import ReactingWorld

        return ReactingWorld(self.scenario, self.driving, history, ego, path, self.side)

    def ground_lines(self) -> list[tuple[np.ndarray, bool]]:
        """The lines of the lanes; none if highway-env is not installed, as for tracks from the cache."""
        try:
            check_package()
        except SpecError:
            return []
        from motion_gym.envs.highway_engine.lines import lane_lines

        return [(line * (1, 1 if self.side == "right" else -1), dashed) for line, dashed in lane_lines(self.scenario)]

    def sources(  # type: ignore[override]
        self,
        styles: Sequence[str] = SOURCE_STYLES,
        scenario: str = SOURCE_SCENARIO,
        alphas: Sequence[float] = SOURCE_ALPHAS,
    ) -> list[Highway]:
        """The domains to train on: three styles on the straight road, driving on the right.

        Args:
            styles: Named styles.
            scenario: Scenario of all of them.
            alphas: With sigma, alpha of each style in order.
        """
        common = {"scenario": scenario, "side": "right", **dict.fromkeys(STYLE_PARAMETERS)}
        noise: Sequence[float | None] = alphas if self.sigma != "none" else [None] * len(styles)
        others = [self.replace(style=s, alpha=a, **common) for s, a in zip(styles, noise, strict=False)]
        return [shared(type(self), **other.parameters) for other in others]  # type: ignore[arg-type]

    def features(self, history: np.ndarray) -> np.ndarray:
        """Heading and speed from the observed steps, or sigma from the braking since the previous step."""
        moved = np.diff(history, axis=1, prepend=2 * history[:, :1] - history[:, 1:2])
        length = np.linalg.norm(moved, axis=-1)
        if self.sigma == "past":
            return self._noise(np.diff(length, axis=1, prepend=length[:, :1]))
        heading = np.arctan2(moved[..., 1], moved[..., 0])
        moves = length / self.dt >= STANDING
        latest = np.maximum.accumulate(np.where(moves, np.arange(HISTORY), 0), axis=1)
        return np.stack([np.take_along_axis(heading, latest, axis=1), length / self.dt], axis=-1)

    def side_channels(self, positions: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Sigma from the braking over the next 8 steps: [A, 8, 1].

        If a vehicle leaves earlier, its last known speed is used (on the stream clock only).
        """
        moved = np.diff(positions, axis=1, prepend=2 * positions[:, :1] - positions[:, 1:2])
        length = np.linalg.norm(moved, axis=-1)
        step = np.minimum(np.arange(known.shape[1]), known.sum(axis=1)[:, None] - 1)
        length = np.take_along_axis(length, step, axis=1)
        return self._noise(length[:, HISTORY : 2 * HISTORY] - length[:, :HISTORY])

    def _noise(self, change: np.ndarray) -> np.ndarray:
        """Sigma, alpha (b + 1), where b is the braking: by how many metres per step the speed falls."""
        return (self.alpha or 0.0) * (np.maximum(-change, 0.0)[..., None] + 1)
