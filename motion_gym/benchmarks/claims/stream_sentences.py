"""The claims of the documentation about online adaptation, with their tests; see ``sentences``."""

from __future__ import annotations

from collections.abc import Mapping

from motion_gym.benchmarks.claims.claim_tests import ANY, Test, lower, mean
from motion_gym.benchmarks.objects import NOWHERE

FILTERS = ("kalman", "ekf:parts=modulator")
TUNED = tuple(f"finetune:parts={parts}" for parts in ("all", "style", "modulator", "last_layer"))
WEIGHTS_ADAPTED = (*TUNED, "ema_anchor:parts=all", *FILTERS)
NOISE_ADAPTED = ("kalman", "finetune:parts=all,every=4")
EVERY_FOURTH = ("finetune:parts=last_layer,every=4", "ekf:parts=last_layer,every=4")
KINDS = ("sudden", "gradual", "recurring")
STEADY = [f"{name}: {k}" for name in ("places", "drone_class", "drone_scene", "traffic_style") for k in KINDS]
CHANGING = [f"{name}: {k}" for name in ("style", "alpha") for k in KINDS]
CHANGING += ["traffic_scenario: sudden", "traffic_scenario: gradual"]

ONLINE: Mapping[str, Test] = {
    "After a sudden change of style, the filters and hedge gain most": lower(
        [*FILTERS, "hedge"], ["style", "refine", *WEIGHTS_ADAPTED[:5]], ["sudden"], panel="style"
    ),
    "After a sudden change of style, the filters and hedge have lower mean errors than the other adapters": mean(
        [*FILTERS, "hedge"], ["style", "refine", *WEIGHTS_ADAPTED[:5]], ["sudden"], panel="style"
    ),
    "The filters are within 10 % of the oracle after 90 matured forecasts, in all five runs": mean(
        FILTERS, ["oracle"], ["from 90 on"], panel="style", ratio=(0, 1.1), each_seed=True
    ),
    "After 90 matured forecasts the mean error of the filters is 15 to 25 % above the oracle's": mean(
        FILTERS, ["oracle"], ["from 90 on"], panel="style", ratio=(1.15, 1.25)
    ),
    "Tuning the modulator alone is not better than tuning everything after a sudden change of style": lower(
        TUNED[2:3], TUNED[:1], ["sudden"], panel="style", where=NOWHERE
    ),
    "Up to 200 matured forecasts, tuning the modulator alone has a higher mean error than tuning everything": mean(
        TUNED[:1], TUNED[2:3], [f"last 50 at {n}" for n in (50, 100, 150, 200)], panel="style"
    ),
    "When d = 0.3 comes back, the error has grown by 11 to 32 % where weights were adapted": mean(
        WEIGHTS_ADAPTED, ["none"], ["on return"], panel="style", ratio=(1.11, 1.32)
    ),
    "When d = 0.3 comes back, the error has grown by 77 % or more where the style is read": mean(
        ["style", "refine"], ["none"], ["on return"], panel="style", ratio=(1.77, ANY)
    ),
    "When d = 0.3 comes back, the error has grown by 2 % or less with hedge": mean(
        ["hedge"], ["none"], ["on return"], panel="style", ratio=(0, 1.02)
    ),
    "When d = 0.3 comes back, the error has grown by 10 to 15 % with hedge": mean(
        ["hedge"], ["none"], ["on return"], panel="style", ratio=(1.1, 1.15)
    ),
    "Under another noise, kalman and tuning everything take a third or more off the error": mean(
        NOISE_ADAPTED, ["none"], panel="alpha", ratio=(0, 0.67)
    ),
    "After a sudden change of noise, kalman and tuning everything take 30 % or more off the error": lower(
        NOISE_ADAPTED, ["none"], ["sudden"], panel="alpha", ratio=(0, 0.7)
    ),
    "After a sudden change of noise, kalman and tuning everything stay above constant velocity": lower(
        ["constant_velocity"], NOISE_ADAPTED, ["sudden"], panel="alpha"
    ),
    "Under another noise, hedge has a lower mean error than constant velocity, however the noise changes": mean(
        ["hedge"], ["constant_velocity"], panel="alpha"
    ),
    "After a sudden change of noise, hedge has a lower error than constant velocity for each seed": mean(
        ["hedge"], ["constant_velocity"], ["sudden"], panel="alpha", each_seed=True
    ),
    "After a sudden change of noise, no other adapter has a lower mean error than constant velocity": mean(
        ["constant_velocity"],
        [*NOISE_ADAPTED, "ema_anchor:parts=all,every=4", *EVERY_FOURTH],
        ["sudden"],
        panel="alpha",
    ),
    "From the 150th matured forecast on, hedge is below constant velocity": mean(
        ["hedge"], ["constant_velocity"], [f"last 50 at {n}" for n in (150, 200, 250, 300)], panel="alpha"
    ),
    "At the 100th matured forecast hedge is above constant velocity": mean(
        ["constant_velocity"], ["hedge"], ["last 50 at 100"], panel="alpha"
    ),
    "At other places constant velocity has a lower mean error than the oracle": mean(
        ["constant_velocity"], ["oracle"], ["sudden"], panel="places"
    ),
    "At other places kalman is worse than the source model right after the shift": lower(
        ["none"], ["kalman"], ["last 50 at 50"], panel="places"
    ),
    "From a straight road to a roundabout, kalman and hedge take 20 % or more off the error of the source model": (
        lower(["kalman", "hedge"], ["none"], ["sudden"], panel="traffic_scenario", ratio=(0, 0.8))
    ),
    "From a straight road to a roundabout, kalman and hedge have a lower error than constant velocity": lower(
        ["kalman", "hedge"], ["constant_velocity"], ["sudden"], panel="traffic_scenario"
    ),
    "From calm to aggressive drivers no adapter has a lower mean error than the source model": mean(
        ["none"], ["finetune:parts=last_layer,every=4", "kalman", "hedge"], ["sudden"], panel="traffic_style"
    ),
    "From calm to aggressive drivers kalman has the highest error of the adapters": lower(
        ["finetune:parts=last_layer,every=4", "hedge"], ["kalman"], ["sudden"], panel="traffic_style"
    ),
    "On drone video kalman has a higher mean error than the source model after a sudden shift of class": mean(
        ["none"], ["kalman"], ["sudden"], panel="drone_class"
    ),
    "On drone video hedge has a lower mean error than the source model after a sudden shift of class": mean(
        ["hedge"], ["none"], ["sudden"], panel="drone_class"
    ),
    "On every stream and for every seed, hedge is within 2 % of its best expert in hindsight": mean(
        ["hedge"], ["best expert"], panel="regret", ratio=(0, 1.02), each_seed=True
    ),
    "At places, on drone video and with other drivers, hedge is within 2 % of its best expert for every seed": mean(
        ["hedge"], ["best expert"], STEADY, panel="regret", ratio=(0, 1.02), each_seed=True
    ),
    "Without returns to the straight road, the mean error of hedge is within 2 % of that of its best expert": mean(
        ["hedge"], ["best expert"], [*STEADY, *CHANGING], panel="regret", ratio=(0, 1.02)
    ),
    "With returns to the straight road, the mean error of hedge is 4 to 5 % above that of its best expert": mean(
        ["hedge"], ["best expert"], ["traffic_scenario: recurring"], panel="regret", ratio=(1.04, 1.05)
    ),
}
"""The test of each sentence."""
