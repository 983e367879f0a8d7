"""Tutorials: the time that the commands of each take in an empty folder, with an empty cache.

Run it with ``python bench/tutorials.py`` (about two minutes). Writing, reading and installing are not counted.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

from machine import machine

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.test_tutorials import PAGES
from tests.tutorials import follow


def main():
    print(machine(), end="\n\n")
    print("| tutorial | seconds |")
    print("|---|---:|")
    for page in PAGES:
        with tempfile.TemporaryDirectory() as folder:
            os.environ["MOTION_GYM_CACHE"] = f"{folder}/cache"
            (Path(folder) / "work").mkdir()
            begin = time.perf_counter()
            follow(page, Path(folder) / "work")
            print(f"| docs/{page} | {time.perf_counter() - begin:.0f} |", flush=True)


if __name__ == "__main__":
    main()
