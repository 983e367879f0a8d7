"""Scenes are identified by time and place, equally in the evaluator, the clock and the environment."""

import doctest

import numpy as np
import pytest

import motion_gym as mg
from motion_gym import catalog
from motion_gym.contract import SpecError
from motion_gym.data.domains import RecordedDomain
from motion_gym.metrics.errors import ade
from motion_gym.online import evaluation
from motion_gym.online.evaluation import evaluate_online
from motion_gym.online.streams import Segment, Stream, stream
from tests.bias import Bias
from tests.street import Street
from tests.taped import Taped, fitted_linear

STREET = Street(frames=140)
CROWD = "orca:d=0.3,scenes=6"


def test_the_example_of_the_documentation_is_true():
    result = doctest.testmod(evaluation)
    assert result.attempted > 5 and result.failed == 0


class Walks(RecordedDomain):
    """Three people who walk side by side, or stand, with or without invisible noise."""

    name = "walks"

    def __init__(self, stands: bool = True, jitter: float = 0.0):
        self.stands, self.jitter = stands, jitter

    def recordings(self, split):
        """The same recording for all splits but ``reference``."""
        if split == "reference":
            return []
        frame, agent = np.divmod(np.arange(180), 3)
        xy = np.stack([agent + 1.0 if self.stands else 0.5 * frame, agent + 1.0], axis=1)
        xy += np.random.default_rng(0).normal(0, 1, xy.shape) * self.jitter
        return [mg.Recording(frame, agent, xy, self.dt)]

    def sources(self):
        """Walkers."""
        return [Walks(stands=False)]


def test_scenes_that_look_alike_are_learned_from_each():
    """Noise of a tenth of a millimetre makes scenes look different, but hardly changes scores."""
    source = mg.predictor("linear").fit([Walks(False).windows("train")], [Walks(False).windows("train")], 0)
    cards = [evaluate_online(catalog.adapter("kalman", source), Walks(jitter=jitter)) for jitter in (0.0, 1e-4)]
    assert cards[0].updates == cards[1].updates > 20
    assert cards[0].ade.mean == pytest.approx(cards[1].ade.mean, abs=0.005)


ADAPTERS = [
    "none",
    "style",
    "kalman",
    "hedge",
    "finetune:every=3",
    "ema_anchor:every=3",
    "ekf:every=3",
    "refine:steps=1",
]


@pytest.mark.parametrize("adapter", ADAPTERS)
def test_every_adapter_scores_in_the_environment_as_in_the_evaluator(adapter):
    source = "modular_invariant:weights=style"
    card = evaluate_online(catalog.adapter(adapter, source), CROWD)
    predictor, env = catalog.adapter(adapter, source), mg.parallel_env(CROWD, clock="stream")
    loop(predictor, env)
    # A few ulps: a batch may be of other scenes, and a matrix product rounds as it likes.
    np.testing.assert_allclose(ade(*env.ledger.matured_only()), card.values, atol=1e-5)
    assert getattr(predictor, "updates", card.updates) == card.updates


def loop(predictor, env):
    """The loop of the examples; the predictor learns from revealed ground truth."""
    observations, _ = env.reset()
    while env.agents:
        seen = mg.observation_from_dict(observations, env.domain.card.dt, env.agents, env.clock.time)
        actions = mg.forecast_to_dict(predictor.predict(seen), env.agents)
        observations, *_, infos = env.step(actions)
        truth = mg.truth_from_infos(infos, env.domain.card.dt)
        if truth is not None and env.agents:
            predictor.observe(truth)


def test_where_people_come_and_go_the_environment_tells_what_the_evaluator_tells():
    one, other = Taped(catalog.adapter("kalman", fitted_linear())), Taped(catalog.adapter("kalman", fitted_linear()))
    card, env = evaluate_online(one, STREET), mg.parallel_env(STREET, clock="stream")
    loop(other, env)
    for a, b in zip(one.tape.told, other.tape.told, strict=True):
        assert a[0] == b[0]
        for get in (lambda t: t.future, lambda t: t.known, lambda t: t.observation.agent, lambda t: t.observation.time):
            np.testing.assert_array_equal(get(a[1]), get(b[1]))
    np.testing.assert_allclose(ade(*env.ledger.matured_only()), card.values, atol=1e-9)


def test_a_style_is_read_from_the_scenes_of_the_loop():
    predictor, env = mg.predictor("modular:weights=style"), mg.parallel_env(CROWD, clock="stream")
    loop(predictor, env)
    assert predictor.scenes > 0


def folder(path, shift):
    path.mkdir()
    rows = [f"{10 * f} {a} {0.4 * f + shift} {a}" for f in range(60) for a in (1, 2)]
    (path / "walk.txt").write_text("\n".join(rows) + "\n")


class Folder(RecordedDomain):
    """The files of a folder."""

    name = "folder"

    def __init__(self, path: str = ""):
        self.path = path

    def recordings(self, split):
        """The same recording for all splits."""
        return [mg.read_recording(f"{self.path}/walk.txt", dt=0.4)]


def test_two_folders_are_two_places_and_one_folder_is_one(tmp_path, monkeypatch):
    folder(tmp_path / "a", 0.0), folder(tmp_path / "b", 9.0)
    monkeypatch.chdir(tmp_path)
    both = stream([Folder("a"), Folder("b")])
    assert [(part.start, part.stop) for part in both.segments] == [(0, 60), (0, 60)]
    assert Stream([Segment(Folder("a"), 0, 60), Segment(Folder("b"), 0, 60)]).ends.tolist() == [60, 120]
    with pytest.raises(SpecError, match="Two segments overlap: both play frames 0 to 60"):
        Stream([Segment(Folder("a"), 0, 60), Segment(Folder(str(tmp_path / "a")), 0, 60)])


def test_frames_that_are_no_multiple_are_said_to_be_cut_and_too_many_are_refused():
    place = Street(frames=137)
    with pytest.warns(UserWarning, match="`frames=130`: visits have a multiple of 20 frames, so 120 are played"):
        assert stream(place, frames=130).ends.tolist() == [120]
    with pytest.raises(SpecError, match=r"137 frames .* ask for at most 120"):
        stream(place, frames=300)


class Array:
    """Returns an array, not a Forecast."""

    def __init__(self, pace: float = 1.0):
        self.pace = pace

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, None, -1:] * self.pace, 12, axis=2)


class Needs(Bias):
    """An adapter that relies on a Forecast."""

    def plain(self, observation):
        return self.inner.predict(observation).positions[:, 0].astype(np.float64)


def test_an_adapter_is_given_forecasts_also_of_a_predictor_that_returns_arrays():
    adapted = catalog.adapter(Needs, Array(1.1))
    assert adapted.inner.pace == 1.1 and adapted.inner.name == "Array(pace=1.1)"
    card = evaluate_online(adapted, STREET, scope="place")
    assert card.updates > 0
    np.testing.assert_array_equal(card.values, evaluate_online(catalog.adapter(Bias, Array(1.1)), STREET).values)
