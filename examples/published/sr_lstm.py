"""SR-LSTM (Zhang et al., CVPR 2019) from a checkout of its repository."""

import types
import warnings

import numpy as np
import torch

from examples.published.checkouts import OnCpu, Published, import_from, seeded

NUMBERS = {"eth": 0, "hotel": 1, "zara1": 2, "zara2": 3, "univ": 4}
"""Number of each place as a test set of the repository."""
NEAR = 10.0
"""Metres along x and along y within which others are neighbours."""
TOGETHER = 40
"""Agents of a batch; pairs of all of them are computed, those of different scenes in vain."""


class SrLstm(Published):
    """An LSTM whose states are refined by those of neighbours; one forecast, whatever the number of samples.

    The published test leaves dropout on, and the weights need it: without dropout forecasts are much worse. So the
    forecast depends on the seed.

    Args:
        repo: Folder of a checkout of github.com/zhangpur/SR-LSTM.
        weights: Name of the weights: the place that they were not trained on.
    """

    selection = (
        "published weights of one epoch for each place; the trainer scores the test place after every epoch, and by "
        "what the epoch was chosen is not published"
    )

    @property
    def pattern(self):
        """Path of the weights file in the checkout."""
        return f"savedata/{NUMBERS[self.weights]}/testmodel/testmodel_*.tar"

    def build(self, state):
        """The network with its weights."""
        arguments = import_from(self.repo, "train").get_parser().parse_args([])
        arguments.using_cuda, arguments.passing_time = False, 1  # the published weights have one refinement layer
        models = import_from(self.repo, "models")
        models.GCN.forward.__globals__["np"] = types.SimpleNamespace(Inf=np.inf)  # numpy 2 has no `Inf`
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it begins with the old names of torch.nn.init
            network = models.SR_LSTM(arguments)  # dropout stays on, as in the repository's own test
        network.load_state_dict(state["state_dict"])
        return network

    def forecast(self, observation, samples, seed):
        """Forecasts [A, 1, 12, 2], metres."""
        batch = np.cumsum(np.diff(observation.scene)) // TOGETHER
        first = np.flatnonzero(np.diff(batch, prepend=-1))  # the first scene of each batch
        parts = []
        with seeded(seed), OnCpu():
            for begin, end in zip(first, [*first[1:], len(batch)], strict=True):
                bounds = observation.scene[begin : end + 1]
                parts.append(self._together(observation.xy[bounds[0] : bounds[-1]], np.diff(bounds)))
        return np.concatenate(parts)

    def _together(self, xy, sizes):
        """Forecasts of some scenes at once: [A, 1, 12, 2]."""
        # The network fails where nobody has a neighbour: two people who are one metre apart are a scene of their own.
        xy = np.concatenate([xy, np.ones((2, *xy.shape[1:]), xy.dtype) * [[[0]], [[1]]]])
        scene = np.repeat(np.arange(len(sizes) + 1), [*sizes, 2])
        path = torch.zeros(19, len(xy), 2)
        path[:8] = torch.from_numpy(xy[..., ::-1].swapaxes(0, 1) - xy[:1, :1, ::-1].swapaxes(0, 1)).float()  # y, x
        shift = path[7].expand(19, -1, -1)
        close = ((path[:, :, None] - path[:, None]).abs() <= NEAR).all(dim=-1) & torch.from_numpy(
            (scene[:, None] == scene) & ~np.eye(len(xy), dtype=bool)
        )
        close = close.float()
        inputs = (path, path - shift, shift, torch.ones(19, len(xy)), close, close.sum(dim=2), None)
        moves = self.network(inputs, iftest=True)[0][7:]
        return moves.permute(1, 0, 2).numpy()[:-2, None, :, ::-1] + xy[:-2, None, -1:]
