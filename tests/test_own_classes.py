"""A class or a file of one's own that is named in another form than `module:Class`."""

import pytest

from motion_gym import catalog
from motion_gym.contract import SpecError


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("steady.py:Damped", "Write `steady:Damped`, without .py."),
        ("nowhere.py:Damped", "Write `nowhere:Damped`, without .py, and run from the folder that holds nowhere.py."),
        ("sub/other.py:Damped", "Write `sub.other:Damped`, without .py."),
        ("/a/folder/other.py:Damped", "Write `other:Damped`, without .py, and run from /a/folder."),
        ("steady", "steady.py is here: write `steady:Damped` or `steady:Still`."),
        ("steady.py", "steady.py is here: write `steady:Damped` or `steady:Still`."),
        ("sub.other", "sub/other.py is here: write `sub.other:Class`."),
        ("steady.Damped", "Did you mean `steady:Damped`?"),
        ("steady:Damped,damping=0.9", "Write `steady:Damped:damping=0.9`."),
        ("steady:Damped(damping=0.9,k=(1, 2))", "Write `steady:Damped:damping=0.9,k=(1, 2)`."),
        ("steady.py:Damped,damping=0.9", "Write `steady:Damped:damping=0.9`."),
        ("steady::Damped", "Write `steady:Damped`."),
    ],
)
@pytest.mark.parametrize("make", [catalog.predictor, catalog.domain, lambda name: catalog.adapter(name, "linear")])
def test_a_class_that_is_named_in_another_form(tmp_path, monkeypatch, make, name, message):
    """The files raise when they are run."""
    (tmp_path / "steady.py").write_text("class Damped: ...\nclass Still: ...\nclass _Own: ...\nraise SystemExit\n")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "other.py").write_text("class Damped(:\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SpecError) as error:
        make(name)
    assert str(error.value).endswith(message)


@pytest.mark.parametrize("name", ["walk.csv", "walk.csv:fps=25", "walk.csv,fps=25"])
def test_a_file_as_a_domain(tmp_path, monkeypatch, name):
    (tmp_path / "walk.csv").write_text("frame,id,x,y\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SpecError, match=r"There is no domain .*: write `tracks:path=walk.csv`, with fps=25"):
        catalog.domain(name)
