"""Measure driving with forecasts: replans a second, and seconds for one predictor in one style.

A replan is a forecast and a plan. The last column is the time of 5 seeds by 100 episodes, from a sample of episodes, on
one core; traffic that is simulated on first use is not counted.

Run it with ``python bench/driving.py`` (about two minutes). highway-env must be installed.
"""

import time

from machine import machine

import motion_gym
from motion_gym.driving.evaluation import drive, episodes_of

SAMPLE, ALL = 40, 500
ROWS = ("stand_still", "constant_velocity", "kalman_velocity", "linear", "hedge:of=linear", "oracle")


def main():
    print(machine(), end="\n\n")
    print(f"| others | forecasts by | replans/s | seconds for {ALL} episodes |")
    print("|---|---|---:|---:|")
    domain = motion_gym.domain("highway:style=normal,scenario=roundabout")
    episodes_of(domain)
    drive("linear", domain, episodes=1)  # reads the training data
    for others in ("replay", "react"):
        for row in ROWS:
            begin = time.perf_counter()
            card = drive(row, domain, others=others, episodes=SAMPLE)
            took = (time.perf_counter() - begin) * ALL / SAMPLE
            print(f"| {others} | {row} | {1 / sum(card.seconds.values()):.0f} | {took:.0f} |", flush=True)


if __name__ == "__main__":
    main()
