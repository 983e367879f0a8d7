"""The recorded versions and the commit."""

import os
import subprocess
import sys

import numpy
import pytest

from motion_gym.training.provenance import commit, versions


def test_versions_are_the_installed_ones():
    assert versions()["numpy"] == numpy.__version__
    assert versions()["python"] == ".".join(map(str, sys.version_info[:3]))


def test_commit_is_that_of_the_checkout():
    head = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=os.path.dirname(__file__), capture_output=True, text=True, check=False
    )
    if head.returncode:
        pytest.skip("this is no git checkout")
    assert commit() in (head.stdout.strip(), head.stdout.strip() + "+")
