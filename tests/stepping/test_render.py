from __future__ import annotations

import dataclasses
import pickle
import warnings

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest

from motion_gym.contract import Recording, SpecError
from motion_gym.data.domains import RecordedDomain
from motion_gym.stepping.gymnasium_env import WindowEnv
from motion_gym.stepping.pettingzoo_env import ForecastEnv
from motion_gym.stepping.render import FORECAST_COLOR, GROUND_COLOR, HISTORY_COLOR, TRUTH_COLOR, Canvas


class Lanes(RecordedDomain):
    """People walk side by side in separate lanes."""

    name = "lanes"

    def __init__(self, people: int = 2, frames: int = 24):
        self.people, self.frames = people, frames

    def recordings(self, split):
        frame, agent = np.divmod(np.arange(self.people * self.frames), self.people)
        return [Recording(frame, agent, np.stack([frame * 0.5, agent * 1.5], axis=1), self.dt)]


def straight(env, samples: int = 1, drift: float = 0.0) -> dict[str, np.ndarray]:
    """Everyone walks along x; the samples fan out by ``drift`` metres."""
    actions = {}
    for name, (x, y) in zip(env.agents, env._step.observation.xy[:, -1], strict=True):
        ahead = np.arange(1, 13)
        fan = drift * np.arange(samples)[:, None] * ahead / 12 + drift
        actions[name] = np.stack([np.broadcast_to(x + ahead / 2, (samples, 12)), y + fan], -1).astype(np.float32)
    return actions


def after(steps: int, *, clock: str, people: int = 2, samples: int = 1, drift: float = 0.0) -> ForecastEnv:
    env = ForecastEnv(Lanes(people), clock=clock, samples=samples, render_mode="rgb_array")
    env.reset()
    for _ in range(steps):
        env.step(straight(env, samples, drift))
    return env


def near(image: np.ndarray, color: str, tolerance: int = 12) -> int:
    """Pixels of a color."""
    wanted = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return int((np.abs(image.astype(int) - wanted).max(axis=2) <= tolerance).sum())


def limits(env) -> tuple:
    axes = env._canvas._figure.axes[0]
    return axes.get_xlim(), axes.get_ylim(), axes.get_position().bounds


@pytest.mark.parametrize("clock", ["windows", "stream"])
@pytest.mark.parametrize("people, samples", [(1, 1), (2, 20), (40, 1), (15, 20)])
def test_pictures_are_rgb_of_one_size(clock, people, samples):
    env = after(1, clock=clock, people=people, samples=samples, drift=0.2)
    image = env.render()
    assert image.dtype == np.uint8 and image.shape == (540, 720, 3)
    assert image.flags.writeable and image is not env.render()
    assert near(image, HISTORY_COLOR) > 50 * people, "histories are solid"
    assert (image == 255).all(axis=2).mean() > 0.5


class Road(Lanes):
    """People on a road with an edge far to the left and a dashed line, whose origin is not zero."""

    def recordings(self, split):
        (recording,) = super().recordings(split)
        return [dataclasses.replace(recording, xy=recording.xy + 3000, origin=np.array([3000.0, 3000.0]))]

    def ground_lines(self):
        along = 3000 + np.array([[0.0, 0], [11.5, 0]])
        return [(along + np.array([0, 6]), False), (along + np.array([0, 0.75]), True)]


@pytest.mark.parametrize("clock", ["windows", "stream"])
def test_lines_on_the_ground_are_behind_the_agents_and_in_the_picture(clock):
    env, plain = (ForecastEnv(kind(), clock=clock, render_mode="rgb_array") for kind in (Road, Lanes))
    images = []
    for each in (env, plain):
        each.reset()
        images.append(each.render())
    assert near(images[0][60:], GROUND_COLOR) > 300 > 20 > near(images[1][60:], GROUND_COLOR)
    low, high = limits(env)[1]
    assert low < 0 and 6 < high < 12, "the edge of the road is in the picture"
    lines = env._canvas._figure.axes[0].lines
    assert lines[0].get_ydata().tolist() == [6, 6] and lines[1].get_linestyle() == "--"
    assert min(line.get_zorder() for line in lines) == lines[0].get_zorder()


def test_axes_have_one_scale_except_along_a_road():
    for kind, people, stretched in ((Road, 2, False), (Lanes, 1, False), (Long, 2, True)):
        env = ForecastEnv(kind(people), clock="windows", render_mode="rgb_array")
        env.reset()
        env.render()
        axes = env._canvas._figure.axes[0]
        assert (axes.get_aspect() == "auto") == stretched
        assert ("not to the scale" in axes.get_ylabel()) == stretched


class Long(Road):
    def ground_lines(self):
        return [(3000 + np.array([[0.0, -1], [100, -1]]), False)]


def test_a_window_shows_its_truth_and_its_forecast():
    env = after(0, clock="windows")
    before = env.render()
    assert near(before, HISTORY_COLOR) > 100
    assert near(before[60:], TRUTH_COLOR) == 0, "nothing of the future is shown before it was forecast"
    env.step(straight(env, drift=0.3))
    then = env.render()
    assert near(then[60:], TRUTH_COLOR) > 50
    assert not np.array_equal(before, then)


@pytest.mark.parametrize("clock, steps", [("windows", 1), ("stream", 1), ("stream", 12)])
def test_the_picture_changes_with_the_forecast_and_with_nothing_else(clock, steps):
    images = [after(steps, clock=clock, drift=drift).render() for drift in (0.3, 0.3, 0.6)]
    np.testing.assert_array_equal(images[0], images[1])
    assert not np.array_equal(images[0], images[2])


@pytest.mark.parametrize("make", [lambda: after(0, clock="windows"), lambda: after(0, clock="stream")])
def test_the_scale_is_the_same_for_a_whole_episode(make):
    env, seen = make(), set()
    while env.agents:
        if env.clock.time % 4 == 0:
            env.render()
            seen.add(limits(env))
        env.step(straight(env, drift=30.0))
    env.render()
    seen.add(limits(env))
    assert len(seen) == 1
    (left, right), (low, high), _ = seen.pop()
    assert left < 0 and right > 23 * 0.5 and low < 0 and high > 1.5


def test_the_last_picture_of_an_episode_can_be_drawn():
    env = after(5, clock="windows")
    assert not env.agents and near(env.render()[60:], TRUTH_COLOR) > 50
    env = after(17, clock="stream")
    assert not env.agents and env.render().shape == (540, 720, 3)


@pytest.mark.parametrize(
    ("clock", "labels"),
    [
        ("windows", ["history", "forecast", "ground truth"]),
        ("stream", ["history", "forecast", "earlier forecast, scored now", "its ground truth"]),
    ],
)
def test_the_legend_explains_every_line(clock, labels):
    env = after(13, clock=clock) if clock == "stream" else after(2, clock=clock)
    env.render()

    figure = env._canvas._figure
    assert [text.get_text() for text in figure.legends[0].get_texts()] == labels
    shown = {line.get_color() for line in figure.axes[0].lines}
    assert shown == {line.get_color() for line in figure.legends[0].get_lines()}


def test_more_samples_are_fainter():
    one, many = (after(1, clock="stream", samples=k) for k in (1, 20))
    one.render(), many.render()

    def faintest(env):
        lines = [line for line in env._canvas._figure.axes[0].lines if line.get_color() == FORECAST_COLOR]
        assert len(lines) == 2 * env.samples
        return {line.get_alpha() for line in lines}

    assert max(faintest(many)) < min(faintest(one)) < 1


def test_few_agents_are_labelled_with_the_end_of_their_names():
    for people, labels in ((3, ["0", "1", "2"]), (13, [])):
        env = after(0, clock="stream", people=people)
        env.render()
        assert [text.get_text() for text in env._canvas._figure.axes[0].texts] == labels
    assert [name.rsplit("_", 1)[1] for name in after(0, clock="stream", people=3).agents] == ["0", "1", "2"]


def test_the_title_tells_domain_clock_step_and_agents():
    def title(env):
        env.render()
        return env._canvas._figure.texts[0].get_text()

    assert title(after(0, clock="windows")) == "lanes, windows clock, step 0, 2 agents"
    assert title(after(3, clock="windows")) == "lanes, windows clock, step 2, 2 agents", "the window that is drawn"
    assert title(after(3, clock="stream", people=1)) == "lanes, stream clock, step 10, 1 agent"


def test_title_and_legend_cover_neither_each_other_nor_the_data():
    env = after(1, clock="windows")
    env.render()
    figure = env._canvas._figure
    title, legend, axes = figure.texts[0], figure.legends[0], figure.axes[0]
    boxes = [part.get_window_extent() for part in (title, legend, axes)]
    for i, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])
        assert box.x0 >= 0 and box.x1 <= 720 and box.y1 <= 540


def test_the_gymnasium_environment_draws_the_window_that_was_forecast():
    env = WindowEnv(Lanes(3), samples=5, render_mode="rgb_array")
    env.reset()
    before = env.render()
    action = np.zeros(env.action_space.shape, np.float32)
    env.step(action)
    zero = env.render()
    env.reset()
    np.testing.assert_array_equal(env.render(), before)
    env.step(action + np.float32(3))
    assert before.shape == zero.shape == (540, 720, 3)
    assert not np.array_equal(zero, before) and not np.array_equal(env.render(), zero)
    env.close()


@pytest.mark.parametrize(
    "make", [lambda mode: ForecastEnv(Lanes(), render_mode=mode), lambda mode: WindowEnv(Lanes(), render_mode=mode)]
)
class TestErrors:
    def test_without_a_mode(self, make):
        env = make(None)
        env.reset()
        with pytest.raises(SpecError, match=r"made without a render_mode.*rgb_array"):
            env.render()

    def test_before_reset(self, make):
        with pytest.raises(SpecError, match=r"nothing to render yet: call reset\(\)"):
            make("rgb_array").render()

    def test_a_mode_that_does_not_exist(self, make):
        with pytest.raises(SpecError, match=r"`render_mode=humn` is not known.*Did you mean `human`"):
            make("humn")

    def test_human_mode_warns_where_no_window_can_be_opened(self, make):
        with pytest.warns(RuntimeWarning, match="will show nothing") as caught:
            env = make("human")
        assert caught[0].filename == __file__, "the warning points at the line that asked for it"
        env.reset()
        assert env.render() is None and len(plt.get_fignums()) == 1
        pickle.loads(pickle.dumps(env))
        assert len(plt.get_fignums()) == 1, "a copy opens no window of its own"
        env.close()
        assert not plt.get_fignums()


def test_rgb_array_leaves_pyplot_alone():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        backend, figures = matplotlib.get_backend(), plt.get_fignums()
        after(1, clock="windows").render()
    assert (matplotlib.get_backend(), plt.get_fignums()) == (backend, figures)


def test_a_place_without_extent_can_be_drawn():
    canvas, env = Canvas("rgb_array", Lanes(), "test", "point", np.zeros((2, 2))), after(0, clock="stream", people=1)
    canvas.update(0, env._step.observation, None, None)
    assert canvas.image().shape == (540, 720, 3)


class Far(RecordedDomain):
    """A walker in UTM coordinates."""

    name = "far"

    def recordings(self, split):
        """The same recording for all splits."""
        xy = np.array([471_000.0, 5_501_000.0]) + 0.5 * np.arange(30)[:, None]
        return [Recording(np.arange(30), np.zeros(30, np.int64), xy, self.dt)]


@pytest.mark.parametrize("make", [WindowEnv, ForecastEnv])
def test_axes_show_the_coordinates_of_the_source(make):
    env = make(Far(), render_mode="rgb_array")
    env.reset()
    env.render()
    (axes,) = env._canvas._figure.axes
    env._canvas._figure.canvas.draw()
    for axis, first in ((axes.xaxis, 471_000), (axes.yaxis, 5_501_000)):
        shown = [float(label.get_text()) for label in axis.get_ticklabels()]
        assert len(shown) > 2 and all(first - 50 < value < first + 50 for value in shown)
    history = env.domain.windows("test").observation.history
    assert np.abs(history).max() < 1000, "predictors are shown positions near the origin"
