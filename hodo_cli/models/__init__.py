"""The mechanics. A model is one file, found by scanning this folder and those in it: to add one,
add a file, or name one of your own. Imports schema and arithmetic only; knows no solver, result or
plot."""

import hashlib
import os
import pkgutil
import sys
import traceback
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from .. import HodoError
from .base import Model
from .constants import attributes, in_unit, rescaled
from .leg_time import VELOCITY

OWN = "HODO_MODELS"
"""The variable of the environment with the user's own files, separated as in PATH: worker processes
inherit it."""

GROUP = "hodo.models"
"""The entry points of installed packages that name a module with models."""


def _is_form(item: type[Model]) -> bool:
    """Whether a class states a form that a case can name: a class that only stands in for one, or
    has no model's name yet, does not."""
    return "form" in vars(item) and hasattr(item, "name")


def _forms(module: ModuleType) -> Iterator[type[Model]]:
    """The forms that a module itself defines, not those that it builds on."""
    for item in vars(module).values():
        if getattr(item, "__module__", "") != module.__name__ or not isinstance(item, type):
            continue
        if issubclass(item, Model) and _is_form(item):
            yield item


@cache
def catalogue() -> dict[str, dict[str, type[Model]]]:
    """Every model class by its YAML name and form; the first form of a model is its default.

    Raises HodoError if an installed package's models cannot be loaded, or one is there already.
    """
    forms_by_name: dict[str, dict[str, type[Model]]] = {}
    for info in pkgutil.walk_packages(__path__, f"{__name__}."):
        for item in _forms(import_module(info.name)):
            forms_by_name.setdefault(item.name, {})[item.form] = item
    for source, module, _ in _added_modules():
        for item in _forms(module):
            # Which of two is meant would depend on the order of files.
            if item.form in forms_by_name.get(item.name, {}):
                message = f"there is already a model {item.name!r} with the form {item.form!r}"
                raise HodoError(f"{source}: {message}")
            forms_by_name.setdefault(item.name, {})[item.form] = item
    for forms in forms_by_name.values():
        add_averaged(forms)
    return forms_by_name


def add_averaged(forms: dict[str, type[Model]]) -> None:
    """Give a body-frame model that states only its full form an averaged one."""
    if "averaged" in forms or "full" not in forms:
        return
    make = import_module(f"{__name__}.averaging.any_torque")
    # The means over a turn know of no other state than omega.
    if issubclass(full := forms["full"], make.BodyFrame) and full.state == make.BodyFrame.state:
        forms["averaged"] = make.averaged_form(full)


@cache
def added_models_digest(name: str = "") -> str:
    """The digest of the sources of models that are not hodo's: of those with a name, or of all;
    empty if there are none."""
    return " ".join(digest for _, _, digest in (_modules_with(name) if name else _added_modules()))


AddedModule = tuple[str, ModuleType, str]
"""Where a module with models comes from, the module, and the digest of its source."""


@cache
def _added_modules() -> tuple[AddedModule, ...]:
    """The modules of the user's own files and of installed packages, all with a model."""
    added = list(_own_modules)
    for point in entry_points(group=GROUP):
        source = f"{point.value} (entry point {point.name})"
        try:
            module = import_module(point.module)
            text = Path(str(module.__file__)).read_bytes()
        except Exception as error:
            raise HodoError(f"{source}: {type(error).__name__}: {error}") from error
        added.append((source, module, hashlib.sha256(text).hexdigest()))
    for source, module, _ in added:
        if not (forms := [*_forms(module)]):
            raise HodoError(f"{source}: there is no model in it (a class with `name` and `form`)")
        for form in forms:
            if message := _class_mistake(form):
                raise HodoError(f"{source}: {form.__name__}: {message}")
    return tuple(added)


def _class_mistake(form: type[Model]) -> str:
    """The mistake in the attributes of a class; empty if there is none."""
    for name in ("name", "form"):
        if not isinstance(getattr(form, name), str):
            return f"its {name} is no text: {getattr(form, name)!r}"
    taken = {field.name for field in fields(form) if field.init}
    if "__dataclass_fields__" not in vars(form) or form.keys.keys() != taken:
        named = ", ".join(sorted(form.keys.keys() ^ taken))
        return f"it is a frozen dataclass with a field for each of its `keys`; see {named or 'it'}"
    return ""


def _modules_with(name: str) -> list[AddedModule]:
    """The modules that are not hodo's and state a model of this name."""
    return [
        module for module in _added_modules() if name in {form.name for form in _forms(module[1])}
    ]


def _load(path: str, name: str) -> AddedModule:
    """A file of the user's own as a module of this package.

    Raises HodoError, one line with the place, if it cannot be read or run.
    """
    module = ModuleType(f"{__name__}.{name}")
    module.__file__, module.__package__ = path, __name__
    # Before it runs, because `dataclass` looks its module up.
    sys.modules[module.__name__] = module
    try:
        # Read once, so that the text hashed is the text run, even if the file is edited meanwhile.
        text = Path(path).read_bytes()
        exec(compile(text, path, "exec"), vars(module))
    except OSError as error:
        raise HodoError(f"{path}: {str(error.strerror).lower()}") from None
    except SyntaxError as error:
        raise HodoError(f"{path}:{error.lineno or 1}: {error.msg}") from None
    except Exception as error:
        raise HodoError(_located(error, path)) from error
    return path, module, hashlib.sha256(text).hexdigest()


def _located(error: Exception, path: str) -> str:
    """An error that a file raises, after the line where it did."""
    lines = [at.lineno for at in traceback.extract_tb(error.__traceback__) if at[0] == path]
    message = f"{type(error).__name__}: {error}".partition("\n")[0]
    if isinstance(error, AttributeError) and isinstance(error.obj, SimpleNamespace):
        known = ", ".join(vars(error.obj))
        message = f"there is no constant {error.name!r} (`constants` has: {known})"
    return f"{path}:{lines[-1] if lines else 1}: {message}"


def mistake_in(system: Model) -> str:
    """The mistake in equations that are not hodo's, tried at the start of a motion; empty if there
    is none."""
    modules = _modules_with(system.name)
    if not modules:
        return ""
    path = str(modules[0][1].__file__)
    try:
        message = _equations_mistake(system)
    except ArithmeticError:
        return ""  # that is for the numbers of a case to answer, not for its equations
    except NotImplementedError:
        message = f"the model {system.name} states no rhs"
    except Exception as error:
        return _located(error, path)
    return f"{path}: {message}" if message else ""


def _equations_mistake(system: Model) -> str:
    """Why the rates of a motion at its start do not fit its state or its `degree`; empty if they
    do."""
    k: dict[str, Any] = {**system.constants}
    if strange := [name for name in system.degree if name not in k]:
        return f"`degree` names {strange[0]!r}, but `constants` has: {', '.join(k)}"
    if strange := [name for name in system.state_degree if name not in system.state]:
        return f"`state_degree` names {strange[0]!r}, but `state` has: {', '.join(system.state)}"
    if strange := [name for name, d in system.state_degree.items() if d not in range(100)]:
        return f"`state_degree` of {strange[0]!r} is no whole number from 0 on"
    start = np.array(system.start)
    rates = system.rhs(0.0, start.tolist(), attributes(k))
    if len(rates) != len(system.state) or len(start) != len(system.state):
        return f"rhs gives {len(rates)} rates for {len(start)} variables of the state"
    # The same motion in a unit of velocity that is four times as large, 2**2.
    other = k | {name: in_unit(k[name], 2 * degree - 2) for name, degree in system.degree.items()}
    other |= {VELOCITY: 4.0} if VELOCITY in k else {}
    scaled = rescaled(type(system), start, -2)
    again = rescaled(type(system), np.array(system.rhs(0.0, scaled.tolist(), attributes(other))), 2)
    apart = np.abs(np.array(rates) - again).max()
    if system.degree and apart > 1e-9 * np.abs(rates).max():
        return "`degree` does not fit rhs: with the constants of other units it gives other rates"
    return ""


def find(name: str, form: str) -> type[Model]:
    """The class of one form of a model.

    Raises HodoError for a model or form that is not there (a result file of another version, say).
    """
    try:
        return catalogue()[name][form]
    except KeyError:
        raise HodoError(f"there is no model {name!r} with the form {form!r}") from None


# At once, because a worker that is sent an object of such a class imports this package for it.
_own_modules = [
    _load(path, f"own{i}")
    for i, path in enumerate(filter(None, os.environ.get(OWN, "").split(os.pathsep)))
]
