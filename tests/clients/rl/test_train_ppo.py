"""The tutorial that trains PPO ends better than standing still."""

import re

from tests.tutorials import follow


def test_ppo_is_better_than_standing_still(tmp_path):
    said = follow("train-sb3.md", tmp_path)
    ade = {name: float(value) for name, value in re.findall(r"(\w+) (\d\.\d+) \[", said)}
    assert set(ade) == {"stand_still", "PPO", "constant_velocity"}
    assert ade["PPO"] < 0.9 * ade["stand_still"], said
