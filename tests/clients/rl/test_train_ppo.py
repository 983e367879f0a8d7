"""The example that trains PPO is better than standing still."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


def test_ppo_is_better_than_standing_still():
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, "train_ppo.py", "45"],
        cwd=ROOT / "examples",
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    ade = {name: float(value) for name, value in re.findall(r"^(\w+) +(\d\.\d+) \[", done.stdout, re.MULTILINE)}
    assert set(ade) == {"stand_still", "PPO", "constant_velocity"}
    assert ade["PPO"] < 0.9 * ade["stand_still"], done.stdout
