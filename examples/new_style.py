"""A crowd of a new style: forecast it as it is, read its style from reference scenes, refine, tune on a few scenes.

    python new_style.py

Needs PyTorch. The crowd keeps a distance of 0.6, the predictor was trained with 0.1, 0.3 and 0.5.
"""

import motion_gym
from motion_gym.predictors.refine import Refine
from motion_gym.predictors.transfer import transfer

SOURCES = [motion_gym.domain(f"orca:d={d},scenes=1000") for d in (0.1, 0.3, 0.5)]
CROWD = motion_gym.domain("orca:d=0.6,scenes=1000")


def main() -> None:
    """Score each way, with and without reference scenes."""
    modular = motion_gym.predictor("modular_invariant")
    refined = Refine(modular, steps=3, rate=0.001)
    tuned = transfer(modular, CROWD.windows("train"), [s.windows("train") for s in SOURCES], batches=2, epochs=60)
    for name, predictor in (("modular", modular), ("refined", refined), ("tuned on 128 scenes", tuned)):
        for references in (0, 64):
            predictor.reset()
            card = motion_gym.evaluate(predictor, CROWD, references=references)
            print(f"{name}, {references} reference scenes: ADE {card.metrics['ADE'].mean:.3f} m")


if __name__ == "__main__":
    main()
