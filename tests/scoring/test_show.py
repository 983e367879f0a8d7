"""Pictures of a scene: what is drawn, which scene is chosen, and what is written."""

from __future__ import annotations

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image, ImageSequence

import motion_gym
from motion_gym.contract import Recording, SpecError
from motion_gym.data.domains import RecordedDomain


class Lanes(RecordedDomain):
    """Two people walk side by side for 30 steps, far from zero."""

    name = "lanes"

    def recordings(self, split):
        frame, agent = np.divmod(np.arange(60), 2)
        return [Recording(frame, agent, np.stack([4e6 + frame * 0.5, agent * 1.5], axis=1), self.dt)]


def labels(figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_history_ground_truth_and_forecasts_are_drawn_with_their_errors():
    figure = motion_gym.show(Lanes(), ["constant_velocity", "stand_still"])

    assert labels(figure) == [
        "history",
        "ground truth",
        "constant_velocity: ADE 0.00 m",
        "stand_still: ADE 3.25 m",
    ]
    lines = {line.get_label(): line.get_xydata() for line in figure.axes[0].lines}
    assert lines["history"].shape == (8, 2)
    assert lines["ground truth"].shape == (13, 2)
    np.testing.assert_allclose(lines["constant_velocity: ADE 0.00 m"], lines["ground truth"], atol=1e-4)


def test_axes_show_coordinates_of_the_source():
    figure = motion_gym.show(Lanes())
    figure.canvas.draw()

    assert all(float(tick.get_text()) > 3.9e6 for tick in figure.axes[0].get_xticklabels())


@pytest.mark.parametrize(
    ("choice", "number"), [({}, 0), ({"scene": 4}, 4), ({"time": 0}, 0), ({"time": 3.0}, 1), ({"time": 3.2}, 1)]
)
def test_a_scene_is_chosen_by_number_or_time(choice, number):
    figure = motion_gym.show(Lanes(), **choice)

    assert figure.axes[0].get_title().endswith(f"scene {number}")


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"scene": 11}, "`scene=11`.*from 0 to 10"),
        ({"scene": -1}, "`scene=-1`"),
        ({"time": 99}, "`time=99`"),
        ({"scene": 1, "time": 2}, "give one of them"),
        ({"k": 0}, "`k=0`"),
        ({"out": "scene.bmp"}, "must end in"),
        ({"out": "scene"}, "must end in"),
        ({"split": "tset"}, "Did you mean"),
        ({"predictors": "constant_velocty"}, "Did you mean"),
    ],
)
def test_what_cannot_be_shown_is_refused(choice, message):
    with pytest.raises(SpecError, match=message):
        motion_gym.show(Lanes(), **choice)


def test_all_samples_are_drawn_and_the_best_one_is_named():
    class Fan:
        def predict(self, observation, samples=1, seed=0):
            ahead = np.arange(1, 13)
            along = observation.xy[:, None, -1:] + np.stack([ahead * 0.5, 0 * ahead], axis=-1)[None, None]
            aside = np.arange(samples)[::-1, None, None] * np.array([0.0, 1.0])
            return (along + aside).astype(np.float32)

    figure = motion_gym.show(Lanes(), Fan(), k=3)

    assert labels(figure)[2] == "Fan: ADE 2.00 m, best of 3 0.00"
    assert len([line for line in figure.axes[0].lines if line.get_alpha()]) == 2 * 3


def test_a_notebook_displays_the_picture():
    assert motion_gym.show(Lanes())._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(("suffix", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_pictures_are_written(suffix, start, tmp_path):
    file = tmp_path / f"scene.{suffix}"
    motion_gym.show(Lanes(), "constant_velocity", out=file)

    assert file.read_bytes().startswith(start)
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def movie_frames(file):
    """The frames of an animation, each an RGB array."""
    if file.suffix == ".gif":
        with Image.open(file) as movie:
            return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(movie)]
    reader = imageio_ffmpeg.read_frames(file)
    width, height = next(reader)["size"]
    return [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader]


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_an_animation_shows_the_steps_one_after_another(suffix, tmp_path):
    file = tmp_path / f"scene.{suffix}"
    motion_gym.show(Lanes(), "constant_velocity", out=file)

    frames = movie_frames(file)
    assert len(frames) >= 20
    images = [frames[number].mean(axis=2) for number in (0, 7, 19)]
    ink = [(image < 128).sum() for image in images]
    assert ink[0] < ink[2]
    assert not np.array_equal(images[1], images[2])
