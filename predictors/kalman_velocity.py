"""Kalman filter with a constant-velocity model: the velocity is estimated from all 8 observed positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation, PredictorError
from motion_gym.predictors.networks.scene_noise import agent_keys, normals
from motion_gym.predictors.settings import optional, positive
from motion_gym.specs import one_of

ACCELERATION = 10.0 ** np.linspace(-3.5, -0.5, 5)
"""Acceleration variances q of the grid, (m/s^2)^2: standard deviations of 0.02 to 0.6 m/s^2."""
MEASUREMENT = 10.0 ** np.linspace(-5.5, -1.75, 6)
"""Measurement variances r of the grid, m^2: standard deviations of 2 mm to 13 cm."""
SELECTIONS = ("mixture", "likeliest")


class KalmanVelocity:
    """Constant velocity, estimated by Kalman filters. Needs no training, works at any time step.

    Each axis of each agent has the state (position, velocity). The model has a random acceleration of variance q that
    is constant between two steps, and observed positions with errors of variance r. The first two positions give the
    initial state. The larger q / r, the shorter the memory.

    By default q and r are taken from a grid of 5 and 6 values, which gives up to 30 filters. Each filter is weighted by
    the likelihood of the agent's own history: ``mixture`` averages the forecasts with these weights, ``likeliest`` uses
    the filter with the highest likelihood. Agents do not share information.

    The first sample is the forecast. Each further sample takes one filter, drawn by the weights, a position and
    velocity from its distribution, and random accelerations of variance q, for each agent independently.

    Args:
        q: Variance of the acceleration, (m/s^2)^2; None for the grid ``ACCELERATION``.
        r: Variance of a measured coordinate, m^2; None for the grid ``MEASUREMENT``.
        select: ``mixture`` or ``likeliest``.

    Raises:
        SpecError: a variance is not above 0, or ``select`` is unknown.
    """

    selection = "no weights; the grid of noise variances was set with the test windows of ETH-UCY in view"

    def __init__(self, q: float | None = None, r: float | None = None, select: str = "mixture"):
        self.q, self.r = (optional(positive)(name, value) for name, value in (("q", q), ("r", r)))
        self.select = one_of("select", select, SELECTIONS, "kalman_velocity")

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres.

        Raises:
            PredictorError: the time step is not a finite number above 0.
        """
        dt = observation.dt
        if not 0 < dt < np.inf:
            raise PredictorError(f"kalman_velocity needs a time step above 0, and the observation has dt = {dt} s.")
        q, r = np.meshgrid(
            ACCELERATION if self.q is None else self.q, MEASUREMENT if self.r is None else self.r, indexing="ij"
        )
        origin = observation.xy[:, -1:].astype(np.float64)
        bank = filtered(observation.xy - origin, dt, q.ravel(), r.ravel())
        if self.select == "mixture":
            weight = bank.shares
        else:
            weight = (np.arange(q.size)[:, None] == bank.likelihood.argmax(axis=0)).astype(np.float64)
        position = np.einsum("ga,gac->ac", weight, bank.position)
        velocity = np.einsum("ga,gac->ac", weight, bank.velocity)
        ahead = dt * np.arange(1, FUTURE + 1)[:, None]
        positions = (position[:, None] + ahead * velocity[:, None])[:, None]
        if samples > 1:
            drawn = _drawn(bank, weight, q.ravel(), dt, observation, samples - 1, seed)
            positions = np.concatenate([positions, drawn], axis=1)
        return Forecast((origin[:, None] + positions).astype(np.float32))


@dataclass(frozen=True)
class FilterBank:
    """G filters after the observed steps of A agents.

    Attributes:
        position: [G, A, 2] metres.
        velocity: [G, A, 2] metres per second.
        likelihood: [G, A] log-likelihood of the third and later observed positions, without its constant.
        covariance: [G, 2, 2] of position and velocity, the same for both axes and all agents.
    """

    position: np.ndarray
    velocity: np.ndarray
    likelihood: np.ndarray
    covariance: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """[G, A] weights of the filters, in proportion to their likelihoods; their sum is 1."""
        weight = np.exp(self.likelihood - self.likelihood.max(axis=0))
        return weight / weight.sum(axis=0)


def filtered(xy: np.ndarray, dt: float, q: np.ndarray, r: np.ndarray) -> FilterBank:
    """Run G filters over the observed positions.

    The covariance of a filter depends only on q, r and dt, so all agents share it.

    Args:
        xy: [A, 8, 2] float64, metres.
        dt: Seconds per step.
        q: [G] variances of the acceleration.
        r: [G] variances of a measured coordinate.
    """
    transition = np.array([[1, dt], [0, 1]])
    effect = np.array([dt**2 / 2, dt])  # of a unit acceleration on position and velocity
    disturbance = q[:, None, None] * np.outer(effect, effect)
    first = np.array([[1, 1 / dt], [1 / dt, 2 / dt**2]])  # of (x1, (x1 - x0) / dt), for independent errors
    covariance = r[:, None, None] * first + q[:, None, None] * np.diag([0, dt**2 / 4])
    shape = (len(q), len(xy), 2)
    position = np.broadcast_to(xy[:, 1], shape)
    velocity = np.broadcast_to((xy[:, 1] - xy[:, 0]) / dt, shape)
    likelihood = np.zeros(shape[:2])
    for step in range(2, HISTORY):
        position = position + dt * velocity
        covariance = transition @ covariance @ transition.T + disturbance
        variance = covariance[:, 0, 0] + r
        gain = covariance[:, :, 0] / variance[:, None]
        covariance = covariance - gain[:, :, None] * covariance[:, None, 0]
        innovation = xy[:, step] - position
        # The sum over both axes, hence the logarithm of the variance without the factor 1/2.
        likelihood -= (innovation**2).sum(axis=-1) / (2 * variance[:, None]) + np.log(variance)[:, None]
        position = position + gain[:, 0, None, None] * innovation
        velocity = velocity + gain[:, 1, None, None] * innovation
    return FilterBank(position, velocity, likelihood, covariance)


def _drawn(
    bank: FilterBank, weight: np.ndarray, q: np.ndarray, dt: float, observation: Observation, samples: int, seed: int
) -> np.ndarray:
    """Positions [A, K, 12, 2] of paths that are drawn from a mixture of filters, metres."""
    _, keys = agent_keys(observation, samples, seed)
    noise = normals(keys, 2 * (FUTURE + 4)).astype(np.float64)  # [K, A, 32]
    # The normal distribution function of one of the values is uniform, and chooses the filter.
    uniform = ndtr(noise[..., 0])
    edges = weight.cumsum(axis=0).T  # [A, G]
    chosen = (uniform.T[..., None] > edges[:, None, :-1]).sum(axis=-1)  # [A, K]
    agent = np.arange(len(chosen))[:, None]
    factor = np.linalg.cholesky(bank.covariance + 1e-12 * np.eye(2))[chosen]  # [A, K, 2, 2]
    state = np.einsum("akij,kajc->akic", factor, noise[..., 2:6].reshape(samples, -1, 2, 2))
    position, velocity = bank.position[chosen, agent] + state[:, :, 0], bank.velocity[chosen, agent] + state[:, :, 1]
    pushes = noise[..., 8:].reshape(samples, -1, FUTURE, 2).transpose(1, 0, 2, 3) * np.sqrt(q)[chosen][..., None, None]
    velocities = velocity[:, :, None] + dt * (pushes.cumsum(axis=2) - pushes)
    return position[:, :, None] + (dt * velocities + dt**2 / 2 * pushes).cumsum(axis=2)
