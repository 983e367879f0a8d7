"""A domain of your own, from a text file with rows `frame id x y`.

Check it:  python own_domain.py FILE  (writes an example if the file does not exist)
Score on it, from this folder:  motion-gym score linear --domain own_domain:Tracks:path=FILE
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import motion_gym
from motion_gym.data.domains import RecordedDomain


class Tracks(RecordedDomain):
    """Tracks from a file: the first 70 % of the frames for training, then 10 % for validation and 20 % for test."""

    name = "tracks"
    source = "a text file"

    def __init__(self, path: str, dt: float = 0.4):
        self.path, self.dt = path, dt

    def sources(self):
        """The training domains: the splits train and val of the same file."""
        return [self]

    def recordings(self, split):
        """The recordings of a split: one, or none if the split has no frames."""
        recording = motion_gym.read_recording(self.path, dt=self.dt)
        first, last = {"train": (0, 0.7), "val": (0.7, 0.8), "test": (0.8, 1), "reference": (0, 0)}[split]
        low, high = (int(share * len(np.unique(recording.frame))) for share in (first, last))
        keep = np.isin(recording.frame, np.unique(recording.frame)[low:high])
        if not keep.any():
            return []
        return [
            motion_gym.Recording(recording.frame[keep], recording.agent[keep], recording.xy[keep], self.dt, self.path)
        ]


def write_an_example(path):
    """Write the tracks of ten agents who walk in circles of their own for 200 frames, measured with noise of 2 cm."""
    rng = np.random.default_rng(0)
    person = np.arange(10)
    angle = np.arange(200)[:, None] * (0.04 + 0.003 * person) + person
    circle = (4 + 0.5 * person)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    xy = circle + rng.normal(0, 0.02, circle.shape)
    rows = [f"{frame} {agent} {x:.3f} {y:.3f}" for frame, scene in enumerate(xy) for agent, (x, y) in enumerate(scene)]
    Path(path).write_text("\n".join(rows) + "\n")


if __name__ == "__main__":
    path = sys.argv[1] if len(sys.argv) > 1 else str(Path(tempfile.mkdtemp()) / "tracks.txt")
    if not Path(path).exists():
        write_an_example(path)
    domain = Tracks(path)
    motion_gym.check_domain(domain)
    print(motion_gym.leak_probe("constant_velocity", domain))
    print(motion_gym.evaluate("constant_velocity", domain))
    print(f"Next: motion-gym score linear --domain own_domain:Tracks:path={path}")
