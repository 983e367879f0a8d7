"""Graph-TERN (Bae and Jeon, AAAI 2023) from a checkout of its repository."""

import numpy as np
import torch

from examples.published.checkouts import OnCpu, Published, displacements, import_from, scenes, seeded


class GraphTern(Published):
    """Endpoints from a Gaussian mixture, 1,000 drawn and clustered to K; paths refined by a graph network.

    Args:
        repo: Folder of a checkout of github.com/InhwanBae/GraphTERN. Its commit decides which weights.
        weights: Name of the weights: the place that they were not trained on.
    """

    pattern = "checkpoint/graph-tern_{weights}_experiment/{weights}_best.pth"
    selection = (
        "published weights: the epoch with the lowest loss on the validation windows of the sources; the program was "
        "improved after the paper, and its author names epochs that are best on the test place"
    )

    def build(self, state):
        """The network with its weights."""
        model = import_from(self.repo, "graphtern.model")
        model.BatchKMeans = _quick(model.BatchKMeans)
        network = model.graph_tern(n_trcnn=3).eval()
        network.load_state_dict(state, strict=False)
        return network

    def forecast(self, observation, samples, seed):
        """Forecasts [A, K, 12, 2], metres; with one sample the centre of all endpoints that were drawn."""
        moves, parts = displacements(observation.xy), []
        with OnCpu():
            self.network.n_smpl = samples
            for rows, own in scenes(observation, seed):
                first = observation.xy[rows][:1, :1]
                near = np.round(observation.xy[rows] - first, 4)  # the network looks at differences of positions alone
                inputs = np.stack([near.swapaxes(0, 1), moves[rows].swapaxes(0, 1)])[None]  # [1, 2, 8 steps, A, 2]
                with seeded(own):
                    *_, paths, _ = self.network(torch.from_numpy(inputs), pruning=4, clustering=True)
                parts.append(paths.permute(2, 0, 1, 3).numpy() + first[:, None])
            self.network.n_smpl = 1
        return np.concatenate(parts)


def _quick(kind):
    """The repository's k-means with the same steps in fewer operations; a cluster that is left empty stays."""

    class Quick(kind):
        def kmeanspp(self, data):
            """First centroids: a random point, then each time the point that is farthest from all before."""
            chosen, nearest = [data[..., np.random.randint(data.shape[-1])]], torch.tensor(torch.inf)  # noqa: NPY002
            for _ in range(1, self.n_clusters):
                nearest = torch.minimum(nearest, (data - chosen[-1][..., None]).square().sum(dim=1))
                chosen.append(data[torch.arange(len(data)), :, nearest.argmax(dim=1)])
            return torch.stack(chosen, dim=-1)

        def fit(self, data):
            """Set ``centroids`` [agents, 2, clusters] of points [agents, 2, points]."""
            centroids = self.kmeanspp(data)
            for _ in range(self.max_iter):
                closeness = torch.baddbmm(-centroids.square().sum(dim=1)[..., None], centroids.mT, data, alpha=2)
                member = (closeness == closeness.amax(dim=1, keepdim=True)).float()
                counts = member.sum(dim=2)[:, None]
                means = torch.where(counts > 0, data @ member.mT / counts.clamp(min=1), centroids)
                moved, centroids = (means - centroids).square().sum(), means
                if moved <= self.tol:
                    break
            self.centroids = centroids

    return Quick
