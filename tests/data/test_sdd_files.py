"""Files of the Stanford Drone Dataset: what is read, and bad lines."""

from __future__ import annotations

import numpy as np
import pytest

from motion_gym.contract import DataError
from motion_gym.data.scene_images import SceneImage, read_scene_image
from motion_gym.data.sdd_files import read_annotations, read_clips, read_scales, scale_of
from tests.drone import line, write_clip, write_image, write_labels

GOOD = [line(0, frame, 100 + frame) for frame in range(30)]


def test_positions_are_centres_of_every_twelfth_frame_without_lost_rows(tmp_path):
    lines = [*GOOD, *(line(7, frame, 50, 60, lost=int(frame == 12), label="Biker") for frame in range(6, 30))]
    rows = read_clips({"quad_2": write_clip(tmp_path, "quad_2", lines)})
    assert rows.clips == ("quad_2",)
    assert rows.frame.tolist() == [0, 12, 24, 24] and rows.agent.tolist() == [0, 0, 0, 7]
    assert rows.xy.tolist() == [[100, 200], [112, 200], [124, 200], [50, 60]]
    assert rows.label.tolist() == ["pedestrian"] * 3 + ["biker"]


@pytest.mark.parametrize(
    ("bad", "fault"),
    [
        ("0 1 2 3", "4 columns instead of 10"),
        (line(frame=40).replace("90", "ninety", 1), "`xmin` is 'ninety', not a number"),
        (line(agent="x", frame=40), "`agent` is 'x', not a whole number"),
        (line(frame=40).replace(" 40 0", " 4.5 0", 1), "`frame` is '4.5', not a whole"),
        (line(frame=40, label="Horse"), "the class is none of pedestrian, biker"),
        (line(frame=40, lost=2), "`lost` is neither 0 nor 1"),
        (line(frame=40, x=10**9), "farther than 10,000 pixels"),
        (line(frame=40).replace("90", "nan", 1), "farther than 10,000 pixels"),
        (line(frame=40).replace("90", "500", 1), "the box ends before it begins"),
        (line(frame=-12), "the frame is not between"),
        (line(frame=3), "a second time"),
    ],
)
def test_a_bad_line_is_named(tmp_path, bad, fault):
    path = write_clip(tmp_path, "quad_2", [*GOOD[:12], "", bad, *GOOD[12:]])
    with pytest.raises(DataError) as error:
        read_annotations(path)
    assert f"{path}, line 14: " in str(error.value)
    assert fault in str(error.value) and "Correct or delete the line" in str(error.value)


def test_an_empty_file_is_refused(tmp_path):
    with pytest.raises(DataError, match="has no rows"):
        read_annotations(write_clip(tmp_path, "quad_2", ["", " "]))


def test_scales_are_read_and_bad_lines_are_named(tmp_path):
    path = tmp_path / "scales.yaml"
    path.write_text("quad:\n   video0:\n      scale: 0.04\n      certainty: 0.9\n\n   video1:\n      scale: 0.05\n")
    assert read_scales(path) == {"quad_0": (0.04, 0.9), "quad_1": (0.05, 0.0)}
    path.write_text("quad:\n   video0:\n      scale: wide\n")
    with pytest.raises(DataError, match=r"scales\.yaml, line 3: .*scale: wide"):
        read_scales(path)


def test_a_clip_without_a_scale_is_named(tmp_path):
    path = tmp_path / "scales.yaml"
    path.write_text("quad:\n   video0:\n      scale: 0.04\n")
    assert scale_of(path, "quad_0") == 0.04
    with pytest.raises(DataError, match=r"scales\.yaml has no scale of the clip quad_1\. Add it"):
        scale_of(path, "quad_1")


def test_an_image_is_reduced_with_its_label_map(tmp_path):
    photo, labels = write_image(tmp_path / "a.jpg", (402, 300)), write_labels(tmp_path / "a.png", (402, 300))
    image = read_scene_image(photo, labels, 0.05, 4)
    assert image.photo.shape == (75, 100, 3) and image.labels.shape == (75, 100)
    assert np.abs(image.photo.astype(int) - (40, 160, 60)).max() < 8
    assert set(image.labels[:, :49].ravel()) == {1} and set(image.labels[:, 51:].ravel()) == {3}
    assert image.extent == pytest.approx(np.array([[0, 0], [20, 15]]))
    assert image.relative_to(np.array([5.0, 10])).extent == pytest.approx(np.array([[-5, -10], [15, 5]]))


def test_a_label_map_of_another_size_is_refused(tmp_path):
    photo, labels = write_image(tmp_path / "a.jpg", (400, 300)), write_labels(tmp_path / "a.png", (200, 300))
    with pytest.raises(DataError, match=r"a\.png does not match .*200 x 300 .* 400 x 300"):
        read_scene_image(photo, labels)


def test_a_file_that_is_no_image_is_refused(tmp_path):
    path = tmp_path / "quad_2.jpg"
    path.write_text("<html>")
    with pytest.raises(DataError, match=r"quad_2\.jpg is not an image"):
        read_scene_image(path, None)


PHOTO = np.zeros((3, 4, 3), np.uint8)


@pytest.mark.parametrize(
    "arguments",
    [
        (PHOTO[..., 0], np.zeros(2), np.ones(2)),
        (PHOTO.astype(float), np.zeros(2), np.ones(2)),
        (PHOTO, np.array([0, np.nan]), np.ones(2)),
        (PHOTO, np.zeros(2), np.array([1.0, 0.0])),
        (PHOTO, np.zeros(2), np.ones(2), np.zeros((4, 3), np.uint8)),
    ],
)
def test_a_wrong_scene_image_is_refused(arguments):
    with pytest.raises(DataError, match="scene image"):
        SceneImage(*arguments)


def test_nobody_can_write_into_a_scene_image():
    image = SceneImage(PHOTO, np.zeros(2), np.ones(2))
    with pytest.raises(ValueError, match="WRITEABLE"):
        image.photo.flags.writeable = True
