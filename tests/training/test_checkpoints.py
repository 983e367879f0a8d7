"""Checkpoints: killed and continued trainings, and errors that stop a training."""

import dataclasses
import errno
import functools
import os

import numpy as np
import pytest
import torch

from motion_gym.contract import PredictorError, SpecError
from motion_gym.data.storage import StorageError
from motion_gym.predictors.ego import EgoModular
from motion_gym.predictors.stgat import Erm, GroupDro, Invariant, VRex
from motion_gym.predictors.training import objectives

EPOCHS = (1, 1, 3)
ErmNoSigma = functools.partial(Erm, sigma=False)


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


def test_a_validation_score_that_is_not_finite_stops_the_training(data):
    broken = [dataclasses.replace(truth, future=truth.future.copy()) for truth in data[1]]
    broken[0].future[3, 5, 0] = np.nan
    with pytest.raises(PredictorError, match=r"validation score of seed 0 is nan in epoch 3 \(forecast\)"):
        Erm().fit(data[0], broken, epochs=EPOCHS)


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
