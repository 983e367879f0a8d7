"""The claims of the documentation about the forecaster for real places: where it is better, and where it is not."""

from __future__ import annotations

from collections.abc import Mapping

from motion_gym.benchmarks.claims.claim_tests import ANY, Test, lower, mean
from motion_gym.benchmarks.objects import NOT_EVERYWHERE

WALKING = ("stand", "0.5 m/s", "1.3 m/s", "two, 2 m apart", "two, 50 m apart", "six, 1 m apart")
FAST = ("3 m/s", "6 m/s")
"""Columns of the simulated walkers; those of several people are at 1.3 m/s."""

FORECASTER: Mapping[str, Test] = {
    "kalman_residual has a lower error than constant velocity at every place": lower(
        ["kalman_residual"], ["constant_velocity"], panel=""
    ),
    "kalman_residual has a lower error than kalman_velocity at every place": lower(
        ["kalman_residual"], ["kalman_velocity"], panel=""
    ),
    "erm_no_sigma has a higher mean error than constant velocity at every place but eth": mean(
        ["constant_velocity"], ["erm_no_sigma"], ["eth6", "hotel", "univ", "zara1", "zara2"], panel=""
    ),
}

ELSEWHERE: Mapping[str, Test] = {
    "On drone video kalman_residual does not have a lower error than constant velocity at every place": lower(
        ["kalman_residual"], ["constant_velocity"], where=NOT_EVERYWHERE
    ),
    "On drone video the error of kalman_residual is within 12 % of that of constant velocity at each place": mean(
        ["kalman_residual"], ["constant_velocity"], ratio=(0.88, 1.12)
    ),
    "Of people who walk straight on kalman_residual has a lower error than constant velocity up to 1.3 m/s": lower(
        ["kalman_residual"], ["constant_velocity"], WALKING, panel="1"
    ),
    "Of people who move straight on constant velocity has a lower error than kalman_residual at 3 or 6 m/s": lower(
        ["constant_velocity"], ["kalman_residual"], FAST, panel="1"
    ),
    "Of people who walk straight on STGAT has at least twice the error of constant velocity": mean(
        ["erm_no_sigma"], ["constant_velocity"], [*WALKING[1:], *FAST], panel="2", ratio=(2, ANY)
    ),
    "Trained on crowds, ego_erm is within 20 % of constant velocity for people who walk straight on": mean(
        ["ego_erm"], ["constant_velocity"], panel="3", ratio=(0.8, 1.2)
    ),
    "Trained on crowds, kalman_residual has ten times the error of constant velocity at 3 or 6 m/s or with noise": mean(
        ["kalman_residual"], ["constant_velocity"], [*FAST, "noise 0.1 m"], panel="3", ratio=(10, ANY)
    ),
    "Trained on crowds, kalman_residual has five times the error of constant velocity for two 50 m apart": mean(
        ["kalman_residual"], ["constant_velocity"], ["two, 50 m apart"], panel="3", ratio=(5, ANY)
    ),
}
