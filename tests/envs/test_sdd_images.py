"""Images of the ground in observations: they survive every path, show no future, and stand behind pictures."""

from __future__ import annotations

import dataclasses

import gymnasium
import numpy as np
import pytest

import motion_gym
from motion_gym.catalog import domain
from motion_gym.checks.leaks import leak_probe
from motion_gym.contract import DataError
from motion_gym.data.datasets import path_of
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.windows import check_truth, pick_scenes, stack
from motion_gym.stepping.harness import frozen
from motion_gym.stepping.pettingzoo_env import ForecastEnv
from motion_gym.stepping.render import PALENESS
from tests.drone import add_clips
from tests.walks import walk_rows

RED, GREEN = (200, 40, 60), (40, 160, 60)
"""Colors of the images of coupa_2 and of hyang_2."""


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path / "data"))
    add_clips(tmp_path)
    return domain("sdd", form="clips", image=True, split="0 0 1")


def colors(images):
    """Which image each scene has."""
    near = [
        [np.abs(image.photo.reshape(-1, 3).mean(axis=0) - color).max() < 9 for color in (RED, GREEN)]
        for image in images
    ]
    assert (np.sum(near, axis=1) == 1).all()
    return np.argmax(near, axis=1).tolist()


class Sees:
    """Constant velocity, where every scene has the image of its clip; else it fails."""

    def predict(self, observation, samples=1, seed=0):
        assert len(observation.images) == observation.scenes
        for scene, image in enumerate(observation.images):
            last = observation.xy[observation.scene[scene] : observation.scene[scene + 1], -1]
            column, row = ((last - image.corner) / image.pixel).astype(int).T
            assert image.photo[row, column].shape == (len(last), 3)
        return np.repeat(observation.xy[:, None, -1:], 12, axis=2)

    def observe(self, truth):
        assert len(truth.observation.images) == truth.observation.scenes


def test_every_scene_has_the_image_of_its_clip(place):
    truth = place.windows("test")
    seen = truth.observation
    clip = np.searchsorted(np.cumsum([len(np.unique(r.frame)) for r in place.recordings("test")]), seen.time, "right")
    assert colors(seen.images) == clip.tolist() and set(clip.tolist()) == {0, 1}
    assert len({id(image) for image in seen.images}) == 2, "scenes of one clip share an image"
    assert seen.images[0].photo.shape == (130, 160, 3) and seen.images[0].pixel.tolist() == [4, 4]
    for scenes in ([seen.scenes - 1, 0], slice(0, seen.scenes, 3), np.arange(seen.scenes) % 2 == 0):
        picked = pick_scenes(truth, scenes).observation
        assert picked.images == tuple(np.array(seen.images, object)[scenes])
    both = stack([pick_scenes(truth, [0]), pick_scenes(truth, [seen.scenes - 1])]).observation
    assert both.images == (seen.images[0], seen.images[-1]) == frozen(both).images


def test_images_are_absent_unless_they_are_asked_for(place):
    plain = place.replace(image=False).windows("test")
    assert plain.observation.images is None
    mixed = stack([pick_scenes(place.windows("test"), [0]), pick_scenes(plain, [1])])
    assert mixed.observation.images is None


def test_a_truth_with_an_image_missing_is_refused(place):
    truth = place.windows("test")
    wrong = dataclasses.replace(truth, observation=dataclasses.replace(truth.observation, images=()))
    with pytest.raises(DataError, match=r"images must be None or a tuple of \d+ SceneImage"):
        check_truth(wrong, "windows")


def test_predictors_see_images_in_evaluation_in_a_fresh_process_and_on_streams(place):
    card = motion_gym.evaluate(Sees(), place)
    assert card.ade.mean > 0
    online = motion_gym.evaluate_online(Sees(), motion_gym.stream([place]))
    assert online.ade.agent_windows > 100


def test_the_ledger_keeps_images(place):
    env = ForecastEnv(place, clock="stream")
    observations, _ = env.reset()
    first = colors(env.images)
    while env.agents:
        observations, *_ = env.step({a: np.repeat(observations[a][-1:, :2], 12, 0)[None] for a in env.agents})
    _, truth = env.ledger.matured_only()
    seen = colors(truth.observation.images)
    assert len(seen) == truth.observation.scenes and first == seen[:1] == [0] and seen[-1] == 1


@pytest.mark.parametrize("clock", ["windows", "stream"])
def test_the_probe_finds_no_leak_in_the_images(place, clock):
    report = leak_probe(Sees(), place, clock=clock, cuts=2)
    assert report.ok and report.checked["images of the ground"] > 50


class Drawn(RecordedDomain):
    """Observations hold a map of where people walk, during the whole recording."""

    name = "drawn"

    def recordings(self, split):
        rows = np.array(walk_rows(people=4, frames=600, every=10))
        return [motion_gym.Recording(rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2:], 0.4)]

    def observed_image(self, recording):
        photo = np.zeros((20, 20, 3), np.uint8)
        low = recording.xy.min(axis=0)
        size = (recording.xy.max(axis=0) - low) / 19.99 + 1e-9
        column, row = ((recording.xy - low) / size).astype(int).T
        photo[row, column] = 255
        return SceneImage(photo, low, size)


@pytest.mark.parametrize("clock", ["windows", "stream"])
def test_the_probe_finds_an_image_that_shows_the_future(clock):
    report = leak_probe("constant_velocity", Drawn(), clock=clock, cuts=2)
    assert any("images of the ground" in leak and "data after time" in leak for leak in report.leaks)


def share_near(picture, color):
    """Share of a picture that has the pale version of a color."""
    pale = 255 - (255 - np.array(color)) * PALENESS
    return float((np.abs(picture[..., :3].astype(float) - pale).max(axis=2) < 12).mean())


def test_pictures_of_environments_show_the_clip_of_the_scene(place):
    env = gymnasium.make("motion_gym/SDD-v0", form="clips", split="test", render_mode="rgb_array", class_="pedestrian")
    last = env.unwrapped.padded.truth.observation.scenes - 1
    for scene, (own, other) in {0: (RED, GREEN), last: (GREEN, RED)}.items():
        env.reset(options={"scene": scene})
        picture = env.render()
        assert share_near(picture, own) > 0.2 > 0.01 > share_near(picture, other)
    axes = env.unwrapped._canvas._figure.axes[0]
    assert axes.yaxis_inverted(), "y points downwards, as in the image"
    xy = env.unwrapped.padded.truth.observation.xy
    assert axes.get_xlim()[0] < xy[..., 0].min() and axes.get_xlim()[1] > xy[..., 0].max()


def test_show_has_the_image_behind_the_scene(place, tmp_path):
    figure = motion_gym.show(place, "constant_velocity", scene=0, out=tmp_path / "scene.png")
    (axes,) = figure.axes
    (image,) = axes.images
    assert axes.yaxis_inverted() and image.get_zorder() < min(line.get_zorder() for line in axes.lines)
    left, right, bottom, top = image.get_extent()
    assert left <= max(axes.get_xlim()[0], 0) and top <= max(axes.get_ylim()[1], 0) and right > left and bottom > top


def test_a_domain_without_an_image_file_is_drawn_without(place):
    for clip in ("coupa_2", "hyang_2"):
        path_of("sdd", f"reference/{clip}.jpg").unlink()
    figure = motion_gym.show(place.replace(image=False), "constant_velocity")
    assert not figure.axes[0].images and not figure.axes[0].yaxis_inverted()
    with pytest.raises(DataError, match=r"coupa_2\.jpg is missing"):
        place.replace(image=True).windows("test")


def test_label_maps_are_in_observations_and_in_pictures(sdd):
    place = domain("sdd:form=clips,scene=quad,video=0,image=true")
    (image,) = set(place.windows("test").observation.images)
    assert image.labels.shape == image.photo.shape[:2] == (1088 // 4, 1983 // 4)
    assert set(np.unique(image.labels)) <= {1, 2, 3, 4, 5}
    mapped = place.replace(background="labels")
    drawn = mapped.ground_image(place.recordings("test")[0])
    assert len(np.unique(drawn.photo @ (1, 256, 65536))) == len(np.unique(drawn.labels)) > 2
    assert set(mapped.windows("test").observation.images[0].photo.reshape(-1, 3)[:, 0]) <= {120, 200, 90, 190}
    assert "later times" in place.card.source and "later times" not in mapped.card.source
