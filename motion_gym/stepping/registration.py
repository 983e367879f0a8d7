"""Every domain as an environment of Gymnasium and of PettingZoo, under the same ids."""

from __future__ import annotations

import re
from typing import Any

import gymnasium
import pettingzoo

from motion_gym import catalog
from motion_gym.catalog import DOMAINS
from motion_gym.contract import SpecError

NAMESPACE = "motion_gym"
VERSION = "v0"
DRIVE = f"{NAMESPACE}/Drive-{VERSION}"
"""The environment in which an agent drives."""


def register_all() -> None:
    """Register ``motion_gym/<id>`` of every shipped domain in both registries; doing it again changes nothing."""
    for name, entry in DOMAINS.items():
        _register(f"{NAMESPACE}/{entry.env_id}", {"domain": name})
    if DRIVE not in gymnasium.registry:
        gymnasium.register(DRIVE, entry_point="motion_gym.driving.gymnasium_env:DriveEnv")


def register(name: str, domain: str, **parameters: Any) -> str:
    """Register a domain of your own as ``motion_gym/<name>-v0``, in Gymnasium (also for ``make_vec``) and PettingZoo.

    Registering the same domain again under its name changes nothing.

    Args:
        name: Name of the environment, as ``MyPlace``.
        domain: ``"my_module:MyDomain"``, or a spec with parameters. Environments are made from this text, in other
            processes, too; so the module must be importable there.
        **parameters: Parameters of the domain, which ``gymnasium.make`` can overwrite.

    Returns:
        The id, ``motion_gym/<name>-v0``.

    Raises:
        SpecError: the name is no name, is that of a shipped environment, or is taken by another domain; or the domain
            cannot be imported.
        ParameterError: the domain has no such parameter.
    """
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z]\w*", name, re.ASCII):
        raise SpecError(
            f"`{name}` cannot be the name of an environment: write a letter, then letters, digits or _, as `MyPlace`; "
            f"`-{VERSION}` is appended."
        )
    ids = [*(str(entry.env_id) for entry in DOMAINS.values()), DRIVE.partition("/")[2]]
    shipped = {env_id.lower(): env_id for env_id in ids}
    taken = shipped.get(f"{name}-{VERSION}".lower())
    if taken:
        raise SpecError(f"`{name}` is the name of a shipped environment, {NAMESPACE}/{taken}: choose another name.")
    if not isinstance(domain, str):
        raise SpecError(
            f"`register` takes the text `module:Class`, from which environments are made in other processes, too, not "
            f"{domain!r}."
        )
    catalog.check_domain_spec(domain, **parameters)
    env_id, arguments = f"{NAMESPACE}/{name}-{VERSION}", {"domain": domain, **parameters}
    there = gymnasium.registry.get(env_id)
    if there is not None and there.kwargs != arguments:
        raise SpecError(f"{env_id} is registered already, for {there.kwargs}: choose another name.")
    _register(env_id, arguments)
    return env_id


def _register(env_id: str, arguments: dict[str, Any]) -> None:
    if env_id not in gymnasium.registry:
        gymnasium.register(
            env_id,
            entry_point="motion_gym.stepping.gymnasium_env:WindowEnv",
            vector_entry_point="motion_gym.stepping.vector_env:WindowVectorEnv",
            kwargs=dict(arguments),
        )
    if env_id not in pettingzoo.parallel_registry:
        pettingzoo.register(
            "parallel",
            env_id,
            entry_point="motion_gym.stepping.pettingzoo_env:parallel_env",
            kwargs=dict(arguments),
        )
