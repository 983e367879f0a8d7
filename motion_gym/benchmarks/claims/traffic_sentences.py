"""The claims of the documentation about vehicles."""

from __future__ import annotations

from collections.abc import Mapping

from motion_gym.benchmarks.claims.claim_tests import Test, lower, mean
from motion_gym.benchmarks.definitions.traffic import MOTION, STYLES
from motion_gym.benchmarks.objects import NOWHERE

WITHOUT_NETWORK = (*MOTION, "linear")
KNOWN_ROADS = (*STYLES, "left side", "merge")

VEHICLES: Mapping[str, Test] = {
    "In traffic kalman_residual has a lower error than every row without a network for each driving style, on the "
    "other side of the road and at a merge": lower(["kalman_residual"], WITHOUT_NETWORK, KNOWN_ROADS),
    "With styles of training, kalman_residual takes half or more off the error of constant velocity": mean(
        ["kalman_residual"], ["constant_velocity"], STYLES[:-1], ratio=(0, 0.5)
    ),
    "On roads with bends and crossings, which were not trained on, it does not": mean(
        ["kalman_residual"], ["constant_velocity"], ["roundabout", "intersection"], where=NOWHERE
    ),
    "STGAT, which sees the axes of the world, has a higher error than constant velocity for aggressive drivers, at "
    "a roundabout and at an intersection": lower(
        ["constant_velocity"], ["erm_no_sigma"], ["aggressive", "roundabout", "intersection"]
    ),
    "At a roundabout and an intersection its error is nine times that of constant velocity or more": mean(
        ["constant_velocity"], ["erm_no_sigma"], ["roundabout", "intersection"], ratio=(0, 0.112)
    ),
    "STGAT with a style has a lower mean error than without for every driving style": mean(
        ["modular_stgat"], ["erm_no_sigma"], STYLES
    ),
    "STGAT with a style has no lower mean error than linear on any road": mean(
        ["modular_stgat"], ["linear"], where=NOWHERE
    ),
    "The networks in the frame of each agent have no lower mean error than linear in traffic": mean(
        ["ego_erm", "ego_modular"], ["linear"], where=NOWHERE
    ),
}
