"""The wrappers of published forecasters: on stand-ins with the interface of the repositories, and on real checkouts."""

import copy
import pickle
import random
import sys
from pathlib import Path

import numpy as np
import pytest

import motion_gym
from motion_gym.contract import Observation, PredictorError, SpecError

torch = pytest.importorskip("torch")
checkouts = pytest.importorskip("examples.published.checkouts")

ROOT = Path(__file__).resolve().parent.parent
STGCNN = """
import torch
from utils import AHEAD

class social_stgcnn(torch.nn.Module):
    def __init__(self, n_stgcnn, n_txpcnn):
        super().__init__()
        self.gain, self.shape = torch.nn.Parameter(torch.zeros(1)), lambda v: v
    def forward(self, v, a):
        assert v.shape[1:3] == (2, 8) and a.shape == (8, v.shape[3], v.shape[3])
        mean = (self.gain * v[:, :, -1:]).expand(-1, -1, AHEAD, -1)
        return torch.cat([mean, torch.full_like(mean, -9.0), torch.zeros_like(mean[:, :1])], dim=1), a
"""
TERN = """
import numpy as np
import torch

class BatchKMeans(torch.nn.Module):
    pass

class graph_tern(torch.nn.Module):
    def __init__(self, n_trcnn):
        super().__init__()
        self.n_smpl, self.gain = 20, torch.nn.Parameter(torch.zeros(1))
    def forward(self, s, pruning, clustering):
        step = self.gain * s[0, 1, -1]
        noise = torch.randn(self.n_smpl, 1, 1, 1, device="cuda") * 1e-3 + np.random.rand() * 1e-3
        paths = s[0, 0, -1] + step * torch.arange(1, 13, device="cuda")[:, None, None] + noise
        return None, None, paths, torch.ones(1, device="cuda")
"""


def checkout(folder, files, weights):
    """A stand-in for a checkout: modules, and a state dict whose gain of 1 makes forecasts go straight on."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    path = folder / weights
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"gain": torch.ones(1)}, path)
    return folder


@pytest.fixture
def stgcnn(tmp_path):
    from examples.published.social_stgcnn import SocialStgcnn

    files = {"model.py": STGCNN, "utils.py": "AHEAD = 12"}
    return SocialStgcnn(str(checkout(tmp_path / "a, b", files, "checkpoint/social-stgcnn-hotel/val_best.pth")), "hotel")


@pytest.fixture
def tern(tmp_path):
    from examples.published.graph_tern import GraphTern

    path = "checkpoint/graph-tern_eth_experiment/eth_best.pth"
    return GraphTern(str(checkout(tmp_path / "tern", {"graphtern/model.py": TERN}, path)))


@pytest.fixture(params=["stgcnn", "tern"])
def wrapper(request):
    return request.getfixturevalue(request.param)


def observation(dt=0.4, far=0.0):
    """Scenes of 1, 3 and 2 people; the first stands still."""
    rng = np.random.default_rng(3)
    steps = rng.uniform(-0.5, 0.5, (6, 1, 2)) * np.array([0, 1, 1, 1, 1, 1])[:, None, None]
    xy = rng.uniform(-5, 5, (6, 1, 2)) + np.arange(8)[:, None] * np.round(steps, 4) + far
    return Observation(xy.astype(np.float32), np.array([0, 1, 4, 6]), np.arange(6), dt)


@pytest.mark.parametrize(("far", "limit"), [(0.0, 0.01), (1e5, 0.15)])
def test_forecasts_go_on_from_the_last_position_of_each_agent(wrapper, far, limit):
    seen = observation(far=far)
    forecast = wrapper.predict(seen, samples=5, seed=2)
    assert forecast.shape == (6, 5, 12, 2) and forecast.dtype == np.float32
    straight = seen.xy[:, -1:] + np.arange(1, 13)[:, None] * (seen.xy[:, -1:] - seen.xy[:, -2:-1])
    assert np.abs(forecast - straight[:, None]).max() < limit


def test_a_wrapper_keeps_the_contract(wrapper):
    motion_gym.check_predictor(wrapper)
    assert wrapper.selection.startswith("published weights")
    assert wrapper.weights not in wrapper.trained_on and len(wrapper.trained_on) == 4


def test_a_scene_has_the_same_samples_alone_and_in_a_batch(wrapper):
    seen = observation()
    alone = Observation(seen.history[1:4], np.array([0, 3]), seen.agent[1:4], 0.4)
    one, other = wrapper.predict(seen, 4, 7)[1:4], wrapper.predict(alone, 4, 7)
    assert np.abs(one - other).max() < 1e-5
    assert np.abs(one - wrapper.predict(alone, 4, 8)).max() > 1e-5


def test_copies_and_pickles_load_the_network_anew(wrapper):
    seen = observation()
    for other in (copy.deepcopy(wrapper), pickle.loads(pickle.dumps(wrapper))):
        assert other.network is not wrapper.network and other.fingerprint == wrapper.fingerprint
        assert np.array_equal(other.predict(seen, 2, 1), wrapper.predict(seen, 2, 1))


def test_weights_of_another_step_are_refused(wrapper):
    with pytest.raises(PredictorError, match=r"steps of 0.4 s, not 0.1 s"):
        wrapper.predict(observation(dt=0.1))


def test_the_path_of_a_checkout_is_given_in_a_spec(stgcnn):
    spec = f"examples.published.social_stgcnn:SocialStgcnn:repo='{stgcnn.repo}',weights=hotel,mean=true"
    made = motion_gym.predictor(spec)
    assert "a, b" in made.repo and made.predict(observation(), samples=3).shape == (6, 1, 12, 2)


def test_checkouts_with_modules_of_the_same_name_do_not_meet(tmp_path):
    sys.modules["utils"] = own = type(sys)("utils")
    try:
        values = []
        for value in (1, 2):
            folder = tmp_path / str(value)
            folder.mkdir()
            (folder / "model.py").write_text("from utils import VALUE")
            (folder / "utils.py").write_text(f"VALUE = {value}")
            values.append(checkouts.import_from(folder, "model").VALUE)
        assert values == [1, 2] and sys.modules["utils"] is own and "model" not in sys.modules
        assert not {str(tmp_path / "1"), str(tmp_path / "2")} & set(sys.path)
    finally:
        del sys.modules["utils"]


def test_what_is_wrong_with_a_checkout_is_said(tmp_path, stgcnn):
    kind = type(stgcnn)
    with pytest.raises(SpecError, match="check out a commit that has them"):
        kind(str(tmp_path))
    with pytest.raises(SpecError, match="`weights=zara3` is not known"):
        kind(stgcnn.repo, "zara3")
    path = Path(stgcnn.repo) / "checkpoint" / "social-stgcnn-hotel" / "val_best.pth"
    (Path(stgcnn.repo) / "model.py").write_text("import no_such_module_of_anybody")
    with pytest.raises(SpecError, match="Install what it imports"):
        kind(stgcnn.repo, "hotel")
    (Path(stgcnn.repo) / "model.py").unlink()
    with pytest.raises(SpecError, match="has no module `model`"):
        kind(stgcnn.repo, "hotel")
    path.write_text("version https://git-lfs.github.com/spec/v1\n")
    with pytest.raises(SpecError, match="git lfs pull"):
        kind(stgcnn.repo, "hotel")


def test_global_generators_are_put_back():
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002
    torch.manual_seed(1)
    expected = random.random(), np.random.rand(), torch.rand(1).item()  # noqa: NPY002
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002
    torch.manual_seed(1)
    drawn = []
    for _ in range(2):
        with checkouts.seeded(5):
            drawn.append((random.random(), np.random.rand(), torch.rand(1).item()))  # noqa: NPY002
    assert drawn[0] == drawn[1] != expected
    assert (random.random(), np.random.rand(), torch.rand(1).item()) == expected  # noqa: NPY002


def test_quick_k_means_ends_where_every_centre_is_the_mean_of_its_points():
    from examples.published.graph_tern import _quick

    class Settings:
        n_clusters, max_iter, tol = 4, 300, 1e-12

    rng = np.random.default_rng(0)
    data = torch.from_numpy(rng.normal(size=(3, 2, 200))).float()
    quick = _quick(Settings)()
    with checkouts.seeded(1):
        quick.fit(data)
    nearest = (data[:, :, :, None] - quick.centroids[:, :, None]).norm(dim=1).argmin(dim=2)
    means = [[data[a][:, nearest[a] == k].mean(dim=1) for k in range(4)] for a in range(3)]
    assert torch.allclose(quick.centroids, torch.stack([torch.stack(m, dim=1) for m in means]), atol=1e-4)
    with checkouts.seeded(1):
        quick.fit(torch.zeros(3, 2, 200))  # people who stand still: all points are one
    assert torch.equal(quick.centroids, torch.zeros(3, 2, 4))


@pytest.mark.parametrize(
    ("spec", "domain", "k", "ade"),
    [
        ("social_stgcnn:SocialStgcnn:repo=checkouts/Social-STGCNN-first", "eth", 20, 0.65),
        ("graph_tern:GraphTern:repo=checkouts/GraphTERN", "eth", 20, 0.39),
        ("sr_lstm:SrLstm:repo=checkouts/SR-LSTM", "eth", 1, 0.99),
    ],
)
def test_published_weights_give_the_published_errors(eth_ucy, monkeypatch, spec, domain, k, ade):
    """Tolerance: the spread of the errors of eth over seeds of the samples."""
    if not (ROOT / spec.partition("repo=")[2]).is_dir():
        pytest.skip("a checkout is missing: see examples/published/README.md")
    monkeypatch.chdir(ROOT)
    card = motion_gym.evaluate(f"examples.published.{spec}", domain, k=k)
    assert card.metrics[f"minADE_{k}" if k > 1 else "ADE"].mean == pytest.approx(ade, abs=0.04)
    assert not card.leaks and "published weights" in card.selection
