"""Training: several seeds in one pass, selection, seeds, and training sets."""

import functools

import numpy as np
import pytest
import torch

from motion_gym.contract import PredictorError, SpecError
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.networks import kernels
from motion_gym.predictors.stgat import Erm, GroupDro, Invariant, VRex
from motion_gym.predictors.training.stgat_training import StgatProgram
from motion_gym.training import loop as training

EPOCHS = (1, 1, 3)
CPU = torch.device("cpu")
ErmNoSigma = functools.partial(Erm, sigma=False)
Counterfactual = functools.partial(Erm, counterfactual=True)


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


@pytest.mark.parametrize("seed", [[], [1, 1], None, "0", -1])
def test_invalid_seeds_are_refused(data, seed):
    with pytest.raises(SpecError, match="seed"):
        Erm().fit(*data, seed, epochs=EPOCHS)
    assert Erm().fit(*data, np.int64(3), epochs=(1, 0, 1)).card["seeds"] == [3]


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
    seen = np.concatenate([batch.steps.numpy()[1, :, 0] for batch in program.in_turn])
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
