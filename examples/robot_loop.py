"""Adapt a robot's predictor in a loop of your own, from the positions of the agents in sight at each step.

Run it:  python robot_loop.py
"""

from collections import deque

import numpy as np

import motion_gym
from motion_gym.metrics.errors import ade

DT = 0.4


def camera():
    """Simulates the robot's tracker: at each step, the positions of the agents in sight, by id."""
    crowd = motion_gym.domain("orca:d=0.6", scenes=60).recordings("test")[0]
    for frame in np.unique(crowd.frame):
        now = crowd.frame == frame
        yield dict(zip(crowd.agent[now].tolist(), crowd.xy[now], strict=True))


def run(predictor):
    """Mean error, metres, of the matured forecasts; the predictor learns from each forecast after it is scored."""
    seen = deque(maxlen=motion_gym.HISTORY + motion_gym.FUTURE)  # the last 20 steps
    waiting, errors = motion_gym.Outstanding(), []
    for now, people in enumerate(camera()):
        seen.append(people)
        # The forecast of 12 steps ago is known now: score it first, then learn from it.
        for stored in waiting:
            if stored.made + motion_gym.FUTURE == now:
                steps = list(seen)[-motion_gym.FUTURE :]
                ids = stored.observation.agent.tolist()
                future = np.array([[step.get(i, (0.0, 0.0)) for step in steps] for i in ids])
                known = np.array([[i in step for step in steps] for i in ids])
                forecast, truth = waiting.settle(stored.made, future, known)
                errors += ade(forecast, truth)[known.all(axis=1)].tolist()
                predictor.observe(truth)
        # Forecast the agents that were seen in all of the last 8 steps.
        steps = list(seen)[-motion_gym.HISTORY :]
        ids = [i for i in people if len(steps) == motion_gym.HISTORY and all(i in step for step in steps)]
        if ids:
            history = np.array([[step[i] for step in steps] for i in ids], np.float32)
            scene, agent = np.array([0, len(ids)]), np.array(ids)
            observation = motion_gym.Observation(history, scene, agent, DT)
            waiting.store(now, observation, predictor.predict(observation))
    return np.mean(errors), len(errors)


if __name__ == "__main__":
    source = "modular_invariant:weights=style"
    for name in ("none", "style", "kalman"):
        error, count = run(motion_gym.adapter(name, source))
        print(f"{name}: ADE {error:.3f} m over {count} matured forecasts")
