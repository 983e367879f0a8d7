"""A checkpoint of your own: a plain torch.nn.Module, wrapped as a predictor and scored.

Train and score it:                python own_checkpoint.py
Score it again, from this folder:  motion-gym score own_checkpoint:Walk:path=walk.pt --domain orca:d=0.6
"""

import hashlib
import io
import sys
import tempfile
from pathlib import Path

import numpy as np
import torch

import motion_gym

TRAINED_ON = "orca:d=0.3,scenes=500"


class WalkNet(torch.nn.Module):
    """Stands for your model: a Gaussian for each future step, from the paths of one scene, with their mean at zero."""

    def __init__(self):
        super().__init__()
        self.own, self.others = torch.nn.Linear(16, 64), torch.nn.Linear(16, 64)
        self.activation = lambda values: torch.relu(values)  # a lambda: the module cannot be pickled
        self.head = torch.nn.Linear(64, 48)

    def forward(self, paths):
        """Paths (agents, 8, 2) to means and log standard deviations (agents, 12, 2)."""
        flat = (paths - paths[:, -1:]).flatten(1)
        hidden = self.activation(self.own(flat) + self.others(paths.flatten(1)))
        change, deviation = self.head(hidden).reshape(-1, 12, 4).chunk(2, dim=-1)
        steps = torch.arange(1, 13)[:, None]
        return paths[:, -1:] + steps * (paths[:, -1:] - paths[:, -2:-1] + 0.1 * change), deviation


class Walk:
    """The wrapper: what stands between the model and motion-gym.

    Args:
        path: Checkpoint, a state dict of ``WalkNet``.
    """

    selection = "the last of 100 steps of training; nothing was selected"
    trained_on = (TRAINED_ON,)

    def __init__(self, path="walk.pt"):
        self.path = path
        content = Path(path).read_bytes()
        self.fingerprint = hashlib.sha256(content).hexdigest()
        self.network = WalkNet().eval()
        self.network.load_state_dict(torch.load(io.BytesIO(content), map_location="cpu", weights_only=True))

    def __reduce__(self):
        return type(self), (self.path,)  # copies, and the process that verifies, load the checkpoint anew

    @torch.no_grad()
    def predict(self, observation, samples=1, seed=0):
        """Forecasts (agents, samples, 12, 2), metres, in the frame of the observation."""
        forecasts = []
        for first, last in zip(observation.scene[:-1], observation.scene[1:], strict=True):
            paths = torch.tensor(observation.xy[first:last])  # a copy: what a predictor is given is read-only
            centre = paths[:, -1:].mean(dim=0, keepdim=True)
            mean, deviation = self.network(paths - centre)
            noise = torch.randn(len(paths), samples, 12, 2, generator=generator(seed, paths))
            forecasts.append(mean[:, None] + deviation.exp()[:, None] * noise + centre[:, None])
        return torch.cat(forecasts).numpy()


def generator(seed, paths):
    """Noise of a scene. The seed alone would give all scenes the same noise: they are asked one by one."""
    scene = int.from_bytes(hashlib.sha256(paths.numpy().tobytes()).digest()[:6], "big")
    return torch.Generator().manual_seed(seed + scene)


def train(path):
    """Stands for your training program: it saves a checkpoint."""
    truth = motion_gym.domain(TRAINED_ON).windows("train")
    xy, observation = truth.observation.xy, truth.observation
    centres = np.add.reduceat(xy[:, -1:], observation.scene[:-1]) / np.diff(observation.scene)[:, None, None]
    centre = centres[observation.scene_index].astype(np.float32)
    paths, future = torch.from_numpy(xy - centre), torch.from_numpy(truth.future - centre)
    torch.manual_seed(0)
    network = WalkNet()
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-2)
    for _ in range(100):
        mean, deviation = network(paths)
        loss = (deviation + 0.5 * ((future - mean) / deviation.exp()) ** 2).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    torch.save(network.state_dict(), path)


if __name__ == "__main__":
    path = sys.argv[1] if len(sys.argv) > 1 else str(Path(tempfile.mkdtemp()) / "walk.pt")
    if not Path(path).exists():
        train(path)
    motion_gym.check_predictor(Walk(path))
    for predictor in (Walk(path), "constant_velocity"):
        print(motion_gym.evaluate(predictor, "orca:d=0.6,scenes=500"))
    print(f"Next: motion-gym score own_checkpoint:Walk:path={path} --domain orca:d=0.6 --k 20")
