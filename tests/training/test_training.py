"""Training: several seeds in one pass, selection, seeds, and training sets."""

import dataclasses
import errno
import functools
import os

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.contract import PredictorError, SpecError, Truth
from motion_gym.data.domains import training_set
from motion_gym.data.storage import StorageError
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.ego import EgoModular
from motion_gym.predictors.networks import kernels
from motion_gym.predictors.stgat import Erm, GroupDro, Invariant, VRex
from motion_gym.predictors.training import objectives
from motion_gym.predictors.training.stgat_training import StgatProgram
from motion_gym.training import loop as training

EPOCHS = (1, 1, 3)
CPU = torch.device("cpu")
ErmNoSigma = functools.partial(Erm, sigma=False)
Counterfactual = functools.partial(Erm, counterfactual=True)


@pytest.fixture(scope="module")
def data():
    """Two environments of crossing agents, with a third feature."""

    def with_feature(truth: Truth, scale: float) -> Truth:
        seen = truth.observation
        speed = np.linalg.norm(np.diff(seen.xy, axis=1, prepend=seen.xy[:, :1]), axis=-1, keepdims=True)
        history = np.concatenate([seen.history, scale * (1 + speed)], axis=2).astype(np.float32)
        return dataclasses.replace(truth, observation=dataclasses.replace(seen, history=history))

    train, validation = training_set(mg.domain("orca", scenes=80))
    return [
        [with_feature(pick_scenes(t, slice(0, 70)), i + 1.0) for i, t in enumerate(part)]
        for part in (train, validation)
    ]


def same(a, b):
    """Whether two predictors have the same weights, bit for bit."""
    return all(torch.equal(a.stacked[name], b.stacked[name]) for name in a.stacked)


class Killed(Exception):
    """Simulates the end of a process."""


def kill_after(epoch):
    """A report function that ends the training."""

    def report(progress):
        if progress.epoch == epoch:
            raise Killed

    return report


@pytest.mark.parametrize("kind", [Erm, ErmNoSigma, Invariant, VRex, GroupDro])
def test_a_killed_training_resumes_to_the_same_weights(data, kind, tmp_path):
    whole = kind().fit(*data, [0, 1], epochs=EPOCHS)
    checkpoint = tmp_path / "a.checkpoint"
    with pytest.raises(Killed):
        kind().fit(*data, [0, 1], epochs=EPOCHS, checkpoint=checkpoint, every=2, report=kill_after(4))
    seen = []
    resumed = kind().fit(*data, [0, 1], epochs=EPOCHS, checkpoint=checkpoint, every=2, resume=True, report=seen.append)
    # Killed after the fourth epoch; the last checkpoint is that of the second.
    assert [progress.epoch for progress in seen] == [3, 4, 5]
    assert same(whole, resumed)
    assert whole.card["validation_ade"] == resumed.card["validation_ade"]


def test_a_finished_training_can_be_continued(data, tmp_path):
    checkpoint = tmp_path / "a.checkpoint"
    GroupDro().fit(*data, [0, 1], epochs=(1, 1, 2), checkpoint=checkpoint)
    longer = GroupDro().fit(*data, [0, 1], epochs=(1, 1, 3), checkpoint=checkpoint, resume=True)
    assert same(longer, GroupDro().fit(*data, [0, 1], epochs=(1, 1, 3)))
    with pytest.raises(SpecError, match="has 5 epochs, more than the 4 asked for"):
        GroupDro().fit(*data, [0, 1], epochs=(1, 1, 2), checkpoint=checkpoint, resume=True)


def test_every_stage_resets_the_state_of_the_objective(data):
    predictor = GroupDro(rate=0.5)
    program = StgatProgram(predictor, *data, device=CPU, epochs=(2, 1, 2), joint=True)
    starts = []
    program.state = lambda models: starts.append(models) or StgatProgram.state(program, models)
    run = training.Run(program, [0], torch.device("cpu"))
    states = []
    for _ in range(5):
        run.step()
        states.append(run.state.clone())
    assert len(starts) == 1 + 3
    assert all((state - 1 / 3).abs().max() > 1e-3 for state in states)
    assert len({id(run.state)}) == 1 and torch.allclose(states[0].sum(dim=0), torch.ones(1))


def test_seeds_are_independent(data):
    together = Erm().fit(*data, [3, 4], epochs=(1, 1, 1))
    alone = Erm().fit(*data, 4, epochs=(1, 1, 1))
    # Sums of other shapes are rounded differently, and training amplifies the differences.
    distance = [
        torch.cat(
            [(alone.stacked[k][0] - value[model]).abs().flatten() for k, value in together.stacked.items()]
        ).mean()
        for model in (0, 1)
    ]
    assert distance[1] < 0.02 * distance[0]
    assert distance[0] > 0.01


def test_the_weights_of_the_best_epoch_are_selected(data):
    predictor = Erm().fit(*data, [0, 1, 2], epochs=(1, 1, 4))
    scores = np.array([entry["score"] for entry in predictor.card["curve"] if "score" in entry])
    assert scores.shape == (4, 3)
    # The card has the error of the saved weights, which are rounded to half precision (10 bits).
    np.testing.assert_allclose(predictor.card["validation_ade"], scores.min(axis=0), rtol=2e-3)
    assert predictor.card["epoch"] == [int(e) + 3 for e in scores.argmin(axis=0)]


def test_training_lowers_the_error(data):
    predictor = Erm(sigma=False).fit(*data, [0, 1], epochs=(2, 2, 8))
    scores = [np.mean(entry["score"]) for entry in predictor.card["curve"] if "score" in entry]
    assert min(scores) < 0.8 * scores[0]


def test_saved_seeds_can_be_loaded(data, tmp_path):
    predictor = VRex(penalty=3).fit(*data, [5, 7], epochs=(1, 0, 1))
    path = tmp_path / "vrex.safetensors"
    predictor.save(path)
    seen = data[1][0].observation
    first, second = (VRex(path, seed=s, penalty=3).predict(seen).positions for s in (5, 7))
    np.testing.assert_array_equal(first, predictor.predict(seen).positions)
    assert np.abs(first - second).max() > 1e-3
    with pytest.raises(PredictorError, match=r"no seed 6: \[5, 7\] of 2 are there"):
        VRex(path, seed=6, penalty=3)
    with pytest.raises(PredictorError, match="weights of vrex:penalty=3, not of vrex"):
        VRex(path)
    with pytest.raises(SpecError, match=r"uses seed 9, but the seeds to train are \[0\]"):
        Erm(seed=9).fit(*data, epochs=EPOCHS)
    with pytest.raises(PredictorError, match="weights of vrex:penalty=3, not of erm_no_sigma"):
        Erm(path, sigma=False)


def test_a_checkpoint_of_another_configuration_is_refused(data, tmp_path):
    checkpoint = tmp_path / "a.checkpoint"
    with pytest.raises(Killed):
        Erm().fit(*data, 0, epochs=EPOCHS, checkpoint=checkpoint, every=1, report=kill_after(2))
    with pytest.raises(SpecError, match=r"another configuration.*seeds: \[0\], now \[1\]"):
        Erm().fit(*data, 1, epochs=EPOCHS, checkpoint=checkpoint, resume=True)
    with pytest.raises(SpecError, match=r"another configuration.*predictor"):
        Invariant().fit(*data, 0, epochs=EPOCHS, checkpoint=checkpoint, resume=True)
    checkpoint.write_bytes(checkpoint.read_bytes()[:1000])
    with pytest.raises(SpecError, match="is no checkpoint, or is damaged"):
        Erm().fit(*data, 0, epochs=EPOCHS, checkpoint=checkpoint, resume=True)


def test_a_loss_that_is_not_finite_stops_the_training_and_keeps_the_checkpoint(data, tmp_path):
    class Breaking(Erm):
        """Its objective gives NaN for the second model once the third epoch is reached."""

        def fit(self, *args, report, **options):
            self.epoch = 0

            def count(progress):
                self.epoch = progress.epoch
                report(progress)

            return super().fit(*args, report=count, **options)

        @property
        def objective(self):
            plain = super().objective

            class Nan(type(plain)):
                def __call__(inner, risks, state):
                    loss = plain(risks, state)
                    return loss * torch.tensor([1.0, float("nan") if self.epoch >= 2 else 1.0])

            return Nan()

    checkpoint = tmp_path / "a.checkpoint"
    with pytest.raises(PredictorError, match=r"loss of seed 9 is nan in epoch 3 \(forecast\), step 1"):
        Breaking().fit(*data, [8, 9], epochs=EPOCHS, checkpoint=checkpoint, every=1, report=lambda p: None)
    content = torch.load(checkpoint, weights_only=True)
    assert content["epoch"] == 2
    assert all(torch.isfinite(value).all() for value in content["weights"].values())


def test_weights_that_are_not_finite_stop_the_training_and_keep_the_checkpoint(data, tmp_path):
    class Rooted(Erm):
        """Its objective has the finite value 0, and a gradient that is not finite, in the second epoch."""

        @property
        def objective(self):
            class Root(objectives.Erm):
                steps = 0

                def __call__(self, risks, state):
                    loss = super().__call__(risks, state)
                    self.steps += 1
                    return loss if self.steps != 12 else (loss - loss.detach()).sqrt()

            return Root()

    checkpoint = tmp_path / "a.checkpoint"
    with pytest.raises(PredictorError, match=r"The weight \S+ of seed 8 is nan in epoch 2"):
        Rooted().fit(*data, 8, epochs=EPOCHS, checkpoint=checkpoint, every=1)
    content = torch.load(checkpoint, weights_only=True)
    assert content["epoch"] == 1
    assert all(torch.isfinite(value).all() for value in content["weights"].values())


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("weights", {}),
        ("best", None),
        ("epoch", -5),
        ("score", torch.zeros(9)),
        ("score", torch.tensor([torch.nan])),
        ("adam", {}),
    ],
)
def test_a_checkpoint_with_damaged_content_is_refused(data, tmp_path, key, value):
    checkpoint = tmp_path / "a.checkpoint"
    Erm().fit(*data, 0, epochs=(1, 0, 1), checkpoint=checkpoint)
    content = torch.load(checkpoint, weights_only=True)
    torch.save({**content, key: value}, checkpoint)
    with pytest.raises(SpecError, match="is no checkpoint, or is damaged"):
        Erm().fit(*data, 0, epochs=(1, 0, 2), checkpoint=checkpoint, resume=True)
    checkpoint.write_bytes(b"")
    with pytest.raises(SpecError, match="is no checkpoint, or is damaged"):
        Erm().fit(*data, 0, epochs=(1, 0, 2), checkpoint=checkpoint, resume=True)


def test_rates_that_decay_are_part_of_the_configuration(data, tmp_path):
    checkpoint, seen = tmp_path / "a.checkpoint", []
    whole = EgoModular().fit(*data, [0, 1], epochs=(4,), agents=64)
    with pytest.raises(Killed):
        EgoModular().fit(*data, [0, 1], epochs=(4,), agents=64, checkpoint=checkpoint, every=1, report=kill_after(3))
    with pytest.raises(SpecError, match=r"decay_over: \[4\], now \[5\]"):
        EgoModular().fit(*data, [0, 1], epochs=(5,), agents=64, checkpoint=checkpoint, resume=True)
    options = {"agents": 64, "checkpoint": checkpoint, "resume": True, "report": seen.append}
    assert same(EgoModular().fit(*data, [0, 1], epochs=(4,), **options), whole) and len(seen) == 2


@pytest.mark.parametrize("seed", [[], [1, 1], None, "0", -1])
def test_invalid_seeds_are_refused(data, seed):
    with pytest.raises(SpecError, match="seed"):
        Erm().fit(*data, seed, epochs=EPOCHS)
    assert Erm().fit(*data, np.int64(3), epochs=(1, 0, 1)).card["seeds"] == [3]


def test_a_validation_score_that_is_not_finite_stops_the_training(data):
    broken = [dataclasses.replace(truth, future=truth.future.copy()) for truth in data[1]]
    broken[0].future[3, 5, 0] = np.nan
    with pytest.raises(PredictorError, match=r"validation score of seed 0 is nan in epoch 3 \(forecast\)"):
        Erm().fit(data[0], broken, epochs=EPOCHS)


def test_an_empty_training_set_is_refused(data):
    empty = [pick_scenes(truth, []) for truth in data[0]]
    with pytest.raises(PredictorError, match="training set is empty"):
        Erm().fit(empty, data[1])
    with pytest.raises(PredictorError, match="training set is empty"):
        Erm().fit([], data[1])
    with pytest.raises(PredictorError, match="validation set is empty"):
        Erm().fit(data[0], [])


@pytest.mark.parametrize("kind", [Invariant, VRex, GroupDro])
def test_objectives_that_compare_environments_refuse_one_environment(data, kind):
    with pytest.raises(PredictorError, match=r"compares environments.*one alone"):
        kind().fit(data[0][:1], data[1], epochs=EPOCHS)


def test_one_environment_is_enough_for_erm(data):
    assert Erm().fit(data[0][:1], data[1], epochs=(1, 0, 1)).card["validation_ade"][0] < 10


def test_a_missing_cuda_device_is_refused(data):
    if torch.cuda.is_available():
        pytest.skip("there is a CUDA device")
    with pytest.raises(SpecError, match="finds no CUDA device"):
        Erm().fit(*data, device="cuda")


def test_a_full_disk_keeps_the_last_checkpoint(data, tmp_path, monkeypatch):
    checkpoint = tmp_path / "a.checkpoint"
    written = os.fsync
    calls = []

    def full(descriptor):
        calls.append(1)
        if len(calls) > 1:
            raise OSError(errno.ENOSPC, "No space left on device")
        written(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="No space left on device"):
        Erm().fit(*data, 0, epochs=EPOCHS, checkpoint=checkpoint, every=1)
    assert torch.load(checkpoint, weights_only=True)["epoch"] == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.checkpoint"]


@pytest.mark.parametrize("stage", [0, 1, 2])
@pytest.mark.parametrize("kind", [Counterfactual, GroupDro])
def test_plain_operations_of_torch_give_the_same_gradients(data, kind, stage, monkeypatch):
    """Compares the operations for GPUs with the kernels, on the CPU."""
    predictor = kind()
    program = predictor.program(predictor, *data, device=CPU, joint=True)

    def gradients():
        weights = {name: value.requires_grad_() for name, value in program.initial([0, 1]).items()}
        generators = [torch.Generator().manual_seed(seed) for seed in (0, 1)]
        loss = next(program.losses(weights, program.state(2), stage, generators, 0))
        slopes = torch.autograd.grad(loss.sum(), list(weights.values()), allow_unused=True)
        return loss.detach(), torch.cat([slope.flatten() for slope in slopes if slope is not None])

    loss, by_kernels = gradients()
    monkeypatch.setattr(kernels, "serve", lambda x: False)
    expected, plainly = gradients()
    # Single-precision sums in another order, over 20 steps and divisions by standard deviations near zero.
    torch.testing.assert_close(loss, expected, rtol=1e-4, atol=0)
    assert float((by_kernels - plainly).norm()) < 1e-3 * float(plainly.norm())


def test_a_card_has_the_error_of_the_saved_weights(data):
    predictor = ErmNoSigma().fit(*data, [0, 3], epochs=(1, 1, 2))
    program = predictor.program(predictor, *data, device=CPU, epochs=(1, 1, 2))
    generators = [
        training._generator(s, e - 1, training.VALIDATION, torch.device("cpu"))
        for s, e in zip((0, 3), predictor.card["epoch"], strict=True)
    ]
    with torch.no_grad():
        scores = program.validate(predictor.stacked, generators)
    assert predictor.card["validation_ade"] == [round(score, 4) for score in scores.tolist()]
    assert all(torch.equal(value, value.half().float()) for value in predictor.stacked.values())


def test_steps_of_one_environment_hold_every_scene_once(data):
    program = StgatProgram(Erm(), *data, device=CPU, scenes=10)
    seen = np.concatenate([batch.steps.numpy()[1, :, 0] for batch in program._in_turn()])
    every = np.concatenate([truth.observation.xy[:, 1, 0] - truth.observation.xy[:, 0, 0] for truth in data[0]])
    np.testing.assert_allclose(seen, every, atol=1e-4)


def test_joint_steps_hold_every_environment(data):
    uneven = [[pick_scenes(data[0][0], slice(0, 12)), *data[0][1:]], data[1]]
    program = StgatProgram(Erm(), *uneven, device=CPU, scenes=12, joint=True)
    assert len(list(program._shuffled(0))) == 13
    for step in program._shuffled(1):
        assert [len(scenes) for _, scenes in step] == [4, 4, 4]
    first, again, other = (np.concatenate([s for step in program._shuffled(e) for _, s in step]) for e in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
