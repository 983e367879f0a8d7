"""Every domain as an environment of Gymnasium and of PettingZoo, under the same ids."""

from __future__ import annotations

import gymnasium
import pettingzoo

from motion_gym.catalog import DOMAINS

NAMESPACE = "motion_gym"


def register_all() -> None:
    """Register ``motion_gym/<id>`` in both registries; a second call changes nothing."""
    for name, entry in DOMAINS.items():
        env_id = f"{NAMESPACE}/{entry.env_id}"
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point="motion_gym.stepping.gymnasium_env:WindowEnv",
                vector_entry_point="motion_gym.stepping.vector_env:WindowVectorEnv",
                kwargs={"domain": name},
            )
        if env_id not in pettingzoo.parallel_registry:
            pettingzoo.register(
                "parallel",
                env_id,
                entry_point="motion_gym.stepping.pettingzoo_env:parallel_env",
                kwargs={"domain": name},
            )
