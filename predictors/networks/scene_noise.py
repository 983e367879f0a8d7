"""Random numbers that belong to a scene: from the seed and what is seen in it, whatever else is in the batch.

A generator would give a scene other numbers when other scenes come before it, so that forecasts of one batch and those
made window by window would differ. Here every number is a hash of (seed, sample, scene, agent, position).
"""

from __future__ import annotations

import numpy as np

from motion_gym.contract import Observation

GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def mixed(x: np.ndarray) -> np.ndarray:
    """The finaliser of SplitMix64 (Steele et al., 2014): uint64 to uint64, every bit depends on all."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


def scene_keys(observation: Observation, samples: int, seed: int) -> np.ndarray:
    """[K, S] uint64, a key for every sample of every scene, from where its agents were: the same with any sigma."""
    seen = np.ascontiguousarray(observation.xy, np.float32).view(np.uint32).reshape(len(observation), -1)
    columns = mixed(np.arange(1, seen.shape[1] + 1, dtype=np.uint64) * GOLDEN) | np.uint64(1)
    by_agent = mixed(
        (seen.astype(np.uint64) * columns).sum(axis=1, dtype=np.uint64) + agent_numbers(observation) * GOLDEN
    )
    sums = np.concatenate([np.zeros(1, np.uint64), by_agent.cumsum(dtype=np.uint64)])
    by_scene = sums[observation.scene[1:]] - sums[observation.scene[:-1]]
    first = mixed(np.arange(samples, dtype=np.uint64) * GOLDEN + mixed(np.array([seed], np.uint64)))
    return mixed(by_scene[None] ^ first[:, None])


def agent_keys(observation: Observation, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The ``scene_keys`` [K, S], and [K, A] uint64, a key for every sample of every agent."""
    keys = scene_keys(observation, samples, seed)
    return keys, mixed(keys[:, observation.scene_index] + agent_numbers(observation) + np.uint64(1))


def agent_numbers(observation: Observation) -> np.ndarray:
    """[A] uint64, the number of each agent within its scene, from 0."""
    return (np.arange(len(observation)) - observation.scene[observation.scene_index]).astype(np.uint64)


def normals(keys: np.ndarray, count: int) -> np.ndarray:
    """[..., count] float32 from N(0, 1), by Box and Muller; ``count`` is even."""
    bits = mixed(keys[..., None] + GOLDEN * np.arange(1, count // 2 + 1, dtype=np.uint64))
    # 24 bits each, as many as float32 holds; never 0, whose logarithm is infinite.
    length = np.sqrt(-2 * np.log(((bits >> np.uint64(40)).astype(np.float32) + np.float32(0.5)) * np.float32(2**-24)))
    angle = (bits & np.uint64(0xFFFFFF)).astype(np.float32) * np.float32(2 * np.pi * 2**-24)
    return np.concatenate([length * np.cos(angle), length * np.sin(angle)], axis=-1)
