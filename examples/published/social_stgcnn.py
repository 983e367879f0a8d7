"""Social-STGCNN (Mohamed et al., CVPR 2020) from a checkout of its repository."""

import numpy as np
import torch

from examples.published.checkouts import Published, displacements, import_from, scenes


class SocialStgcnn(Published):
    """Graph convolutions over the people of a scene; a Gaussian for each step.

    Args:
        repo: Folder of a checkout of github.com/abduallahmohamed/Social-STGCNN. Its commit decides which weights.
        weights: Name of the weights: the place that they were not trained on.
        mean: Forecast the means of the Gaussians, which is one sample, instead of drawing.
    """

    pattern = "checkpoint/social-stgcnn-{weights}/val_best.pth"
    selection = (
        "published weights: the epoch with the lowest loss on the validation windows of the sources; how the number of "
        "layers was chosen is not published"
    )

    def __init__(self, repo, weights="eth", mean=False):
        super().__init__(repo, weights)
        self.mean = mean

    def __reduce__(self):
        return type(self), (self.repo, self.weights, self.mean)

    def build(self, state):
        """The network with its weights."""
        network = import_from(self.repo, "model").social_stgcnn(n_stgcnn=1, n_txpcnn=5).eval()
        network.load_state_dict(state)
        return network

    def forecast(self, observation, samples, seed):
        """Forecasts [A, K, 12, 2], metres."""
        moves, last = displacements(observation.xy), observation.xy[:, -1]
        paths = [np.cumsum(self._moves(moves[rows], samples, own), axis=2) for rows, own in scenes(observation, seed)]
        return last[:, None, None] + np.concatenate(paths)

    def _moves(self, moves, samples, seed):
        """Moves of a scene: [A, K, 12, 2]; the order of the agents matters to this network."""
        inputs = torch.from_numpy(moves).permute(2, 1, 0)[None]  # [1, x and y, 8 steps, A]
        output = self.network(inputs, torch.from_numpy(_laplacian(moves)))[0][0].permute(2, 1, 0)
        mean, deviation, correlation = output[..., :2], output[..., 2:4].exp(), output[:, None, :, 4].tanh()
        if self.mean:
            return mean[:, None].numpy()
        noise = torch.randn(len(moves), samples, 12, 2, generator=torch.Generator().manual_seed(seed))
        y = correlation * noise[..., 0] + (1 - correlation**2).sqrt() * noise[..., 1]
        return (mean[:, None] + deviation[:, None] * torch.stack([noise[..., 0], y], dim=-1)).numpy()


def _laplacian(moves):
    """Normalised Laplacian of each observed step: [8, A, A]; edges weigh 1 / difference of moves."""
    step = moves.transpose(1, 0, 2)
    distance = np.linalg.norm(step[:, :, None] - step[:, None], axis=-1)
    edges = np.divide(1, distance, out=np.zeros_like(distance), where=distance > 0) + np.eye(len(moves))
    degree = edges.sum(axis=2)
    scale = degree**-0.5
    laplacian = degree[:, :, None] * np.eye(len(moves)) - edges
    return (scale[:, :, None] * laplacian * scale[:, None]).astype(np.float32)
