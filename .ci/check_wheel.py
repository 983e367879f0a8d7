"""Build the wheel, and compare the Python files in it with those that git tracks."""

import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = {"motion_gym": "motion_gym/", "envs": "motion_gym/envs/", "predictors": "motion_gym/predictors/"}


def tracked() -> set[str]:
    """Files of the three folders that git tracks, under their names in the wheel."""
    listed = subprocess.run(["git", "ls-files", *FOLDERS], cwd=ROOT, capture_output=True, text=True, check=True)
    names = (Path(line) for line in listed.stdout.splitlines() if not (ROOT / line).is_symlink())
    return {FOLDERS[name.parts[0]] + "/".join(name.parts[1:]) for name in names}


def packed() -> set[str]:
    """Files in a freshly built wheel, without its metadata."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, str(ROOT)]
        subprocess.run(command, check=True)
        (wheel,) = Path(folder).glob("*.whl")
        return {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}


def main() -> None:
    """Exit with status 1 if the two differ."""
    expected, found = tracked(), packed()
    for name in sorted(expected - found):
        print(f"tracked, but not in the wheel: {name}")
    for name in sorted(found - expected):
        print(f"in the wheel, but not tracked: {name}")
    if expected != found:
        sys.exit(1)
    print(f"wheel: the {len(found)} files that git tracks, and nothing else")


if __name__ == "__main__":
    main()
