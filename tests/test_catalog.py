"""Names, specs and objects: what becomes an instance, and what is said to whom misspelt one."""

import ast
import keyword
import math
import sys
from pathlib import Path

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from motion_gym import catalog
from motion_gym.contract import PredictorError, SpecError
from motion_gym.data.domains import RecordedDomain
from motion_gym.stepping.harness import guarded

fast = settings(max_examples=100, deadline=None)
names = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)
values = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(codec="ascii"), max_size=8),
    st.text("',\"=:()[]\\ a1", max_size=8),
    st.lists(st.integers(), max_size=3).map(tuple),
)


class Needs(RecordedDomain):
    """A domain and predictor with a required and a positional argument."""

    def __init__(self, a, b=2):
        self.a, self.b = a, b

    def predict(self, observation, samples=1, seed=0):
        raise NotImplementedError


class Open:
    """Takes whatever it is given."""

    def __init__(self, **anything):
        self.anything = anything

    predict = Needs.predict


class Opens:
    def __init__(self, path):
        self.content = Path(path).read_bytes()


class Broken:
    def __init__(self):
        raise TypeError("a fault of its own")

    predict = Needs.predict


class Positional:
    def __init__(self, a, /):
        self.a = a

    predict = Needs.predict


class Nothing:
    pass


HERE = "motion_gym_test_catalog"
not_a_class = 3


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.setitem(sys.modules, HERE, sys.modules[__name__])


@fast
@example("eth", {"k": "64"})
@example("eth", {"k": "true", "j": " padded ", "i": ""})
@example("m:C", {"k": "a:b=c", "j": "'quoted'"})
@given(st.one_of(names, st.builds("{}:{}".format, names, names)), st.dictionaries(names, values, max_size=3))
def test_a_spec_is_read_back_as_it_was_written(name, parameters):
    assume(not any(keyword.iskeyword(key) for key in parameters))
    read = catalog.parse_spec(catalog.format_spec(name, parameters))
    assert read == (name, parameters)
    assert [type(v) for v in read[1].values()] == [type(v) for v in parameters.values()]


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        ("eth", ("eth", {})),
        (" eth : alpha = 64 ", ("eth", {"alpha": 64})),
        ("orca:d=0.6,agents=4", ("orca", {"d": 0.6, "agents": 4})),
        ("linear:sigma=True", ("linear", {"sigma": True})),
        ("linear:sigma=false", ("linear", {"sigma": False})),
        ("eth:sigma=past,alpha=None", ("eth", {"sigma": "past", "alpha": None})),
        ("a.b:C:path=/tmp/x:y", ("a.b:C", {"path": "/tmp/x:y"})),
        ("eth:alpha=1e1,", ("eth", {"alpha": 10.0})),
        ("m:C:path='a,b.txt',dt=0.1", ("m:C", {"path": "a,b.txt", "dt": 0.1})),
        ("m:C:path='2024'", ("m:C", {"path": "2024"})),
        (
            "m:C:columns=(0, 1, 2, 4),of='modular:seed=2,past=3'",
            ("m:C", {"columns": (0, 1, 2, 4), "of": "modular:seed=2,past=3"}),
        ),
        ("m:C:name=don't,k=it's", ("m:C", {"name": "don't", "k": "it's"})),
    ],
)
def test_parse(spec, expected):
    assert catalog.parse_spec(spec) == expected


@pytest.mark.parametrize(
    "spec", ["eth:alpha=8,sigma", "eth:al pha=8", "m:C:x", "eth:=3", "eth:reference-share=.1", "tracks:fps=2,unit"]
)
def test_what_is_no_parameter_is_quoted(spec):
    with pytest.raises(SpecError, match=r"is not a parameter. Write `name:key=value"):
        catalog.parse_spec(spec)


@pytest.mark.parametrize(
    ("spec", "written"),
    [
        ("tracks:walk.csv,fps=25", "tracks:path=walk.csv,fps=25"),
        ("tracks:fps=25,walk.csv", "tracks:fps=25,path=walk.csv"),
    ],
)
def test_a_file_without_its_key(spec, written):
    with pytest.raises(SpecError, match=f"`walk.csv` in `{spec}` is not a parameter. Write `{written}`.$"):
        catalog.parse_spec(spec)


def test_a_path_that_holds_a_comma_is_to_be_quoted():
    with pytest.raises(SpecError, match=r"`b\.csv` in .* quote text that holds a comma"):
        catalog.parse_spec("tracks:path=a,b.csv,fps=25")


def test_a_parameter_given_twice_is_refused():
    with pytest.raises(SpecError, match="`alpha` is twice in `eth:alpha=8,alpha=64`"):
        catalog.parse_spec("eth:alpha=8,alpha=64")


@pytest.mark.parametrize(("spec", "rest"), [("orca:0.6", "0.6"), ("orca:d", "d"), ("orca:", "")])
def test_a_value_without_a_key(spec, rest):
    with pytest.raises(SpecError, match=f"`{rest}` in `{spec}` is not a parameter. Write `orca:key=value`"):
        catalog.domain(spec)


@pytest.mark.parametrize(("wrong", "meant"), [("ETH", "eth"), ("hotl", "hotel"), ("Zara_1", "zara1"), ("orka", "orca")])
def test_did_you_mean(wrong, meant):
    with pytest.raises(SpecError, match=f"There is no domain `{wrong}`. Did you mean `{meant}.*Known: .*module:Class"):
        catalog.domain(wrong)


def test_nothing_close_lists_what_is_known():
    with pytest.raises(SpecError) as error:
        catalog.predictor("xyzzy")
    assert "Did you mean" not in str(error.value)
    assert all(name in str(error.value) for name in catalog.PREDICTORS)


def test_an_unknown_predictor_is_told_of_predictors_alone():
    with pytest.raises(SpecError) as error:
        catalog.predictor("liner")
    assert "Did you mean `linear`?" in str(error.value) and "constant_turn" in str(error.value)
    known = str(error.value).partition("Known: ")[2]
    assert not [name for name in catalog.ADAPTERS if name not in catalog.PREDICTORS and f" {name}," in known]


def test_suggest_without_anything_allowed():
    assert catalog.suggest("x", []) == " Known: none."


def test_unknown_parameters_name_the_nearest():
    with pytest.raises(SpecError, match=r"Predictor `linear` has no parameter `rigde`. Did you mean `ridge`"):
        catalog.predictor("linear:rigde=2")
    with pytest.raises(SpecError, match=r"Domain `orca` has no parameter `D`. Did you mean `d`.* speed\.$"):
        catalog.domain("orca", D=0.3)


def test_torchrl_recognises_that_frames_cannot_be_skipped():
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
        catalog.domain("orca", frameskip=2)


def test_keyword_arguments_win_over_the_spec():
    assert catalog.predictor("linear:ridge=2,sigma=true", ridge=3).ridge == 3


@pytest.mark.parametrize("table", ["DOMAINS", "PREDICTORS"])
def test_every_row_of_the_tables_is_a_class_with_a_summary(table):
    for entry in getattr(catalog, table).values():
        assert isinstance(catalog.load_class(entry.target), type)
        assert entry.summary


def test_an_alias_stands_for_parameters(monkeypatch):
    entry = catalog.Entry("motion_gym.predictors.linear:Linear", "with sigma", parameters={"sigma": True})
    monkeypatch.setitem(catalog.PREDICTORS, "linear_sigma", entry)
    made = catalog.predictor("linear_sigma:ridge=2")
    assert (made.sigma, made.ridge) == (True, 2)
    assert catalog.predictor("linear_sigma", sigma=True).sigma
    with pytest.raises(SpecError, match="`linear_sigma` stands for `sigma=True`, so `sigma=False` cannot be set"):
        catalog.predictor("linear_sigma:sigma=false")


def test_module_and_class():
    made = catalog.predictor(f"{HERE}:Needs:a=1,b=x")
    assert (type(made).__name__, made.a, made.b) == ("Needs", 1, "x")
    assert catalog.predictor(f"{HERE}:Open:any=1", more=2).anything == {"any": 1, "more": 2}


def test_a_class_and_an_instance():
    made = catalog.predictor(Needs, a=1)
    assert made.a == 1
    assert catalog.predictor(made) is made
    assert catalog.domain(made) is made
    with pytest.raises(SpecError, match=r"already a predictor: parameters \['a'\] cannot be set"):
        catalog.predictor(made, a=2)


@pytest.mark.parametrize("spec", [f"{HERE}:Needs", f"{HERE}:Needs:b=3", Needs])
def test_missing_parameters_are_named(spec):
    with pytest.raises(SpecError, match="needs a: "):
        catalog.predictor(spec)


def test_unknown_parameters_of_a_class_are_named():
    with pytest.raises(SpecError, match="has no parameter `c`"):
        catalog.predictor(Needs, a=1, c=3)


def test_a_constructors_own_error_says_where_it_is():
    with pytest.raises(
        SpecError, match=r"raised TypeError: a fault of its own \(test_catalog.py, line \d+\)"
    ) as caught:
        catalog.predictor(f"{HERE}:Broken")
    assert isinstance(caught.value.__cause__, TypeError)


@pytest.mark.parametrize("make", [lambda: guarded(Needs(1), "predict"), lambda: catalog.predictor(Positional)])
def test_a_call_with_other_arguments_names_no_line_of_this_package(make):
    with pytest.raises((PredictorError, SpecError), match=r"missing 1 required positional argument: '\w+'\."):
        make()


def test_a_syntax_error_names_the_users_file_alone(tmp_path, monkeypatch):
    (tmp_path / "unfinished.py").write_text("class P:\n    def predict(self:\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SpecError, match=r"raised SyntaxError: [^(]*'\(' was never closed \(unfinished.py, line 2\)\.$"):
        catalog.predictor("unfinished:P")


def test_a_fault_in_a_library_names_the_line_that_called_it():
    with pytest.raises(SpecError, match=r"raised FileNotFoundError: .*nowhere.*\(test_catalog.py, line \d+\)"):
        catalog.predictor(f"{HERE}:Opens:path=nowhere")


def test_missing_modules_and_classes():
    with pytest.raises(
        SpecError, match=r"There is no module `no_such.module`.*Run from the folder that holds no_such.py"
    ):
        catalog.predictor("no_such.module:Class")
    with pytest.raises(SpecError, match=r"has no `Nedes`. Did you mean `Needs`"):
        catalog.predictor(f"{HERE}:Nedes")


def test_a_module_that_imports_something_missing_says_so_itself(tmp_path, monkeypatch):
    (tmp_path / "half_installed.py").write_text("import surely_not_there\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SpecError, match=r"raised ModuleNotFoundError.*surely_not_there.*\(half_installed.py, line 1\)"):
        catalog.predictor("half_installed:Class")


@pytest.mark.parametrize("spec", [":Class", "module:", ".relative:Class", "a..b:C", "a b:C", "a:B:C"])
def test_what_cannot_be_module_and_class(spec):
    with pytest.raises(SpecError):
        catalog.predictor(spec)


@pytest.mark.parametrize("thing", [None, 3, Nothing(), Nothing, f"{HERE}:Nothing", f"{HERE}:not_a_class"])
@pytest.mark.parametrize("make", [catalog.predictor, catalog.domain])
def test_what_has_not_the_methods(thing, make):
    with pytest.raises(
        SpecError, match=r"has no method|not a class|subclass motion_gym.RecordedDomain and define recordings"
    ):
        make(thing)


def test_values_that_are_not_finite_are_text():
    assert catalog.parse_spec("x:k=inf") == ("x", {"k": "inf"})
    assert not math.isfinite(float(catalog.parse_spec("x:k=inf")[1]["k"]))


@pytest.mark.parametrize("path", sorted(Path(catalog.__file__).parent.glob("*.py")), ids=lambda path: path.stem)
def test_domains_and_predictors_are_named_and_never_imported(path):
    nodes = list(ast.walk(ast.parse(path.read_text())))
    imported = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            imported += [f"{node.module}.{alias.name}" for alias in node.names]
    assert not [name for name in imported if name.startswith(("motion_gym.envs", "motion_gym.predictors"))]
