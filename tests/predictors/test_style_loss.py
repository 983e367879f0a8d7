"""The style contrastive loss."""

import math

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from motion_gym.contract import PredictorError
from motion_gym.predictors.training.style_loss import TEMPERATURE, style_loss


def by_loops(embedding, environment):
    """The loss by its definition."""
    total = 0.0
    for i, anchor in enumerate(environment):
        likes = np.exp(embedding @ embedding[i] / TEMPERATURE)
        positives = [j for j, e in enumerate(environment) if e == anchor and j != i]
        terms = []
        for j in positives:
            others = [k for k in range(len(environment)) if k != i]
            terms.append(-math.log(likes[j] / sum(likes[k] for k in others)))
        total += sum(terms) / len(terms)
    return total / len(environment)


@settings(max_examples=30, deadline=None)
@given(arrays.arrays(np.float64, (2, 7, 8), elements=st.floats(-1, 1)))
def test_the_loss_equals_its_definition(drawn):
    embedding = torch.nn.functional.normalize(torch.from_numpy(drawn + 1e-3), dim=-1)
    environment = [0, 1, 0, 1, 2, 2, 2]
    loss = style_loss(embedding, torch.tensor(environment))
    expected = [by_loops(e.numpy(), environment) for e in embedding]
    np.testing.assert_allclose(loss.numpy(), expected, rtol=1e-9)


def test_the_loss_of_separated_codes_is_the_logarithm_of_the_number_of_positives():
    corners = torch.eye(8)[:2].repeat_interleave(5, dim=0)[None]
    environment = torch.tensor([0] * 5 + [1] * 5)
    assert style_loss(corners, environment).item() == pytest.approx(math.log(4), rel=1e-4)


def test_one_environment_is_refused():
    with pytest.raises(PredictorError, match="scenes of at least two"):
        style_loss(torch.ones(1, 3, 8), torch.zeros(3, dtype=torch.int64))
