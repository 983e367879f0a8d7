"""What the wrappers share: code and weights of a checkout of somebody else's repository, run on the CPU with a seed."""

import contextlib
import hashlib
import importlib
import random
import sys
import zlib
from pathlib import Path

import numpy as np
import torch
from torch.overrides import TorchFunctionMode

from motion_gym.contract import PredictorError, SpecError

PLACES = ("eth", "hotel", "univ", "zara1", "zara2")
"""Places of ETH-UCY; each has weights that were trained on the other four."""


def import_from(repo, name):
    """Import a module of a checkout, and leave nothing behind in ``sys.modules``.

    Repositories name their modules ``model`` and ``utils``. Two checkouts can be used side by side only if neither
    finds the modules of the other.

    Args:
        repo: Folder of the checkout.
        name: Name of the module, as inside the repository.

    Raises:
        SpecError: the folder has no such module, or the module cannot be imported.
    """
    folder = Path(repo).expanduser().resolve()
    if not (folder / f"{name.replace('.', '/')}.py").is_file():
        raise SpecError(f"`repo={repo}` has no module `{name}`: give the folder of a checkout of the repository.")
    own = {path.stem for path in folder.iterdir() if path.suffix == ".py" or path.is_dir()}
    hidden = {key: sys.modules.pop(key) for key in list(sys.modules) if key.partition(".")[0] in own}
    sys.path.insert(0, str(folder))
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SpecError(f"Importing `{name}` of `repo={repo}` failed: {error}. Install what it imports.") from error
    finally:
        sys.path.remove(str(folder))
        for key in [key for key in sys.modules if key.partition(".")[0] in own]:
            del sys.modules[key]
        sys.modules.update(hidden)


class Published:
    """A network of a checkout with its published weights; a subclass defines ``pattern``, ``build`` and ``forecast``.

    Args:
        repo: Folder of the checkout. Its commit decides which weights are loaded.
        weights: Name of the weights: the place of ETH-UCY that they were not trained on.

    Attributes:
        pattern: Path of the weights file in the checkout; ``{weights}`` is their name, and ``*`` matches anything.
        fingerprint: First 16 hexadecimal digits of the sha256 of the weights file.
        trained_on: Domains that the weights were trained on.
    """

    pattern = ""

    def __init__(self, repo, weights="eth"):
        if weights not in PLACES:
            raise SpecError(f"`weights={weights}` is not known: one of {', '.join(PLACES)}.")
        self.repo, self.weights = repo, weights
        self.trained_on = tuple(place for place in PLACES if place != weights)
        pattern = self.pattern.format(weights=weights)
        files = sorted(Path(repo).expanduser().glob(pattern))
        if not files:
            raise SpecError(f"`repo={repo}` has no weights `{pattern}`: check out a commit that has them.")
        content = files[0].read_bytes()
        if content.startswith(b"version https://git-lfs"):
            raise SpecError(f"{files[0]} is a pointer of Git LFS: run `git lfs pull` in {repo}.")
        self.fingerprint = hashlib.sha256(content).hexdigest()[:16]
        # Nothing but tensors and plain values is unpickled.
        self.network = self.build(torch.load(files[0], map_location="cpu", weights_only=True))

    def __reduce__(self):
        return type(self), (self.repo, self.weights)  # networks hold lambdas: a copy loads its network anew

    @torch.no_grad()
    def predict(self, observation, samples=1, seed=0):
        """Forecasts [A, K, 12, 2], metres."""
        if not np.isclose(observation.dt, 0.4):
            raise PredictorError(
                f"The weights of {type(self).__name__} were trained at steps of 0.4 s, not {observation.dt:g} s."
            )
        return self.forecast(observation, samples, seed).astype(np.float32)


def scenes(observation, seed):
    """The agents of each scene, as a slice, with a seed of its own.

    The seed depends on the scene alone, so that a scene has the same noise by itself and in a batch.
    """
    for first, last in zip(observation.scene[:-1], observation.scene[1:], strict=True):
        yield slice(first, last), zlib.crc32(observation.xy[first:last].tobytes(), seed % 2**32)


def displacements(xy):
    """Moves between observed positions, 0 for the first: [A, 8, 2] float32.

    The published loaders round positions to 4 decimals before they subtract. Without it, two people who move alike
    differ by a rounding error, and the inverse of their difference is huge.
    """
    return np.round(np.diff(xy.astype(np.float64), axis=1, prepend=xy[:, :1]), 4).astype(np.float32)


@contextlib.contextmanager
def seeded(seed):
    """Seed the global generators, for code that draws from them, and put them back afterwards."""
    kept = random.getstate(), np.random.get_state()  # noqa: NPY002
    with torch.random.fork_rng(devices=[]):
        random.seed(seed)
        np.random.seed(seed)  # noqa: NPY002
        torch.manual_seed(seed)
        try:
            yield
        finally:
            random.setstate(kept[0])
            np.random.set_state(kept[1])  # noqa: NPY002


class OnCpu(TorchFunctionMode):
    """Runs code that names the device ``cuda`` on the CPU, as PyTorch 1.0 did.

    ``torch.full`` with a whole number gave floats then, and ``view`` took the results of an index by a mask.
    """

    def __torch_function__(self, function, types, arguments=(), keywords=None):
        """Call a function of PyTorch without its device."""
        keywords = dict(keywords or {})
        if "cuda" in str(keywords.get("device", "")):
            keywords["device"] = "cpu"
        if function is torch.full and "dtype" not in keywords:
            keywords["dtype"] = torch.float32
        if function is torch.Tensor.cuda:
            return arguments[0]
        if function is torch.Tensor.view:
            function = torch.Tensor.reshape
        return function(*arguments, **keywords)
