"""Simulated people who walk at a constant speed."""

import numpy as np
import pytest

from motion_gym import domain, evaluate
from motion_gym.contract import SpecError


def paths(split="test", **parameters):
    """[S, N, 20, 2] positions of the people of each scene."""
    place = domain("walkers", scenes=300, **parameters)
    truth = place.windows(split)
    xy = np.concatenate([truth.observation.xy, truth.future], axis=1).astype(float)
    assert truth.observation.scenes == 300
    return xy.reshape(300, place.people, 20, 2)


@pytest.mark.parametrize("speed", [0, 0.5, 1.3, 6])
def test_everyone_walks_straight_on_at_the_speed(speed):
    steps = np.diff(paths(speed=speed, noise=0, people=3), axis=2)
    assert np.linalg.norm(steps, axis=-1) == pytest.approx(0.4 * speed, abs=1e-4)
    assert np.ptp(steps, axis=2) == pytest.approx(0, abs=1e-4)
    assert evaluate("constant_velocity", "walkers", speed=speed, noise=0).ade.mean == pytest.approx(0, abs=1e-4)


def test_headings_are_uniform():
    step = np.diff(paths(noise=0), axis=2)[:, 0, 0]
    quarters = np.bincount((np.arctan2(step[:, 1], step[:, 0]) // (np.pi / 2)).astype(int) % 4, minlength=4)
    assert quarters.min() > 50  # 75 expected, standard deviation 7.5


def test_scenes_turn_left_or_right_by_the_stated_angle():
    steps = np.diff(paths(noise=0, turn=15), axis=2)[:, 0]
    turns = np.degrees(np.diff(np.unwrap(np.arctan2(steps[..., 1], steps[..., 0])))) / 0.4
    assert abs(turns) == pytest.approx(15, abs=0.05)
    assert 0.4 < (turns[:, 0] > 0).mean() < 0.6
    assert (np.sign(turns) == np.sign(turns[:, :1])).all()


@pytest.mark.parametrize(("people", "gap", "turn"), [(2, 50.0, 0), (6, 1.0, 0), (3, 1.0, 20)])
def test_people_start_side_by_side_and_follow_the_same_path(people, gap, turn):
    xy = paths(people=people, gap=gap, turn=turn, noise=0)
    aside, ahead = np.diff(xy, axis=1), np.diff(xy, axis=2)
    assert np.linalg.norm(aside, axis=-1) == pytest.approx(gap, abs=1e-4)
    assert np.einsum("sni,sni->sn", aside[:, :, 0], ahead[:, 1:, 0]) == pytest.approx(0, abs=1e-3)
    assert np.diff(ahead, axis=1) == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_the_error_of_constant_velocity_is_that_of_the_noise(noise):
    # The error at future step h has, along each axis, the variance noise^2 (1 + (1 + h)^2 + h^2).
    h = np.arange(1, 13)
    expected = (noise * np.sqrt(np.pi / 2 * (1 + (1 + h) ** 2 + h**2))).mean()
    assert evaluate("constant_velocity", "walkers", noise=noise).ade.mean == pytest.approx(expected, rel=0.08)


def test_splits_and_seeds_draw_other_people_and_the_same_spec_draws_the_same():
    drawn = [paths(split) for split in ("train", "val", "test", "reference")] + [paths(seed=1)]
    for i, first in enumerate(drawn):
        assert not any((first == second).any() for second in drawn[:i])
    np.testing.assert_array_equal(paths(), paths())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("people", 0), ("people", 51), ("people", 1.5), ("gap", 0), ("gap", float("inf")), ("speed", -1),
        ("speed", "fast"), ("turn", 181), ("noise", -0.1), ("noise", float("nan")), ("scenes", 0), ("seed", -1),
    ],
)  # fmt: skip
def test_a_bad_parameter_is_named_with_what_is_allowed(name, value):
    with pytest.raises(SpecError, match=rf"`{name}") as error:
        domain("walkers", **{name: value})
    assert str(value) in str(error.value)
