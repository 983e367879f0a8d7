"""Drive with forecasts: score a planner with several predictors, and write a clip of one episode.

    python driving.py

Needs highway-env: pip install "motion-gym[highway]". Without `runs` and `seconds` a domain has its full size.
"""

import gymnasium

import motion_gym
from motion_gym.driving.evaluation import drive
from motion_gym.driving.pictures import write_clip

SMALL = {"scenario": "roundabout", "runs": 1, "seconds": 30.0}


def main() -> None:
    """Compare predictors in the same episodes, then drive one of them step by step."""
    domain = motion_gym.domain("highway", style="normal", **SMALL)
    for predictor in ("stand_still", "constant_velocity", "oracle"):
        card = drive(predictor, domain, episodes=4, others="replay")
        print(f"{predictor}: score {card.values['score'].mean():.3f}, collisions {card.values['collision'].mean():.2f}")

    env = gymnasium.make("motion_gym/Drive-v0", style="normal", render_mode="rgb_array", **SMALL)
    predictor = motion_gym.predictor("constant_velocity")
    env.reset(seed=4)
    images, over = [], False
    while not over:
        forecast = predictor.predict(env.unwrapped.observation)
        action = env.unwrapped.best_proposal(forecast)  # or a proposal of your own planner, 0 to 15
        images.append(env.render())
        _, _, terminated, truncated, scores = env.step(action)
        over = terminated or truncated
    write_clip(images, "driving.gif")
    print(f"Written: driving.gif, {len(images)} steps, score {scores['score']:.3f}")


if __name__ == "__main__":
    main()
