"""Score a predictor on a stream: every agent forecasts at every frame, and ground truth is revealed later."""

import motion_gym
from motion_gym import forecast_to_dict, observation_from_dict, truth_from_infos
from motion_gym.stepping.wrappers import ScoreParallel

env = ScoreParallel(motion_gym.parallel_env("orca:d=0.6", clock="stream", scenes=50))
predictor = motion_gym.predictor("constant_velocity")
dt = env.unwrapped.domain.card.dt

observations, infos = env.reset()
while env.agents:
    observation = observation_from_dict(observations, dt, env.agents, env.unwrapped.clock.time)
    actions = forecast_to_dict(predictor.predict(observation), env.agents)
    observations, rewards, terminations, truncations, infos = env.step(actions)
    truth = truth_from_infos(infos, dt)  # scenes that are fully known now, for predictors that learn

ledger = env.unwrapped.ledger
print(f"{ledger.settled} forecasts: {ledger.matured} matured, {ledger.censored} censored (their agent left)")
for name, value in env.score().items():
    print(f"{name:15} {value.mean:.3f} [{value.low:.3f}, {value.high:.3f}]")
