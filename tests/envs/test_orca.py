from __future__ import annotations

import hashlib
import math
import os
import pickle
import subprocess
import sys
import textwrap
import time
import warnings
from typing import Any

import numpy as np
import pytest
from scipy.stats import ks_2samp

import motion_gym
from motion_gym.contract import SpecError
from motion_gym.data.storage import data_folder
from motion_gym.envs.orca import Orca
from motion_gym.scoring.evaluation import evaluate
from tests.windows import windows_of

make: Any = motion_gym.domain

STYLES = (0.1, 0.3, 0.6)


@pytest.fixture
def fresh_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTION_GYM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def positions(split="test", **parameters):
    """[S, N, 20, 2] positions of a split, as float64."""
    truth = make("orca", **parameters).windows(split)
    xy = np.concatenate([truth.observation.xy, truth.future], axis=1).astype(float)
    return xy.reshape(truth.observation.scenes, -1, 20, 2)


def digest(array):
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


@pytest.mark.parametrize(("d", "ade"), [(0.1, 0.042), (0.3, 0.191), (0.6, 0.429)])
def test_constant_velocity_has_the_error_of_the_released_scenes(d, ade):
    assert evaluate("constant_velocity", "orca", d=d).metrics["ADE"].mean == pytest.approx(ade, rel=0.03)


@pytest.mark.parametrize(("d", "kept"), [(0.1, 4814), (0.6, 4978)])
def test_as_many_scenes_are_kept_as_in_the_released_test_split(d, kept):
    share = kept / 5000
    assert len(positions(d=d)) == pytest.approx(kept, abs=4 * math.sqrt(2 * 5000 * share * (1 - share)))


@pytest.mark.parametrize("d", STYLES)
def test_scenes_are_distributed_as_the_released_ones(d):
    path = data_folder() / "orca_v4" / f"orca_circle_crossing_2_ped_3000_scenes_{d}_radius_2.0_horizon.npz"
    if not path.exists():
        pytest.skip("the released scenes (orca_v4) are not here")
    released, ours = np.load(path)["raw"].astype(float), positions(d=d)

    def statistics(scenes):
        first = scenes[:, :, 0]
        angle = np.arctan2(first[..., 1], first[..., 0])
        return {
            "angle": angle[:, 0],
            "angle between": (angle[:, 1] - angle[:, 0]) % (2 * np.pi),
            "first radius": np.linalg.norm(first, axis=-1).ravel(),
            "last radius": np.linalg.norm(scenes[:, :, -1], axis=-1).ravel(),
            "smallest distance": np.linalg.norm(scenes[:, 0] - scenes[:, 1], axis=-1).min(axis=1),
        }

    expected = statistics(released)
    for name, values in statistics(ours).items():
        assert ks_2samp(values, expected[name]).pvalue > 0.01, name


def test_scenes_that_end_too_near_a_goal_are_dropped():
    xy = positions(d=0.1)
    first, last = xy[:, :, 0], xy[:, :, -1]
    goal = -first * (1 + 0.38 / np.linalg.norm(first, axis=-1, keepdims=True))
    left = np.linalg.norm(last - goal, axis=-1)
    assert 0.979 < left.min() < 1.01


def test_every_style_has_the_same_starts():
    # The first frame, at 0.38 s, is before any avoidance: it is the same for every d, except for dropped scenes.
    first = {d: {row.tobytes() for row in positions(d=d)[:, :, 0]} for d in STYLES}
    assert len(set.union(*first.values())) <= 5000
    assert len(set.intersection(*first.values())) > 4700


def test_the_kept_distance_is_twice_the_radius():
    for d in STYLES:
        apart = np.linalg.norm(np.subtract(*positions(d=d).transpose(1, 0, 2, 3)), axis=-1).min(axis=1)
        assert apart.min() > 2 * d - 0.01
        assert np.quantile(apart, 0.05) < 2 * d + 0.02


def test_scenes_of_the_splits_are_disjoint():
    domain = make("orca", scenes=100)
    rows = {split: {row.tobytes() for row in domain.windows(split).observation.history} for split in domain.splits}
    assert set(rows) == {"train", "val", "test", "reference"} and all(len(digests) > 150 for digests in rows.values())
    assert len(set.union(*rows.values())) == sum(map(len, rows.values()))
    assert digest(domain.reference().future) == digest(domain.windows("reference").future)


def test_number_of_scenes():
    assert 4700 < make("orca").windows("test").observation.scenes <= 5000
    assert 280 < make("orca").reference().observation.scenes <= 300
    few = make("orca", scenes=40)
    assert all(30 < few.windows(split).observation.scenes <= 40 for split in few.splits)


def test_seeds_give_different_scenes():
    one, other, again = (positions(seed=seed, scenes=50) for seed in (0, 1, 0))
    assert np.array_equal(one, again)
    assert not set(map(bytes, one[:, :, 0])) & set(map(bytes, other[:, :, 0]))


@pytest.mark.parametrize(("agents", "d"), [(2, 0.6), (5, 0.6), (10, 0.6), (20, 0.3), (20, 0.65)])
def test_agents_do_not_overlap_at_the_start(agents, d):
    domain = make("orca", agents=agents, d=d, scenes=60)
    start = domain._starts(np.random.default_rng(0), 60)
    one, other = np.triu_indices(agents, 1)
    assert start.shape == (60, agents, 2)
    assert np.linalg.norm(start[:, one] - start[:, other], axis=-1).min() > 2 * d
    assert np.linalg.norm(start[:, one] + start[:, other], axis=-1).min() >= 0.5  # goals are opposite
    assert np.abs(np.linalg.norm(start, axis=-1) - 5).max() < math.sqrt(0.5) + 1e-9


@pytest.mark.parametrize(("agents", "scenes"), [(5, 40), (10, 20), (20, 8)])
def test_many_agents(agents, scenes):
    domain = make("orca", agents=agents, scenes=scenes)
    truth = domain.windows("test")
    assert (np.diff(truth.observation.scene) == agents).all() and truth.known.all()
    assert 0.3 * scenes < truth.observation.scenes <= scenes
    xy = positions(agents=agents, scenes=scenes)
    speed = np.linalg.norm(np.diff(xy, axis=2), axis=-1) / domain.dt
    assert 0.5 < speed.mean() < 1 and speed.max() < 1.001
    assert np.linalg.norm(xy[:, :, -1] + xy[:, :, 0], axis=-1).min() > 0.5  # no agent has arrived


def test_agents_walk_to_the_other_side():
    # No other agent within 10 m: straight to the goal at 1 m/s, from rest.
    xy = positions(d=0.1, radius=20.0, scenes=30)
    first = xy[:, :, 0]
    inward = -first / np.linalg.norm(first, axis=-1, keepdims=True)
    assert np.allclose(xy[:, :, 10], first + 4.0 * inward, atol=2e-3)


def test_speed_and_horizon_matter():
    slow = positions(speed=0.5, scenes=30)
    assert np.linalg.norm(np.diff(slow, axis=2), axis=-1).max() < 0.5 * 0.4 + 1e-3
    assert not np.array_equal(positions(horizon=1.0, scenes=30), positions(scenes=30))


@pytest.mark.parametrize("parameters", [{"d": 0.1}, {"d": 0.6}, {"d": 0.6, "radius": 7.0}])
def test_the_oracle_has_almost_no_error(parameters):
    assert evaluate("orca_oracle", "orca", scenes=300, **parameters).metrics["ADE"].mean < 0.005


def test_windows_are_those_of_the_recordings():
    domain = make("orca", scenes=40)
    cut, windows = windows_of(domain.recordings("val")), domain.windows("val")
    for field in ("future", "known"):
        assert np.array_equal(getattr(cut, field), getattr(windows, field))
    assert np.array_equal(cut.observation.scene, windows.observation.scene)
    assert len(np.unique(windows.observation.agent)) == len(windows.future)


def test_sources_are_the_training_styles():
    domain = make("orca", d=0.6, radius=7.0, agents=3, seed=5, scenes=20)
    assert [s.d for s in domain.sources()] == [0.1, 0.3, 0.5]
    assert {(s.radius, s.agents, s.seed, s.scenes) for s in domain.sources()} == {(7.0, 3, 5, 20)}


DIGEST = """
    import hashlib, sys, warnings
    import motion_gym
    warnings.simplefilter("error")
    truth = motion_gym.domain("orca", d=0.6, agents=5, scenes=60, seed=3).windows("test")
    print(hashlib.sha256(truth.future.tobytes()).hexdigest())
"""


def python(code, **environment):
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(code)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )


def finish(process):
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return out.strip()


def test_two_processes_simulate_the_same_scenes_and_write_one_cache_entry(fresh_cache, monkeypatch):
    both = [python(DIGEST, PYTHONHASHSEED=str(n)) for n in (1, 2)]
    digests = {finish(process) for process in both}
    assert len(os.listdir(fresh_cache)) == 1
    monkeypatch.setenv("MOTION_GYM_CACHE", str(fresh_cache / "another"))
    here = make("orca", d=0.6, agents=5, scenes=60, seed=3).windows("test")
    assert digests == {digest(here.future)}


def test_a_second_domain_loads_the_scenes_of_the_first(fresh_cache, monkeypatch):
    first = make("orca", scenes=20).windows("test").future
    monkeypatch.setattr(Orca, "simulate", lambda self, start: pytest.fail("simulated again"))
    assert np.array_equal(make("orca", scenes=20).windows("test").future, first)


def test_a_damaged_cache_entry_is_simulated_again(fresh_cache):
    first = make("orca", scenes=20).windows("test").future
    (entry,) = fresh_cache.iterdir()
    with np.load(entry) as archive:
        arrays = dict(archive)
    arrays["positions"] += np.float32(100)
    np.savez(entry, **arrays)
    assert np.array_equal(make("orca", scenes=20).windows("test").future, first)


@pytest.mark.parametrize(
    "other",
    [
        {"d": 0.4},
        {"agents": 3},
        {"radius": 5.5},
        {"horizon": 3.0},
        {"speed": 0.9},
        {"seed": 1},
        {"scenes": 11},
        {"side": "left"},
    ],
    ids=lambda other: next(iter(other)),
)
def test_every_parameter_is_part_of_the_cache_key(fresh_cache, other):
    plain = make("orca", scenes=10)
    plain.windows("test")
    plain.windows("val")
    plain.replace(**other).windows("test")
    assert len(os.listdir(fresh_cache)) == 3


def test_an_unwritable_cache_gives_a_warning(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("MOTION_GYM_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.warns(RuntimeWarning, match="Not cached: .*MOTION_GYM_CACHE"):
        scenes = make("orca", scenes=10).windows("test").observation.scenes
    assert scenes > 5


def test_a_full_disk_gives_a_warning(fresh_cache):
    code = """
        import resource, signal, warnings
        import motion_gym
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scenes = motion_gym.domain("orca", scenes=100).windows("test").observation.scenes
        assert scenes > 90
        print(*(w.message for w in caught))
    """
    assert finish(python(code)).startswith("Not cached: ")
    assert os.listdir(fresh_cache) == []


def test_pickled_domain_is_light_and_the_same(fresh_cache):
    domain = make("orca", d=0.6, scenes=200)
    future = domain.windows("test").future
    content = pickle.dumps(domain)
    assert len(content) < 2000
    assert np.array_equal(pickle.loads(content).windows("test").future, future)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"d": 0}, "`d=0` of domain `orca` must be a number, 0.001 or more, and at most 10"),
        ({"d": -0.1}, "must be a number"),
        ({"d": math.nan}, "must be a number"),
        ({"d": math.inf}, "must be a number"),
        ({"d": "wide"}, "`d=wide` .* must be a number"),
        ({"d": None}, "`d=None` .* must be a number"),
        ({"d": [0.1]}, "must be a number"),
        ({"d": True}, "must be a number"),
        ({"radius": 0}, "`radius=0` .* must be a number"),
        ({"speed": -1}, "`speed=-1` .* must be a number"),
        ({"horizon": 0}, "`horizon=0` .* must be a number"),
        ({"agents": 1}, "`agents=1` .* whole number, from 2 to 20"),
        ({"agents": 21}, "from 2 to 20"),
        ({"agents": 2.0}, "whole number"),
        ({"agents": None}, "whole number"),
        ({"seed": -1}, "`seed=-1` .* whole number, 0 or more"),
        ({"seed": True}, "whole number"),
        ({"scenes": 0}, "`scenes=0` .* whole number, 1 or more"),
        ({"style": 0.3}, "no parameter `style`"),
    ],
)
def test_bad_parameters_are_refused(wrong, message):
    with pytest.raises(SpecError, match=message):
        make("orca", **wrong)


@pytest.mark.parametrize("parameters", [{"agents": 20, "d": 0.8}, {"agents": 20, "d": 3.0}, {"d": 6.0}])
def test_too_little_room_is_refused_quickly(parameters):
    domain = make("orca", **parameters)
    began = time.perf_counter()
    with pytest.raises(SpecError, match=r"no room .* radius 5 m for \d+ agents .* smaller d, fewer agents or a larger"):
        domain.windows("test")
    assert time.perf_counter() - began < 1


def test_agents_are_placed_with_little_room():
    start = make("orca", agents=20, d=0.7)._starts(np.random.default_rng(0), 100)
    one, other = np.triu_indices(20, 1)
    assert np.linalg.norm(start[:, one] - start[:, other], axis=-1).min() > 1.4


def test_a_circle_that_is_crossed_too_soon_is_refused():
    with pytest.raises(SpecError, match=r"come near its goal after 8 s.*radius above 3 m, a speed below 1 m/s"):
        make("orca", radius=3, scenes=20).windows("test")


def test_the_engine_gives_no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for parameters in ({"d": 0.1}, {"d": 0.6, "agents": 10}, {"d": 2.0}):
            make("orca", scenes=20, seed=9, **parameters).windows("test")
