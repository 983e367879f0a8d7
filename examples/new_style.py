"""A crowd with a new style: forecast without adaptation, refine, and tune on a few scenes.

    python new_style.py

Needs PyTorch. The style of the crowd is d = 0.6; the predictor was trained with 0.1, 0.3 and 0.5.
"""

import motion_gym

CROWD = motion_gym.domain("orca:d=0.6,scenes=1000")


def main() -> None:
    """Score each predictor without scenes of the new crowd, and with 128 scenes."""
    for predictor in ("modular_invariant", "refine", "transfer", "refine:of=transfer"):
        for shots in (0, 128):
            card = motion_gym.evaluate(predictor, CROWD, references=0, shots=shots)
            print(f"{predictor}, {shots} scenes: ADE {card.metrics['ADE'].mean:.3f} m")


if __name__ == "__main__":
    main()
