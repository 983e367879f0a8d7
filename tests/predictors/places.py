"""Real places and mean errors for the tests of predictors."""

import pytest

import motion_gym
from motion_gym.contract import DataError
from motion_gym.metrics import errors as metrics


def place(name, **parameters):
    domain = motion_gym.domain(name, **parameters)
    try:
        domain.windows("test")
    except DataError as error:
        pytest.skip(f"no data: {error}")
    return domain


def ade_fde(predictor, truth):
    values = metrics.score(motion_gym.Forecast(predictor.predict(truth.observation).positions), truth)
    return values["ADE"].mean(), values["FDE"].mean()
