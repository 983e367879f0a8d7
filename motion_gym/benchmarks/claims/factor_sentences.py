"""Claims about style factors."""

from __future__ import annotations

from collections.abc import Mapping

from motion_gym.benchmarks.claims.claim_tests import Test, lower, mean
from motion_gym.benchmarks.definitions.factors import FACTORED, ONE_CODE
from motion_gym.benchmarks.studies.factor_studies import BOTH, OWN, WRONG_D, WRONG_SIDE

TARGETS = [f"{side} {d}" for side in ("left", "right") for d in (0.1, 0.3, 0.5)]
ERRORS, DISTANCES = ([f"{target}, {measure}" for target in TARGETS] for measure in ("ADE", "distance"))
SHARES = [f"{target}, right" for target in TARGETS[3:]]
WITHIN, LEVEL = (0.0, 1.1), (0.9, 1.1)
OWN_CODES, RIGHT, SIDE_WRONG, D_WRONG = (f"{FACTORED}, {case}" for case in (OWN, BOTH, WRONG_SIDE, WRONG_D))


def _on(circle: str, panel: str, study: str) -> dict[str, Test]:
    """Claims on one circle: the number of its part, and the study of swaps on it."""
    return {
        f"{circle} the unseen combinations are at most 10 % worse than their trained mirror images": mean(
            [FACTORED], columns=["unseen"], than_column="mirror images", panel=panel, ratio=WITHIN
        ),
        f"{circle} left 0.3 (unseen, d between trained ones) is at most 10 % worse than right 0.3": mean(
            [FACTORED], columns=["left 0.3"], than_column="right 0.3", panel=panel, ratio=WITHIN
        ),
        f"{circle} right 0.5 (unseen, d beyond trained ones) is at most 10 % worse than left 0.5": mean(
            [FACTORED], columns=["right 0.5"], than_column="left 0.5", panel=panel, ratio=WITHIN
        ),
        f"{circle} a network with one code is at most 10 % worse on the unseen combinations": mean(
            [ONE_CODE], columns=["unseen"], than_column="mirror images", panel=panel, ratio=WITHIN
        ),
        f"{circle} the split lowers the mean error on the combinations of training": mean(
            [FACTORED], [ONE_CODE], ["trained"], panel=panel
        ),
        f"{circle} the error falls when the code of the side is swapped for the right one": lower(
            [RIGHT], [SIDE_WRONG], ERRORS, panel=study
        ),
        f"{circle} the error falls when the code of d is swapped for the right one": lower(
            [RIGHT], [D_WRONG], ERRORS, panel=study
        ),
        f"{circle} a swap of the side leaves the distance between forecasts as it is (within 10 %)": mean(
            [RIGHT], [SIDE_WRONG], DISTANCES, panel=study, ratio=LEVEL
        ),
        f"{circle} a swap of d leaves the share on the right as it is (within 10 %)": mean(
            [RIGHT], [D_WRONG], SHARES, panel=study, ratio=LEVEL
        ),
        f"{circle} codes from scenes of other styles are as good as those of the own style (within 10 %)": mean(
            [RIGHT], [OWN_CODES], ERRORS, panel=study, ratio=WITHIN
        ),
        f"{circle} one code from the same scenes is worse": lower(
            [RIGHT], [f"{ONE_CODE}, {BOTH}"], ERRORS, panel=study
        ),
    }


FACTOR_CLAIMS: Mapping[str, Test] = {
    **_on("On the circle of 5 m", "0", "swaps"),
    **_on("On the blind circle", "1", "swaps_blind"),
}
