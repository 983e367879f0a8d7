"""Real data for the tests, if it lies beside the checkout, and a cache for the test run."""

import os
import signal
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SHARED = Path(os.environ.get("MOTION_GYM_SHARED", ROOT.parent / "shared"))

os.environ.setdefault("MPLBACKEND", "Agg")
signal.signal(signal.SIGINT, signal.default_int_handler)  # commands in the background of a shell ignore Ctrl-C
if "MOTION_GYM_DATA" not in os.environ and (SHARED / "data" / "eth_ucy").is_dir():
    os.environ["MOTION_GYM_DATA"] = str(SHARED / "data")


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory):
    """Cache scenes in a folder of the test run, one for all of its workers."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    os.environ["MOTION_GYM_CACHE"] = str(folder / "cache")


@pytest.fixture(scope="session")
def eth_ucy():
    """Skip a test if ETH-UCY is not on this computer."""
    from motion_gym.data import datasets

    missing = [state.file for state in datasets.verify("eth_ucy") if state.state != "ok"]
    if missing:
        pytest.skip(f"ETH-UCY is not here ({', '.join(missing)}): motion-gym data fetch eth_ucy")


@pytest.fixture(scope="session")
def sdd():
    """Skip a test if the Stanford Drone Dataset, in both forms and with its images, is not on this computer."""
    from motion_gym.data import datasets

    needed = [
        *("windows/train.csv", "windows/test.csv", "windows/labels.csv", "estimated_scales.yaml"),
        *(f"raw/{clip}/annotations.txt" for clip in ("quad/video0", "quad/video1", "quad/video3", "hyang/video8")),
        *("raw/hyang/video9/annotations.txt", "raw/deathCircle/video2/annotations.txt"),
        *("reference/quad_0.jpg", "masks/quad_0.png"),
    ]
    missing = set(needed) - set(datasets.present("sdd", needed))
    if missing:
        pytest.skip(f"SDD is not here ({', '.join(sorted(missing))}): motion-gym data add sdd --from DIR")
