"""Scenes that a predictor observes or learns from must not be scored: this is refused, or declared on the card."""

import numpy as np
import pytest

import motion_gym
from motion_gym.contract import Recording, SpecError
from motion_gym.data.domains import RecordedDomain
from motion_gym.predictors.constant_velocity import ConstantVelocity
from motion_gym.scoring.evaluation import evaluate
from tests.street import Street


class Own(RecordedDomain):
    """A user's domain; ``frames`` gives the frames of its splits."""

    name = "own"
    frames = {"train": (0, 200), "val": (200, 300), "test": (300, 500), "reference": (500, 600)}  # noqa: RUF012

    def __init__(self, stride: int = 1, min_agents: int = 1):
        self.stride, self.min_agents = stride, min_agents

    def recordings(self, split):
        self.check_split(split)
        street = Street(frames=600).recordings("test")[0]
        first, last = self.frames[split]
        keep = (street.frame >= 10 * first) & (street.frame < 10 * last)
        return [Recording(street.frame[keep], street.agent[keep], street.xy[keep], 0.4, split)]

    def sources(self):
        return [self]


class Observing(ConstantVelocity):
    """Observes reference scenes and shots, and stores nothing."""

    def observe(self, truth):
        pass

    def reset(self):
        pass


def own(**frames):
    return type("Own", (Own,), {"frames": {**Own.frames, **frames}, "__module__": __name__})


def test_a_reference_that_is_the_test_recording_begun_a_frame_later_is_refused():
    later = own(reference=(301, 500))(stride=20)
    assert not {w.tobytes() for w in later.reference().future} & {w.tobytes() for w in later.windows("test").future}
    with pytest.raises(SpecError, match=r"scenes of split `reference`, and \d+ of their people are in split `test`"):
        evaluate(Observing(), later)
    assert evaluate(Observing(), Own(stride=20)).reference_scenes > 0


@pytest.mark.parametrize(("shown", "options"), [("train", {}), ("train", {"references": 0})])
def test_shots_that_are_scored_are_refused(shown, options):
    with pytest.raises(SpecError, match=rf"scenes of split `{shown}`.*cut the recordings of the two splits"):
        evaluate(Observing(), own(train=(299, 420))(), shots=2, **options)
    assert evaluate(Observing(), Own(), shots=2).shots == 2


def test_training_frames_that_are_scored_are_declared():
    declared = "the weights were trained on windows of own that are scored here"
    assert evaluate("linear", own(train=(300, 500))()).leaks == (declared,)
    assert evaluate("linear", own(val=(280, 340))()).leaks == (declared,)
    assert evaluate("linear", Own()).leaks == ()


class TrainedOn(ConstantVelocity):
    """Names the domains of its training and of the choice of its settings."""

    def __init__(self, trained_on=(), chosen_on=()):
        super().__init__()
        self.trained_on, self.chosen_on = trained_on, chosen_on


@pytest.mark.parametrize(
    ("domain", "trained", "named"),
    [
        ("eth", ("hotel", "eth6"), ("eth6",)),
        ("eth6", ("eth:alpha=8",), ("eth",)),
        ("eth", ("hotel", "univ", "zara1", "a place that is not known"), ()),
    ],
)
def test_another_domain_of_the_same_people_is_declared(eth_ucy, domain, trained, named):
    for attribute, did in (("trained_on", "weights were trained"), ("chosen_on", "settings were chosen")):
        leaks = evaluate(TrainedOn(**{attribute: trained}), domain, verify=False).leaks
        assert leaks == tuple(f"the {did} on windows of {name} that are scored here" for name in named)


def test_an_easier_half_is_seen_by_the_counts():
    whole, few = evaluate("constant_velocity", Own()), evaluate("constant_velocity", Own(stride=7, min_agents=2))
    recorded = whole.domain.counts["test"]["recorded_agent_windows"]
    assert f": {recorded} of the {recorded} agent-windows and " in whole.scored
    assert f": {few.ade.agent_windows} of the {recorded} agent-windows and " in few.scored
    assert few.ade.agent_windows < recorded / 5
    with pytest.raises(SpecError, match="must not define `windows`"):
        type("Easier", (Own,), {"windows": lambda self, split: None})


def test_the_draw_of_reference_scenes_is_part_of_the_interval():
    class Style(ConstantVelocity):
        """Its error depends on the reference scenes alone."""

        shift = 0.0

        def observe(self, truth):
            self.shift = float(truth.future.std()) / 3

        def predict(self, observation, samples=1, seed=0):
            return super().predict(observation).positions + np.float32(self.shift)

    place = Own()
    five, one = (evaluate(Style(), place, references=3, reference_draws=draws, verify=False) for draws in (5, 1))
    assert (five.reference_draws, one.reference_draws) == (5, 1) and five.reference_scenes == one.reference_scenes == 3
    assert five.ade.high - five.ade.low > 1.02 * (one.ade.high - one.ade.low)
    assert five.values["ADE"].shape == one.values["ADE"].shape
    assert five.ade.mean == pytest.approx(five.values["ADE"].mean())
    assert evaluate(Style(), place, verify=False).reference_draws == 1


def test_seeds_of_weights_are_named_and_pooled():
    pytest.importorskip("torch")
    place = motion_gym.domain("orca:d=0.3,scenes=20")
    one = evaluate("style_erm", place)
    pooled = evaluate("style_erm", place, seeds="all")
    assert one.weights_seed == 0 and "weights of seed 0" in str(one)
    assert list(pooled.cards) == [0, 1, 2, 3, 4] and pooled.cards[0].ade == one.ade
    means = [card.ade.mean for card in pooled.cards.values()]
    assert pooled.mean["ADE"] == pytest.approx(np.mean(means))
    assert pooled.standard_error["ADE"] == pytest.approx(np.std(means, ddof=1) / 5**0.5)
    assert "standard error over seeds 0, 1, 2, 3, 4" in str(pooled)
    assert list(evaluate("style_erm", place, seeds=[3]).cards) == [3]


def test_seeds_of_a_fit_are_numbers():
    assert list(evaluate("linear", Own(), seeds=[0, 7]).cards) == [0, 7]
    for wrong, message in (("all", "has no weights"), ("al", "write 'all'"), ([], "is empty")):
        with pytest.raises(SpecError, match=message):
            evaluate("linear", Own(), seeds=wrong)
    with pytest.raises(SpecError, match="by name or spec"):
        evaluate(Observing(), Own(), seeds=[0])


def test_the_predictor_of_the_caller_stays_as_it_was():
    class Counts(Observing):
        seen = 0

        def observe(self, truth):
            self.seen += 1

        def reset(self):
            self.seen = -1

    made = Counts()
    made.seen = 5
    evaluate(made, Own())
    assert made.seen == 5
