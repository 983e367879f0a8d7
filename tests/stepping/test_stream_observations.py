"""What the observations of the stream clock hold beside positions: features and images, read-only."""

import numpy as np
from hypothesis import given

from motion_gym.contract import Recording
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.windows import pick_scenes, positions_only
from motion_gym.stepping.stream_clock import StreamClock
from tests.clock_plays import play, recordings, some
from tests.windows import windows_of


def ground(brightness):
    return SceneImage(np.full((2, 2, 3), brightness, np.uint8), np.zeros(2), np.ones(2))


@given(recordings())
@some
def test_an_observation_holds_the_image_of_its_place_and_arrays_that_cannot_be_written(places):
    images = [ground(number) for number in range(len(places))]
    played = play(StreamClock(places, images=images))
    frames = [len(np.unique(place.frame)) for place in places]
    for step, time in zip(played.steps, played.times, strict=True):
        seen = step.observation
        arrays = (seen.history, seen.scene, seen.agent, seen.time)
        assert not any(array.flags.writeable for array in arrays)
        if len(seen):
            (image,) = seen.images
            assert image.photo[0, 0, 0] == (time >= frames[0])
        else:
            assert seen.images is None
    if not played.settled():
        return
    settled = played.ledger.matured_only()[1].observation
    assert len(settled.images) == settled.scenes
    for image, time in zip(settled.images, settled.time, strict=True):
        assert image.photo[0, 0, 0] == (time >= frames[0])


def test_a_place_without_an_image_has_none():
    place = Recording(np.arange(30), np.zeros(30, int), np.zeros((30, 2)), 0.4)
    played = play(StreamClock([place, place], images=[None, ground(1)]))
    with_image = [step.observation.images is not None for step in played.steps]
    assert with_image == [False] * 23 + [True] * 23 + [False]


def test_features_of_a_stream_are_those_of_its_windows():
    rng = np.random.default_rng(0)
    frame, agent = np.divmod(np.arange(90), 2)
    place = Recording(frame, agent, rng.normal(size=(90, 2)), 0.4)

    def speeds(positions, known):
        speed = np.linalg.norm(np.diff(positions[:, :8], axis=1, prepend=positions[:, :1]), axis=2, keepdims=True)
        return np.concatenate([positions_only(positions, known), speed], axis=2)

    ledger = play(StreamClock([place], speeds)).ledger
    truth = windows_of([place], speeds)
    np.testing.assert_array_equal(ledger.matured_only()[1].observation.history, truth.observation.history)
    np.testing.assert_array_equal(
        pick_scenes(truth, [0]).observation.history, StreamClock([place], speeds).reset().observation.history
    )
