"""A simulated crowd with a third feature, for predictors that are given sigma; it needs no data."""

import numpy as np

from motion_gym.envs.orca import Orca


class CrowdWithSigma(Orca):
    """ORCA with a noise feature made from the change of velocity, as ``sigma="past"`` of ETH-UCY."""

    feature_names = ("sigma",)

    def features(self, history):
        """[A, 8, 1], from the observed steps alone."""
        change = np.zeros(history.shape[:2])
        change[:, 2:] = np.linalg.norm(np.diff(history, n=2, axis=1), axis=-1)
        return 8 * (1 + change[..., None])
