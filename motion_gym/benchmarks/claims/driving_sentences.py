"""The claims of the documentation about driving with forecasts, with their tests; see ``sentences``."""

from __future__ import annotations

from collections.abc import Mapping

from motion_gym.benchmarks.claims.claim_tests import Test, lower, mean
from motion_gym.benchmarks.objects import NOWHERE
from motion_gym.benchmarks.reports.drive_tables import ALL

_SAID = {"react": "where the others react", "replay": "where the others drive as recorded"}


def _claims(others: str, said: str) -> Mapping[str, Test]:
    return {
        f"A planner drives better with constant velocity than without a forecast, {said}": lower(
            ["constant_velocity"], ["stand_still"], [ALL], panel=others
        ),
        f"A planner drives worse with STGAT, trained on straight roads, than without a forecast, {said}": lower(
            ["stand_still"], ["erm_no_sigma"], [ALL], panel=others
        ),
        f"An oracle takes at most a tenth off what the planner loses with constant velocity, {said}": mean(
            ["oracle"], ["constant_velocity"], [ALL], panel=others, ratio=(0.9, 1.0)
        ),
        f"With a turn rate the planner drives no better than with constant velocity, {said}": lower(
            ["constant_turn"], ["constant_velocity"], [ALL], panel=others, where=NOWHERE
        ),
        f"A Kalman last layer that learns while it drives is not significantly better than linear, {said}": lower(
            ["kalman:of=linear"], ["linear"], [ALL], panel=others, where=NOWHERE
        ),
    }


DRIVING: Mapping[str, Test] = {
    sentence: test for others, said in _SAID.items() for sentence, test in _claims(others, said).items()
}
