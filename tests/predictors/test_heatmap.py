"""Heat maps of goals and paths: equivariance, the ground, samples, training, and transfer."""

import dataclasses

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_gym as mg
from motion_gym.checks.leaks import leak_probe
from motion_gym.checks.predictor_trials import synthetic
from motion_gym.contract import PredictorError, SpecError
from motion_gym.data.domains import training_set
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import score
from motion_gym.predictors.heatmap import Heatmap
from motion_gym.predictors.networks.ego_crops import CELLS, COARSE, crops_of, gaussians, mean_place
from motion_gym.predictors.networks.goal_samples import spread_goals
from motion_gym.predictors.networks.last_layer import tunable
from motion_gym.predictors.training.heatmap_training import PARTS
from tests.crowd_with_sigma import CrowdWithSigma
from tests.probed import assert_nothing_leaks
from tests.walkers import crowd

DOMAIN = mg.domain("orca", scenes=24)


def few(scenes):
    """Training and validation sets of some scenes of each source."""
    return [[pick_scenes(truth, slice(0, scenes)) for truth in truths] for truths in training_set(DOMAIN)]


@pytest.fixture(scope="module")
def trained():
    return Heatmap().fit(*few(4), [0, 1], epochs=(1,), batch=8)


def ground(side, labels):
    """An image of the ground with labels [side, side] of cells of one metre, around the origin."""
    photo = np.zeros((side, side, 3), np.uint8)
    return SceneImage(photo, np.full(2, -side / 2), np.ones(2), np.asarray(labels, np.uint8))


@settings(max_examples=15, deadline=None)
@given(
    angle=st.floats(-3, 3),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    unit=st.floats(0.05, 50),
    agents=st.integers(1, 5),
    seed=st.integers(0, 9),
)
def test_forecasts_move_turn_and_scale_with_the_scene(trained, angle, shift, unit, agents, seed):
    turn = unit * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    seen = crowd(agents, seed)
    moved = dataclasses.replace(seen, history=(seen.history @ turn + shift).astype(np.float32))
    expected = trained.predict(seen).positions @ turn + shift
    np.testing.assert_allclose(trained.predict(moved).positions, expected, atol=0.02 * unit)


def test_agents_are_independent_and_one_who_never_moved_stands_still(trained):
    seen = crowd(4)
    history = seen.history.copy()
    history[2] = history[2, :1]
    both = trained.predict(dataclasses.replace(seen, history=history), 5)
    alone = mg.Observation(history[:1], np.array([0, 1]), seen.agent[:1], seen.dt)
    np.testing.assert_allclose(trained.predict(alone).positions[0], both.positions[0, :1], atol=1e-4)
    assert (both.positions[2] == history[2, -1]).all()


def test_the_ground_is_read_in_the_frame_of_the_agent():
    east = np.float32([[[x, 0.0] for x in range(8)], [[7.0, y - 7.0] for y in range(8)]])
    labels = np.ones((200, 200), int)
    labels[:100] = 3  # y below 0
    seen = mg.Observation(east, np.array([0, 2]), np.arange(2), 0.4, images=(ground(200, labels),))
    read = crops_of(seen).labels
    # To the right of who walks along x, behind who walks along y.
    assert (read[0, : COARSE // 2] == 3).all() and (read[0, COARSE // 2 :] == 1).all()
    assert (read[1, :, : COARSE // 2] == 3).all() and (read[1, :, COARSE // 2 :] == 1).all()
    small = crops_of(dataclasses.replace(seen, images=(ground(2, [[1, 1], [1, 1]]),))).labels
    assert (small == 0).mean() > 0.9 and small.any()  # nothing is known outside of the image
    assert not crops_of(dataclasses.replace(seen, images=None)).labels.any()


def test_the_ground_changes_forecasts(trained):
    seen = crowd(3)
    labels = np.random.default_rng(0).integers(1, 6, (80, 80))
    on_ground = dataclasses.replace(seen, images=(ground(80, labels),))
    assert np.abs(trained.predict(on_ground).positions - trained.predict(seen).positions).max() > 1e-3


@pytest.mark.parametrize("cells", [CELLS, COARSE])
def test_mean_places_have_no_error_of_quantisation(cells):
    places = torch.rand(200, 2, generator=torch.Generator().manual_seed(0)) * 1.6 - 0.8
    nearest = (torch.floor((places + 1) * cells / 2) + 0.5) * (2 / cells) - 1
    maps = gaussians(places, cells).clamp(min=1e-30).log()
    assert (mean_place(maps) - places).norm(dim=-1).max() * cells / 2 < 0.02
    assert (nearest - places).norm(dim=-1).mean() * cells / 2 == pytest.approx(0.38, abs=0.03)


def test_goals_are_spread_over_a_map_and_depend_on_the_seed():
    places = torch.tensor([[-0.5, 0.5], [0.5, 0.5], [0.0, -0.5]])
    logits = gaussians(places, CELLS).sum(dim=0).add(1e-12).log().double().numpy()[None]
    one, other = (spread_goals(logits, np.arange(1, 21, dtype=np.uint64)[None] + seed) for seed in (0, 99))
    distance = np.linalg.norm(one[0, :, None] - places.numpy(), axis=-1)
    assert (distance.min(axis=1) < 0.15).all() and len(set(distance.argmin(axis=1))) == 3
    assert not np.array_equal(one, other)


def test_the_first_sample_is_the_forecast_and_a_seed_gives_the_same_samples(trained):
    seen = crowd(3)
    one, many, again = (trained.predict(seen, k, seed=4).positions for k in (1, 4, 4))
    np.testing.assert_allclose(many[:, :1], one, atol=1e-5)
    np.testing.assert_array_equal(many, again)


def test_weights_of_drone_video_have_a_lower_error_than_constant_velocity(sdd):
    predictor = Heatmap()
    if not predictor.fitted:
        pytest.skip("the weights `sdd` are not here: motion-gym weights add --from DIR")
    truth = pick_scenes(mg.domain("sdd:speed=3.25-3.75,image=true,background=labels").windows("test"), slice(0, 60))
    errors = score(predictor.predict(truth.observation, 20), truth, 20)
    straight = score(mg.predictor("constant_velocity").predict(truth.observation), truth)
    assert errors["ADE"].mean() < 0.95 * straight["ADE"].mean()
    assert errors["minADE_20"].mean() < 0.6 * errors["ADE"].mean()


def test_training_lowers_the_error_and_is_resumed_bit_for_bit(tmp_path, trained):
    parts = few(2)
    whole = Heatmap().fit(*parts, 0, epochs=(3,), batch=8)
    stopped = []

    def stop(progress):
        stopped.append(progress.epoch)
        if progress.epoch == 2:
            raise KeyboardInterrupt

    options = {"epochs": (3,), "batch": 8, "checkpoint": tmp_path / "x.checkpoint", "every": 1}
    with pytest.raises(KeyboardInterrupt):
        Heatmap().fit(*parts, 0, report=stop, **options)
    resumed = Heatmap().fit(*parts, 0, resume=True, **options)
    assert stopped == [1, 2] and all(torch.equal(whole.stacked[name], value) for name, value in resumed.stacked.items())
    assert whole.card["curve"][-1]["loss"] < whole.card["curve"][0]["loss"]
    assert trained.card["seeds"] == [0, 1] and len(trained.card["validation_ade"]) == 2


def test_unsuitable_training_is_refused():
    data = few(1)
    for option in ({"batch": 0}, {"angle": -1}, {"stretch": "wide"}, {"epochs": (1, 2)}):
        with pytest.raises(SpecError, match=next(iter(option))):
            Heatmap().fit(*data, 0, **option)


def test_it_looks_at_no_future(trained):
    assert_nothing_leaks(leak_probe(trained, CrowdWithSigma(scenes=4), clock="windows", cuts=1))


def test_offsets_and_the_last_layer_are_those_of_the_forecast(trained):
    seen = synthetic((1, 2, 3), 2, 4).observation
    forecast = trained.predict(seen).positions[:, 0]
    with torch.no_grad():
        offsets = trained.offsets(seen, trained.stacked)
    assert len(offsets) == 2  # both models
    np.testing.assert_allclose(offsets[0].numpy() + seen.xy[:, -1:], forecast, atol=1e-4)
    layer = trained.last_layer(seen)
    np.testing.assert_allclose(layer.positions(layer.inputs @ layer.weight), forecast, atol=1e-4)
    np.testing.assert_allclose(layer.positions(layer.outputs(forecast)), forecast, atol=1e-5)


@pytest.mark.parametrize("parts", PARTS)
def test_a_transfer_tunes_one_part_alone(trained, parts):
    target = pick_scenes(mg.domain("orca:d=0.7,scenes=24").windows("train"), slice(0, 8))
    predictor = mg.predictor("transfer", of=trained, parts=parts, epochs=2, rate=1e-3)
    before = {name: value.clone() for name, value in trained.stacked.items()}
    predictor.tune(target)
    changed = {name for name, value in predictor.inner.stacked.items() if not torch.equal(value, before[name])}
    assert changed == set(tunable(trained, parts)) and not hasattr(predictor, "observe")
    assert all(torch.equal(before[name], value) for name, value in trained.stacked.items())


@pytest.mark.parametrize("name", ["kalman", "hedge", "finetune:parts=low_rank", "ekf:parts=last_layer"])
def test_adapters_learn_from_scenes(trained, name):
    adapter = mg.adapter(name, trained)
    truth = pick_scenes(mg.domain("orca:d=0.7,scenes=24").windows("train"), slice(0, 4))
    before = adapter.predict(truth.observation).positions
    adapter.observe(truth)
    assert adapter.updates == 1 and np.abs(adapter.predict(truth.observation).positions - before).max() > 1e-6


def test_parts_that_a_predictor_does_not_have_are_refused(trained):
    with pytest.raises(SpecError, match="`parts=style` of transfer of heatmap"):
        mg.predictor("transfer", of=trained, parts="style")
    with pytest.raises(PredictorError, match="has no part `style`"):
        mg.adapter("finetune:parts=style", trained)
