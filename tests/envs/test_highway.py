"""The domain `highway`: splits, features, driving side, counts and bad input."""

from __future__ import annotations

import math
import pickle

import gymnasium
import numpy as np
import pettingzoo
import pytest

import motion_gym
from motion_gym.contract import ParameterError, SpecError
from motion_gym.data.overlap import trained_on_scored
from motion_gym.envs.highway import RUNS, SCENARIOS, Highway
from motion_gym.envs.highway_engine import package
from motion_gym.envs.highway_engine.styles import SOURCE_STYLES, STYLES
from tests.traffic import SMALL, needs_highway_env


def make(**parameters):
    needs_highway_env()
    return motion_gym.domain("highway", **{**SMALL, **parameters})


@pytest.fixture
def fresh_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTION_GYM_CACHE", str(tmp_path / "cache"))


def steps_of(recording):
    """[R - agents] rows of the displacements from frame to frame, metres; and whether frames follow each other."""
    order = np.lexsort((recording.frame, recording.agent))
    frame, agent, xy = recording.frame[order], recording.agent[order], recording.xy[order]
    same = agent[1:] == agent[:-1]
    return np.diff(xy, axis=0)[same], np.diff(frame)[same]


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_vehicles_drive_forwards_and_never_return(scenario):
    moved, frames = steps_of(make(scenario=scenario).recordings("test")[0])
    speed = np.linalg.norm(moved, axis=1) / 0.4
    assert len(speed) > 100 and speed.max() < 45
    assert (frames == 1).all(), "an id that has left does not return"
    if scenario in ("straight", "merge"):
        assert moved[:, 0].min() > -1e-3, "nobody drives backwards"


def test_traffic_drives_on_its_side_with_y_up():
    right, left = (make(scenario="merge", side=side).recordings("test")[0] for side in ("right", "left"))
    assert np.array_equal(right.xy * (1, -1), left.xy)
    at_start = right.xy[:, 0] < -250
    ramp = right.xy[at_start, 1].min()
    assert ramp < -10, "the ramp is to the right of vehicles that drive along x, so at negative y"
    assert np.array_equal(right.origin, [0, 0]) and np.array_equal(right.frame, left.frame)


def test_splits_seeds_and_styles_differ():
    first = make(seconds=8.0).recordings("test")[0].xy
    others = [(make(seconds=8.0, **change), split) for change, split in ((dict(seed=1), "test"), ({}, "val"))]
    others.append((make(seconds=8.0, headway=1.0), "test"))
    assert all(not np.array_equal(first[:50], domain.recordings(split)[0].xy[:50]) for domain, split in others)
    assert np.array_equal(first, make(seconds=8.0, alpha=3).recordings("test")[0].xy)


def test_nothing_is_simulated_to_compare_the_people_of_splits(monkeypatch):
    def fail(*_):
        raise AssertionError("simulated")

    monkeypatch.setattr(Highway, "recordings", fail)
    for source in Highway("aggressive", "merge", side="left").sources():
        assert not trained_on_scored(source, Highway("aggressive", "merge", side="left"), "test")


def test_sources_are_three_styles_on_the_straight_road():
    domain = Highway("aggressive", "roundabout", side="left", headway=0.7)
    assert [(s.style, s.scenario, s.side, s.headway) for s in domain.sources()] == [
        (style, "straight", "right", None) for style in SOURCE_STYLES
    ]
    assert [s.alpha for s in Highway(alpha=64).sources()] == [1, 2, 4]
    assert [s.sigma for s in Highway(sigma="past").sources(styles=["calm"], alphas=[8])] == ["past"]


def test_the_card_counts_vehicles_that_crashed(fresh_cache):
    domain = make(style="aggressive", seconds=8.0, seed=3)
    agents = np.unique(domain.recordings("test")[0].agent)
    recorded, crashed = domain.simulated("test")["vehicles"][0]
    assert crashed > 0 and len(agents) == recorded - crashed
    domain.windows("test")
    assert domain.card.counts["test"]["crashed_agents"] == crashed
    assert domain.card.counts["test"]["recorded_agents"] == len(agents)
    assert f"{crashed} in test" in domain.card.source


def test_heading_and_speed_come_from_the_observed_steps():
    domain = make(motion=True)
    assert domain.feature_names == ("heading", "speed") and not domain.side_channel_names
    turn = np.linspace(0, math.pi / 2, 8)
    circle = 20 * np.stack([np.sin(turn), 1 - np.cos(turn)], axis=-1)  # to the left, from heading 0
    stopped = np.repeat(circle[:1], 8, axis=0) + np.array([[0, k > 0] for k in range(8)])
    features = domain.features(np.stack([circle, stopped]))
    chord = 2 * 20 * math.sin(turn[1] / 2) / 0.4
    assert features[0, 1:, 1] == pytest.approx(chord) and features[0, 0, 1] == pytest.approx(chord)
    assert features[0, 1:, 0] == pytest.approx((turn[1:] + turn[:-1]) / 2)
    assert features[1, 2:, 1] == pytest.approx(0) and features[1, :, 0] == pytest.approx(math.pi / 2)
    assert domain.windows("test").observation.history.shape[2] == 4


def test_sigma_grows_with_braking():
    length = np.array([10.0] * 11 + [9.0, 8.0, 7.0, 6.0] + [6.0] * 5)
    x = np.concatenate([[0.0], np.cumsum(length[1:])])
    track = np.stack([x, np.zeros(20)], axis=-1)[None]
    known = np.ones((1, 20), bool)
    future = make(alpha=2.0).side_channels(track, known)[0, :, 0]
    assert future == pytest.approx(2 * (1 + 10 - length[8:16])), "the change of speed over the next 8 steps"
    past = make(alpha=2.0, sigma="past").features(track[:, 7:15])[0, :, 0]
    assert past == pytest.approx([2, 2, 2, 2, 4, 4, 4, 4])
    assert make(alpha=2.0).card.side_channels == ("sigma",) and not make(sigma="past").card.side_channels


def test_a_domain_travels_and_names_itself():
    domain = Highway("brisk", headway=1.0)
    assert pickle.loads(pickle.dumps(domain)).parameters == domain.parameters
    assert (domain.driving.headway, domain.driving.speed) == (1.0, STYLES["brisk"].speed)


def test_environments_take_a_style_and_a_scenario():
    needs_highway_env()
    arguments = {**SMALL, "style": "assertive"}
    env = gymnasium.make("motion_gym/Highway-v0", render_mode="rgb_array", **arguments)
    assert (env.unwrapped.domain.style, env.unwrapped.domain.scenario) == ("assertive", SMALL["scenario"])
    env.reset(seed=0)
    assert env.render().shape == (540, 720, 3)
    vector = gymnasium.make_vec("motion_gym/Highway-v0", num_envs=3, **arguments)
    assert vector.reset(seed=0)[0]["history"].shape[0] == 3
    for clock in ("windows", "stream"):
        crowd = pettingzoo.make("parallel", "motion_gym/Highway-v0", clock=clock, **arguments)
        observed, _ = crowd.reset(seed=0)
        assert len(observed) > 2 and next(iter(observed.values())).shape == (8, 2)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_vehicles_drive_between_the_lines_of_the_lanes(scenario):
    domain = make(scenario=scenario, side="left")
    points = np.concatenate([line for line, _ in domain.ground_lines()])
    xy = domain.recordings("test")[0].xy
    nearest = np.linalg.norm(xy[:, None] - points, axis=-1).min(axis=1)
    assert len(points) > 500 and nearest.max() < 10
    assert {dashed for _, dashed in domain.ground_lines()} >= {False}
    assert (points.max(axis=0) + 3 > xy.max(axis=0)).all() and (points.min(axis=0) - 3 < xy.min(axis=0)).all()


def test_every_scenario_has_runs_for_every_split():
    assert all(set(runs) == set(Highway.splits) for runs in RUNS.values())


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"style": "agressive"}, "Did you mean `aggressive`"),
        ({"scenario": "highway"}, "`scenario=highway` of domain `highway` is not known.*straight"),
        ({"side": "up"}, "`side=up`.*left, right"),
        ({"headway": 0.1}, "`headway=0.1` of domain `highway` must be a number, 0.5 or more, and at most 4"),
        ({"politeness": 1.5}, "at most 1"),
        ({"speed": float("nan")}, "`speed=nan`"),
        ({"braking": "hard"}, "`braking=hard`"),
        ({"alpha": 0}, "above 0"),
        ({"alpha": 1, "sigma": "none"}, "drop alpha"),
        ({"sigma": "paper"}, "Known: future, none, past"),
        ({"motion": True, "alpha": 1}, "exclude each other"),
        ({"motion": 1}, "must be true or false"),
        ({"seconds": 5}, "8 or more"),
        ({"runs": 0}, "whole number"),
        ({"seed": -1}, "whole number"),
    ],
)
def test_bad_input(parameters, message):
    with pytest.raises(SpecError, match=message):
        motion_gym.domain("highway", **parameters)


def test_an_unknown_parameter_or_split_is_named():
    with pytest.raises(ParameterError, match="Did you mean `headway`"):
        motion_gym.domain("highway:headaway=1")
    with pytest.raises(SpecError, match="no split `tset`"):
        Highway().recordings("tset")


@pytest.mark.parametrize(("version", "message"), [(None, "is not installed"), ("1.11.2", "1.11.2 is installed")])
def test_a_missing_or_other_highway_env(version, message, fresh_cache, monkeypatch):
    monkeypatch.setattr(package, "installed", lambda: version)
    domain = motion_gym.domain("highway", **SMALL)
    with pytest.raises(SpecError, match=rf'{message}.*pip install "motion-gym\[highway\]"'):
        domain.windows("test")
