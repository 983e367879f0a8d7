"""Build the wheel, and compare its files with those that git tracks, and its size with the limit.

Of the weights, the wheel holds those that ``weights=auto`` can choose for the predictors with their default settings,
except ``TO_ADD``.
Of the results it holds the packed runs and the tables; figures are drawn from the runs.
"""

import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from motion_gym import catalog
from motion_gym.training.weight_files import file_name

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = {"motion_gym": "motion_gym/", "envs": "motion_gym/envs/", "predictors": "motion_gym/predictors/"}
WEIGHTS = "motion_gym/weights/"
LEFT_OUT = (".safetensors", ".svg")
"""Endings of the weights and figures."""
TO_ADD = ("spurious/hotel/", "spurious/univ/", "spurious/zara1/", "spurious/zara2/")
"""Beginnings of the names of weights that a user of the wheel adds, since there is no room for them."""
LIMIT = 20e6
"""Bytes."""


def tracked() -> set[str]:
    """Files of the three folders that git tracks, under their names in the wheel."""
    listed = subprocess.run(["git", "ls-files", *FOLDERS], cwd=ROOT, capture_output=True, text=True, check=True)
    names = (Path(line) for line in listed.stdout.splitlines() if not (ROOT / line).is_symlink())
    return {FOLDERS[name.parts[0]] + "/".join(name.parts[1:]) for name in names}


def chosen_weights() -> set[str]:
    """Files that ``weights=auto`` can choose for the predictors with their default settings."""
    predictors = [(name, catalog.load_class(entry.target)) for name, entry in catalog.PREDICTORS.items()]
    sets = [(catalog.predictor(name).name, kind.sets) for name, kind in predictors if hasattr(kind, "sets")]
    names = [f"{folder}/{file_name(row)}" for row, folders in sets for folder in folders]
    return {f"{WEIGHTS}{name}" for name in names if not name.startswith(TO_ADD)}


def packed() -> tuple[set[str], int]:
    """Files in a freshly built wheel, without its metadata, and the size of the wheel in bytes."""
    shutil.rmtree(ROOT / "build", ignore_errors=True)  # setuptools would pack what an older build left there
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, str(ROOT)]
        subprocess.run(command, check=True)
        (wheel,) = Path(folder).glob("*.whl")
        names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
        return names, wheel.stat().st_size


def main() -> None:
    """Exit with status 1 if the files differ, or the wheel is too large."""
    chosen = chosen_weights()
    expected = {name for name in tracked() if Path(name).suffix not in LEFT_OUT or name in chosen}
    found, size = packed()
    for name in sorted(expected - found):
        print(f"belongs into the wheel, and is not in it: {name}")
    for name in sorted(found - expected):
        print(f"in the wheel, and does not belong there: {name}")
    print(f"wheel: {len(found)} files, {size / 1e6:.1f} MB of at most {LIMIT / 1e6:.0f}")
    if expected != found or size > LIMIT:
        sys.exit(1)


if __name__ == "__main__":
    main()
