"""STGAT against the released program: its forward pass, its objective, and its published weights."""

import functools
import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

import motion_gym
from motion_gym.contract import Observation, PredictorError
from motion_gym.data.storage import StorageError
from motion_gym.predictors.networks import stgat_network as network
from motion_gym.predictors.networks.graph_attention import Layout
from motion_gym.predictors.networks.stgat_released import import_released
from motion_gym.predictors.stgat import Erm, Invariant
from motion_gym.training import weight_files

SHARED = Path(os.environ.get("MOTION_GYM_SHARED", Path(__file__).resolve().parents[3] / "shared")) / "reference"
Counterfactual = functools.partial(Erm, counterfactual=True)
PUBLISHED = {"erm": Erm, "counterfactual": Counterfactual, "irm_5.0": Invariant}


def published(name):
    """A predictor with the authors' weights."""
    path = SHARED / f"causalmotion_eth_{name}_seed1.pth.tar"
    if not path.exists():
        pytest.skip(f"the published weights are not here: {path.name}")
    return PUBLISHED[name]().from_released(path)


def random_model(kind=Erm, seed=0):
    """A predictor with random weights."""
    predictor = kind()
    predictor.use(network.initial(predictor.features, seed), {})
    return predictor


def observation(sizes, seed=0, features=3):
    """Random walkers."""
    rng = np.random.default_rng(seed)
    history = np.cumsum(rng.normal(0, 0.4, (sum(sizes), 8, features)), axis=1).astype(np.float32)
    return Observation(history, np.append(0, np.cumsum(sizes)), np.arange(sum(sizes)), 0.4)


@pytest.fixture(scope="module")
def golden():
    """Inputs, draws and outputs of the released program on six scenes."""
    path = SHARED / "stgat_golden.npz"
    if not path.exists():
        pytest.skip(f"the golden numbers of the released program are not here: {path.name}")
    return {key: torch.from_numpy(value) for key, value in np.load(path).items()}


@pytest.mark.parametrize("name", PUBLISHED)
def test_stages_equal_those_of_the_released_program(golden, name):
    predictor = published(name)
    limits = golden["seq_start_end"].numpy()
    layout = Layout.of(np.append(limits[:, 0], limits[-1, 1]))
    states = [golden[name][None] for name in ("traj_h0", "traj_c0", "graph_h0", "graph_c0")]
    draws = network.Draws(torch.cat(states, dim=-1), golden["noise"][None][:, layout.scene])
    steps = golden["obs_rel"]
    first = network.stage1(steps, draws, predictor.tensors)[:, 0]
    torch.testing.assert_close(first, golden[f"{name}/stage1"], atol=1e-5, rtol=0)
    second = network.stage2(steps, draws, layout, predictor.tensors)[:, 0]
    # One scene of ERM divides by a spread near zero: float64 is 1.7e-4 away from the program's own float32 there.
    torch.testing.assert_close(second, golden[f"{name}/stage2"], atol=3e-4 if name == "erm" else 1e-5, rtol=0)
    moves = network.stage3(steps, draws, layout, predictor.tensors, predictor.counterfactual)[:, 0]
    # The golden values are float32 of one processor: another order of additions comes to 1.5e-5 after 12 steps.
    torch.testing.assert_close(moves, golden[f"{name}/stage3"], atol=5e-5, rtol=0)
    positions = golden["obs"][-1] + moves.cumsum(dim=0)
    torch.testing.assert_close(positions, golden[f"{name}/forecast"], atol=5e-5, rtol=1e-5)


ROWS = {  # ADE of the published weights on eth, k = 1 and best of 20 per scene, run with the released program
    "erm": {1: (0.958, 0.870), 8: (0.861, 0.796), 64: (2.786, 2.666)},
    "counterfactual": {1: (1.041, 0.989), 8: (0.851, 0.797), 64: (2.765, 2.683)},
    "irm_5.0": {1: (1.037, 0.934), 8: (1.100, 0.971), 64: (1.854, 1.538)},
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_weights_score_as_published(eth_ucy, name):
    predictor = published(name)
    for alpha, (single, best) in ROWS[name].items():
        card = motion_gym.evaluate(predictor, "eth", alpha=alpha, k=20)
        assert card.metrics["JADE_20"].mean == pytest.approx(best, abs=0.04)
        # The published row is one draw, which has a random error.
        seeds = [motion_gym.evaluate(predictor, "eth", alpha=alpha, seed=s).metrics["ADE"].mean for s in range(5)]
        assert np.mean(seeds) == pytest.approx(single, abs=max(0.04, 3 * np.std(seeds)))
        assert "best ADE on the source validation split" in card.selection


def test_scenes_of_any_size_are_accepted():
    predictor, seen = random_model(), observation([1, 5, 2])
    positions = predictor.predict(seen, samples=3).positions
    assert positions.shape == (8, 3, 12, 2) and np.isfinite(positions).all()


def test_stacked_models_equal_single_models():
    layout = Layout.of(np.array([0, 2, 5]))
    draws = network.Draws.from_generators([torch.Generator().manual_seed(s) for s in (0, 1)], layout)
    steps = torch.randn(8, 5, 3)
    singles = [network.initial(3, seed) for seed in (0, 1)]
    both = {key: torch.cat([w[key] for w in singles]) for key in singles[0]}
    together = network.stage3(steps, draws, layout, both)
    for m, weights in enumerate(singles):
        own = network.Draws(draws.states[m : m + 1], draws.noise[m : m + 1])
        alone = network.stage3(steps, own, layout, weights)
        torch.testing.assert_close(together[:, m : m + 1], alone, atol=1e-6, rtol=1e-5)


def test_save_and_load(tmp_path):
    predictor = random_model()
    predictor.use(predictor.stacked, {"selection": "random"})
    predictor.save(tmp_path / "model.safetensors")
    again = Erm(weights=tmp_path / "model.safetensors")
    seen = observation([3, 2])
    np.testing.assert_array_equal(predictor.predict(seen).positions, again.predict(seen).positions)
    assert again.selection == "random" and pickle.loads(pickle.dumps(again)).fitted


def test_missing_weights_and_missing_sigma_are_named():
    with pytest.raises(
        PredictorError, match=r"have no `invariant:penalty=0.125`.*Train it: motion-gym train invariant"
    ):
        Invariant(penalty=0.125).predict(observation([2]))
    with pytest.raises(PredictorError, match="needs sigma, but this domain gives only x and y"):
        random_model().predict(observation([2], features=2))


def damaged(path, how):
    """Damage a weight file."""
    if how == "truncated":
        path.write_bytes(path.read_bytes()[:1000])
    elif how == "text":
        path.write_text("not weights")
    else:
        tensors = network.initial(2 if how == "without sigma" else 3, 0)
        if how == "another model":
            tensors["extra.weight"] = tensors.pop("stage1.weight")
        if how == "NaN":
            tensors["stage3.bias"][0, 0] = float("nan")
        weight_files.write(path, tensors, {})


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("truncated", "damaged"),
        ("text", "damaged"),
        ("without sigma", "trajectory.input has shape .* expected .* with or without sigma"),
        ("another model", "weights of another model: it lacks .'stage1.weight'., and has .'extra.weight'."),
        ("NaN", "stage3.bias has values that are not finite"),
    ],
)
def test_bad_weight_files_are_refused(tmp_path, how, message):
    path = tmp_path / "model.safetensors"
    random_model().save(path)
    damaged(path, how)
    with pytest.raises(PredictorError, match=message):
        Erm(weights=path)
    with pytest.raises(PredictorError, match="There is no file"):
        Erm(weights=tmp_path / "none.safetensors")


def test_weights_and_card_of_two_trainings_are_refused(tmp_path):
    for seed in (0, 1):
        random_model(seed=seed).save(tmp_path / f"{seed}.safetensors")
    (tmp_path / "0.json").write_bytes((tmp_path / "1.json").read_bytes())
    with pytest.raises(PredictorError, match="do not belong together"):
        Erm(weights=tmp_path / "0.safetensors")
    (tmp_path / "0.json").write_text("[]")
    with pytest.raises(PredictorError, match="must hold a JSON object"):
        Erm(weights=tmp_path / "0.safetensors")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("seeds", 5, "`seeds` is 5"),
        ("seeds", [0, 0], "different whole numbers"),
        ("trained_on", "orca", "must be a list of names"),
        ("selection", [1], "must be text"),
    ],
)
def test_invalid_cards_are_refused(tmp_path, key, value, message):
    path = tmp_path / "a.safetensors"
    random_model().save(path)
    card = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps({**card, key: value}))
    with pytest.raises(PredictorError, match=message):
        Erm(weights=path)


def test_a_failed_save_keeps_the_existing_files(tmp_path):
    path = tmp_path / "a.safetensors"
    random_model().save(path)
    before = path.read_bytes(), path.with_suffix(".json").read_bytes()
    other = random_model(seed=1)
    for card in ({"best": float("nan")}, {"epoch": torch.tensor(3)}):
        with pytest.raises(StorageError, match=r"card of .* cannot be written as JSON"):
            weight_files.write(path, other.stacked, card)
    assert (path.read_bytes(), path.with_suffix(".json").read_bytes()) == before
    path.with_suffix(".json").unlink()
    path.with_suffix(".json").mkdir()
    with pytest.raises(StorageError, match="no regular file"):
        other.save(path)
    assert path.read_bytes() == before[0]
    with pytest.raises(StorageError, match="where the card goes"):
        other.save(tmp_path / "b.json")


def test_tensors_of_different_numbers_of_models_are_refused(tmp_path):
    predictor = random_model()
    uneven = {**predictor.stacked, "stage3.bias": predictor.stacked["stage3.bias"].repeat(2, 1)}
    with pytest.raises(PredictorError, match=r"tensors are of \[1, 2\] models"):
        predictor.use(uneven, {})


@pytest.mark.parametrize("name", ["../weights/spurious", "spurious/../style", "/tmp", "", "x" * 5000])
def test_names_of_weights_must_be_exact(name):
    with pytest.raises(PredictorError, match="There are no weights"):
        Erm(weights=name)


@pytest.mark.parametrize("key", [1, "a.b", "traj_lstm_model.weight_ih_l0", "gatencoder.gat_net.layer_stack.x.w"])
def test_state_dicts_of_other_models_are_refused(tmp_path, key):
    path = tmp_path / "other.pth.tar"
    torch.save({"state_dict": {key: torch.zeros(2, 2) if key != "a.b" else "x"}}, path)
    with pytest.raises(PredictorError):
        import_released(path)


def test_half_precision_is_used_for_exact_values(tmp_path):
    exact, rounded = network.initial(3, 0), {k: v.half().float() for k, v in network.initial(3, 0).items()}
    sizes = []
    for name, tensors in (("exact", exact), ("rounded", rounded)):
        path = tmp_path / f"{name}.safetensors"
        weight_files.write(path, tensors, {})
        read, _ = weight_files.read(path)
        assert all(torch.equal(read[key], tensors[key]) for key in tensors)
        sizes.append(path.stat().st_size)
    assert sizes[1] < 0.55 * sizes[0]


def test_scores_on_training_windows_are_labelled(eth_ucy):
    predictor = random_model()
    predictor.use(predictor.stacked, {"trained_on": ["hotel", "univ"]})
    assert any("trained on windows of hotel" in leak for leak in motion_gym.evaluate(predictor, "hotel:alpha=8").leaks)
    assert not any("trained on" in leak for leak in motion_gym.evaluate(predictor, "eth:alpha=8").leaks)


def test_initial_weights_are_drawn_as_in_the_released_program():
    # Compared with torch's rule for the same shapes: the largest of 20 draws is near the bound.
    torch.manual_seed(0)
    for name, shape in network.shapes(3).items():
        if not name.startswith("attention") or name.endswith("bias"):
            continue
        shape = shape if name.endswith("w") else (*shape, 1)
        draws = [torch.nn.init.xavier_uniform_(torch.empty(*shape), gain=1.414) for _ in range(20)]
        expected = torch.stack(draws).abs().max()
        largest = torch.cat([network.initial(3, seed)[name] for seed in range(20)]).abs().max()
        assert largest.item() == pytest.approx(expected.item(), rel=0.1), name


class Surprise:
    """An object that runs code when it is unpickled."""

    def __reduce__(self):
        return (print, ("code was run",))


def test_released_files_with_other_objects_are_refused(tmp_path, capsys):
    path = tmp_path / "bad.pth.tar"
    torch.save({"state_dict": {}, "surprise": Surprise()}, path)
    with pytest.raises(PredictorError, match="was refused"):
        import_released(path)
    assert "code was run" not in capsys.readouterr().out
    torch.save([1, 2], path)
    with pytest.raises(PredictorError, match="no `state_dict`"):
        import_released(path)
    with pytest.raises(PredictorError, match="There is no file"):
        import_released(tmp_path / "none.pth.tar")
