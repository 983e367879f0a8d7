"""Random numbers that depend on the seed and the observed scene, but not on the batch.

With a generator, the numbers of a scene would depend on the scenes before it, so forecasts in one batch would differ
from forecasts window by window. Here every number is a hash of (seed, sample, scene, agent, position).
"""

from __future__ import annotations

import numpy as np

from motion_gym.contract import Observation

GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def mixed(x: np.ndarray) -> np.ndarray:
    """The finaliser of SplitMix64 (Steele et al., 2014): every output bit depends on every input bit; uint64."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def scene_keys(observation: Observation, samples: int, seed: int) -> np.ndarray:
    """[K, S] uint64, a key for each sample of each scene, from the observed positions without further features."""
    bits = np.ascontiguousarray(observation.xy, np.float32).view(np.uint32).reshape(len(observation), -1)
    columns = mixed(np.arange(1, bits.shape[1] + 1, dtype=np.uint64) * GOLDEN) | np.uint64(1)
    by_agent = mixed(
        (bits.astype(np.uint64) * columns).sum(axis=1, dtype=np.uint64) + agent_numbers(observation) * GOLDEN
    )
    sums = np.concatenate([np.zeros(1, np.uint64), by_agent.cumsum(dtype=np.uint64)])
    by_scene = sums[observation.scene[1:]] - sums[observation.scene[:-1]]
    first = mixed(np.arange(samples, dtype=np.uint64) * GOLDEN + mixed(np.array([seed], np.uint64)))
    return mixed(by_scene[None] ^ first[:, None])


def agent_keys(observation: Observation, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The ``scene_keys`` [K, S], and a key for each sample of each agent, [K, A] uint64."""
    keys = scene_keys(observation, samples, seed)
    return keys, mixed(keys[:, observation.scene_index] + agent_numbers(observation) + np.uint64(1))


def agent_numbers(observation: Observation) -> np.ndarray:
    """[A] uint64, the index of each agent within its scene."""
    return (np.arange(len(observation)) - observation.scene[observation.scene_index]).astype(np.uint64)


def normals(keys: np.ndarray, count: int) -> np.ndarray:
    """[..., count] float32 from N(0, 1), by the Box-Muller transform; ``count`` is even."""
    bits = mixed(keys[..., None] + GOLDEN * np.arange(1, count // 2 + 1, dtype=np.uint64))
    # 24 bits each, the precision of float32; never 0, whose logarithm is infinite.
    length = np.sqrt(-2 * np.log(((bits >> np.uint64(40)).astype(np.float32) + np.float32(0.5)) * np.float32(2**-24)))
    angle = (bits & np.uint64(0xFFFFFF)).astype(np.float32) * np.float32(2 * np.pi * 2**-24)
    return np.concatenate([length * np.cos(angle), length * np.sin(angle)], axis=-1)
