"""Makes domains, predictors and adapters from names, specs and classes."""

from __future__ import annotations

import importlib
import inspect
import os
from collections import ChainMap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from motion_gym.contract import Domain, MotionGymError, ParameterError, Predictor, SpecError, raised_at
from motion_gym.names import ADAPTERS, DOMAINS, PREDICTORS, Entry
from motion_gym.own_classes import class_hint
from motion_gym.specs import file_hint, format_spec, parse_spec, suggest, whole_number

__all__ = [
    "ADAPTERS",
    "DOMAINS",
    "PREDICTORS",
    "Entry",
    "adapter",
    "alias_of",
    "domain",
    "format_spec",
    "load_class",
    "load_object",
    "parse_spec",
    "predictor",
    "suggest",
    "whole_number",
]


def alias_of(name: str, parameters: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The alias of a predictor that implies most of its parameters, and the parameters that differ from the alias.

    >>> alias_of("erm", {"sigma": False})
    ('erm_no_sigma', {})
    >>> alias_of("modular", {"penalty": 3.0})
    ('modular_invariant', {'penalty': 3.0})

    Args:
        name: Name without an alias.
        parameters: Parameters that are not at the defaults of the class.
    """
    table = {**PREDICTORS, **ADAPTERS}
    target = table[name].target if name in table else ""
    for alias, entry in table.items():
        if entry.parameters and entry.target == target and entry.refused(parameters) is None:
            return alias, {k: v for k, v in parameters.items() if entry.parameters.get(k) != v}
    return name, dict(parameters)


def domain(spec: str | Domain, **parameters: Any) -> Domain:
    """Make a domain.

    Args:
        spec: ``"eth:alpha=64"``, ``"module:Class"``, or a domain, which is returned as it is.
        **parameters: Parameters that override those in the spec.

    Raises:
        SpecError: The name or a parameter is not known, or a value is not allowed.
    """
    return _make(spec, parameters, _DOMAIN)


def check_domain_spec(spec: str, **parameters: Any) -> None:
    """Import the class of a domain, and compare the parameters with its constructor; no domain is made.

    Raises:
        SpecError: There is no such class, it is no domain, or it lacks a parameter.
    """
    name, factory, arguments = _factory(spec, parameters, _DOMAIN)
    _check_unknown(name, _parameters_of(name, factory, "domain"), arguments, "domain")
    if inspect.isclass(factory) and not issubclass(factory, load_class(str(_DOMAIN.base))):
        raise SpecError(f"`{name}` is no domain: subclass motion_gym.RecordedDomain and define recordings.")


def predictor(spec: str | Predictor, **parameters: Any) -> Predictor:
    """Make a predictor from a name, a spec, ``"module:Class"``, or an object, which is returned as it is.

    Raises:
        SpecError: The name or a parameter is not known, or a value is not allowed.
    """
    return _make(spec, parameters, _PREDICTOR)


def adapter(spec: str | type, of: str | Predictor, **parameters: Any) -> Predictor:
    """Put an adapter around a predictor.

    Args:
        spec: A name, a spec, ``"module:Class"`` or a class of adapters, whose constructor takes ``of``.
        of: A name, a spec or a predictor; a copy of it is adapted.
        **parameters: Parameters of the adapter that override those in the spec.

    Raises:
        SpecError: A name or a parameter is not known, or a value is not allowed.
        PredictorError: The adapter cannot adapt this predictor.
    """
    if isinstance(spec, str) and "of" in parse_spec(spec)[1]:
        raise SpecError(f"`of` in `{spec}` is the predictor to adapt, which has its own argument: leave it out.")
    inner = predictor(of)
    if not isinstance(spec, str) or parse_spec(spec)[0] not in ADAPTERS:
        inner = load_class("motion_gym.stepping.harness:CheckedPredictor")(inner)  # its predict may return an array
    return _make(spec, {**parameters, "of": inner}, _ADAPTER)


def load_class(target: str, kind: str = "object") -> type:
    """Import ``module:Class``.

    Raises:
        SpecError: There is no such module or class.
    """
    loaded = load_object(target, kind)
    if not callable(loaded):
        raise SpecError(f"`{target}` is a {type(loaded).__name__}, not a class.")
    return loaded  # type: ignore[no-any-return]


def load_object(target: str, kind: str, wanted: tuple[type, ...] = (type,)) -> Any:
    """Import ``module:OBJECT``.

    Args:
        target: The module and the object.
        kind: What the object is, for messages.
        wanted: Its possible types; objects of the module that have one are named if there is no such object. ``type``
            stands for classes.

    Raises:
        SpecError: There is no such module or object.
    """
    module_name, _, name = target.partition(":")
    is_file = module_name.endswith(".py") and os.path.isfile(module_name)
    if is_file or not all(part.isidentifier() for part in (*module_name.split("."), name)):
        made_by = next((each.__name__ for each in wanted if each is not type), None)
        if hint := class_hint(target, made_by, type in wanted):
            raise SpecError(f"`{target}` is no {kind}.{hint}")
        example = "module:Class`, as in `my_package.my_module:MyClass" if type in wanted else "module:OBJECT"
        raise SpecError(f"`{target}` is no {kind}: write `{example}`.")
    try:
        module = importlib.import_module(module_name)
    except SpecError as error:
        where = raised_at(error)
        raise SpecError(f"{error}{where and f' In `{module_name}`{where}.'}") from error
    except MotionGymError:
        raise
    except (Exception, SystemExit) as error:
        missing = error.name or "" if isinstance(error, ModuleNotFoundError) else ""
        if missing and f"{module_name}.".startswith(f"{missing}."):
            file = f"{module_name.split('.')[0]}.py"
            hint = class_hint(target) or f" Run from the folder that holds {file}, or install its package."
            raise SpecError(f"There is no module `{module_name}` for the {kind} `{target}`.{hint}") from None
        if missing in ("torch", "safetensors") and module_name.startswith("motion_gym."):
            raise SpecError(
                f"The {kind} `{name}` needs PyTorch, and {missing} is not installed: "
                'pip install "motion-gym[torch]" (from a checkout: pip install ".[torch]").'
            ) from None
        raise SpecError(
            f"Importing `{module_name}` raised {type(error).__name__}: {error}{raised_at(error)}."
        ) from error
    if not hasattr(module, name):
        others = {other: value for other, value in vars(module).items() if isinstance(value, wanted)}
        own = [o for o, value in others.items() if not isinstance(value, type) or value.__module__ == module_name]
        raise SpecError(f"Module `{module_name}` has no `{name}`.{suggest(name, own or others)}")
    return getattr(module, name)


@dataclass(frozen=True)
class _Kind:
    """A kind of object that ``_make`` makes: its name, its table, its required methods and its base class."""

    name: str
    table: Mapping[str, Entry]
    methods: tuple[str, ...]
    base: str | None = None

    def check(self, thing: Any) -> Any:
        """The object, if it is of this kind; SpecError otherwise."""
        name = type(thing).__name__
        if self.base and not isinstance(thing, load_class(self.base)):
            remedy = f"subclass motion_gym.{self.base.partition(':')[2]} and define {self.methods[0]}"
            raise SpecError(f"{name} cannot be used as {self.name}: {remedy}.")
        if missing := [method for method in self.methods if not callable(getattr(thing, method, None))]:
            raise SpecError(f"{name} cannot be used as {self.name}: it has no method `{missing[0]}`.")
        return thing


_DOMAIN = _Kind("domain", DOMAINS, ("recordings",), "motion_gym.data.domains:RecordedDomain")
_PREDICTOR = _Kind("predictor", ChainMap(ADAPTERS, PREDICTORS), ("predict",))
_ADAPTER = _Kind("adapter", ADAPTERS, ("predict", "observe", "reset"))


def _make(spec: Any, parameters: dict[str, Any], kind: _Kind) -> Any:
    """An instance from a name, a spec or a class; an instance is returned as it is."""
    if not isinstance(spec, str) and not inspect.isclass(spec):
        if parameters:
            raise SpecError(f"{spec!r} is already a {kind.name}: parameters {sorted(parameters)} cannot be set on it.")
        return kind.check(spec)
    name, factory, arguments = _factory(spec, parameters, kind)
    _check_arguments(name, factory, arguments, kind.name)
    try:
        return kind.check(factory(**arguments))
    except MotionGymError:
        raise
    except (Exception, SystemExit) as error:
        raise SpecError(
            f"Making {kind.name} `{name}` raised {type(error).__name__}: {error}{raised_at(error)}."
        ) from error


def _factory(
    spec: str | type, parameters: dict[str, Any], kind: _Kind
) -> tuple[str, Callable[..., Any], dict[str, Any]]:
    """The name, the class and the arguments of a spec or a class."""
    if not isinstance(spec, str):
        return spec.__name__, spec, parameters
    name, written = parse_spec(spec)
    arguments = {**written, **parameters}
    first, colon, rest = name.partition(":")
    if first in kind.table and colon:
        meant = f"{first}:path={rest}" if first == "tracks" else f"{first}:key=value"
        raise SpecError(f"`{rest}` in `{spec}` is not a parameter. Write `{meant}`.")
    if colon:
        return name, load_class(name, kind.name), arguments
    if name not in kind.table:
        hint = class_hint(name)
        if kind is _DOMAIN:
            hint = hint or file_hint(name) or file_hint(name.partition(",")[0])
        if not hint:
            others = ((k.name, k.table) for k in (_DOMAIN, _PREDICTOR))
            known = PREDICTORS if kind is _PREDICTOR else kind.table
            hint = next((f" (It is a {other}.)" for other, table in others if name in table), suggest(name, known))
            hint += " Your own: `module:Class`."
        raise SpecError(f"There is no {kind.name} `{name}`.{hint}")
    entry = kind.table[name]
    arguments = {**entry.parameters, **arguments}
    if key := entry.refused(arguments):
        value = entry.parameters[key]
        raise SpecError(f"`{name}` stands for `{key}={value}`, so `{key}={arguments[key]}` cannot be set on it.")
    return name, load_class(entry.target, kind.name), arguments


def _check_arguments(name: str, factory: Callable[..., Any], arguments: dict[str, Any], kind: str) -> None:
    """Raise SpecError if a class does not take an argument, or needs another one."""
    known = _parameters_of(name, factory, kind)
    _check_unknown(name, known, arguments, kind)
    ordinary = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    missing = [k for k, p in known.items() if p.kind in ordinary and p.default is p.empty and k not in arguments]
    if missing == ["of"]:
        raise SpecError(
            f"`{name}` is an adapter, as it takes a predictor, `of`: name one, as `motion-gym check {name} --of "
            "linear`, or motion_gym.adapter(...)."
        )
    if missing:
        raise SpecError(f"{kind.capitalize()} `{name}` needs {', '.join(missing)}: `{name}:{missing[0]}=...`.")


def _parameters_of(name: str, factory: Callable[..., Any], kind: str) -> Mapping[str, inspect.Parameter]:
    try:
        return inspect.signature(factory).parameters
    except (TypeError, ValueError):
        raise SpecError(f"`{name}` is no {kind}: it has no signature that can be read.") from None


def _check_unknown(name: str, known: Mapping[str, inspect.Parameter], arguments: Mapping[str, Any], kind: str) -> None:
    """Raise ParameterError for an argument that a class does not take."""
    takes_any = any(p.kind is p.VAR_KEYWORD for p in known.values())
    unknown = next((key for key in arguments if key not in known and not takes_any), None)
    if unknown == "of" and kind == "adapter":
        raise SpecError(
            f"`{name}` is no adapter, as its constructor takes no predictor: let it begin `def __init__(self, "
            "of)`, and adapt a copy, `copy.deepcopy(of)`."
        )
    if unknown is not None:
        # TorchRL makes an environment without `frameskip` if the error has these words.
        words = f" (unexpected keyword argument '{unknown}')" if unknown == "frameskip" else ""
        raise ParameterError(
            f"{kind.capitalize()} `{name}` has no parameter `{unknown}`.{suggest(unknown, known)}{words}"
        )
