"""The mechanics. A model is one file, found by scanning this folder and those in it: to add one,
add a file, or name one of your own. Imports schema and arithmetic only; knows no solver, result or
plot."""

import os
import re
import sys
from collections import UserDict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from .. import HodoError
from ..machine import may_have_entry_points
from ..private import keep_model
from ..text import grouped
from .added import (
    MISTAKES,
    AddedModule,
    equations_mistake,
    texts_of,
    with_levels,
    with_source_line,
)
from .base import Label, Model

OWN_MODELS_VARIABLE = "HODO_MODELS"
"""The variable of the environment with the user's own files, separated as in PATH: worker processes
inherit it."""

ENTRY_POINTS = "hodo.models"
"""The group of these entry points."""

STATED_NAME = re.compile(r'^    name = "(.+)"$', re.MULTILINE)
"""How a class states its model's name. One that inherits it from another file repeats it."""


def _forms(module: ModuleType) -> list[type[Model]]:
    """The forms that a module itself states, not those that it builds on. A class that only stands
    in for one, or has no model's name yet, is none that a case can name."""
    return [
        item
        for item in vars(module).values()
        if isinstance(item, type) and issubclass(item, Model) and hasattr(item, "name")
        if item.__module__ == module.__name__ and "form" in vars(item)
    ]


@cache
def _own_modules_of() -> Mapping[str, Sequence[str]]:
    """The modules in this folder and those in it, by the names of the models whose forms they
    define: their texts tell these, so that only the modules of the models in use are loaded."""
    folder = Path(__file__).parent
    return grouped(
        (name, ".".join([__name__, *path.relative_to(folder).with_suffix("").parts]))
        for path in sorted(folder.rglob("*.py"))
        for name in dict.fromkeys(STATED_NAME.findall(path.read_text("utf-8")))
    )


@cache
def _added_forms() -> Sequence[tuple[AddedModule, type[Model]]]:
    """The forms that are not hodo's, each with its module."""
    return [
        (added, with_levels(form))  # type: ignore[arg-type]
        for added in _added_modules()
        for form in _forms(added.module)
    ]


def added_variables() -> dict[str, Label]:
    """What the models that are not hodo's store."""
    return {name: label for _, form in _added_forms() for name, label in form.variables.items()}


@cache
def forms_of(name: str) -> Mapping[str, type[Model]]:
    """The classes of a model by form, the first of which is its default; of a body-frame model that
    states only its full form with an averaged one.

    Raises HodoError if an installed package's models cannot be loaded, or one is there already.
    """
    own = [_forms(import_module(module)) for module in _own_modules_of().get(name, ())]
    forms = {item.form: item for items in own for item in items if item.name == name}
    for added, item in _added_forms():
        # Which of two is meant would depend on the order of files.
        if item.name == name and forms.setdefault(item.form, item) is not item:
            raise HodoError(
                f"{added.origin}: there is already a model {name!r} with the form {item.form!r}"
            )
    # The means over a turn know of no other state than omega.
    if "averaged" not in forms and "full" in forms:
        make, full = import_module(f"{__name__}.averaging.any_torque"), forms["full"]
        if issubclass(full, make.BodyFrame) and full.state == make.BodyFrame.state:
            forms["averaged"] = make.averaged_form(full)
    return forms


class Catalogue(UserDict[str, Any]):
    """`forms_of` by the names of the models, None until a model is asked for."""

    def __getitem__(self, name: str) -> Mapping[str, type[Model]]:
        return self.data[name] or forms_of(name)


@cache
def catalogue() -> Catalogue:
    """Every model class by its YAML name and form."""
    added = (form.name for _, form in _added_forms())
    return Catalogue(dict.fromkeys((*_own_modules_of(), *added)))


@cache
def added_models_digest(name: str = "") -> str:
    """The digest of the sources of models that are not hodo's, and of what they import from their
    own folders: of those with a name, or of all; empty if there are none."""
    return " ".join(item.digest for item in (_modules_with(name) if name else _added_modules()))


def kept_own_models() -> str:
    """The names, a line each, by which `private.kept_models` finds the user's own files as they are
    now; empty without any."""
    return "\n".join(keep_model(item.digest, item.texts) for item in _own_modules)


def added_source(name: str) -> str:
    """The source of a model that is not hodo's, with that of all that it imports from its own
    folder; empty for one of hodo's own."""
    return "\n".join(item.source for item in _modules_with(name))


@cache
def _added_modules() -> tuple[AddedModule, ...]:
    """The modules of the user's own files and of installed packages, all with a model."""
    added = list(_own_modules)
    for point in _entry_points():
        source = f"{point.value} (entry point {point.name})"
        try:
            module = import_module(point.module)
            path = Path(str(module.__file__))
            texts = texts_of(path, path.read_bytes(), point.module)
        except MISTAKES as error:
            raise HodoError(f"{source}: {type(error).__name__}: {error}") from error
        added.append(AddedModule(source, module, texts))
    for source, module, _ in added:
        if not (forms := _forms(module)):
            raise HodoError(f"{source}: there is no model in it (a class with `name` and `form`)")
        for form in forms:
            if message := _class_mistake(form):
                raise HodoError(f"{source}: {form.__name__}: {message}")
    return tuple(added)


def _entry_points() -> Iterable[Any]:
    """The entry points of installed packages that name a module with models."""
    if not may_have_entry_points(ENTRY_POINTS):
        return ()
    from importlib.metadata import entry_points  # it takes a tenth of a short run to load

    return entry_points(group=ENTRY_POINTS)


def _class_mistake(form: type[Model]) -> str:
    """The mistake in the attributes of a class; empty if there is none."""
    for name in ("name", "form"):
        if not isinstance(getattr(form, name), str):
            return f"its {name} is no text: {getattr(form, name)!r}"
    field_names = {field.name for field in fields(form) if field.init}
    if "__dataclass_fields__" not in vars(form) or form.keys.keys() != field_names:
        lone = ", ".join(sorted(form.keys.keys() ^ field_names)) or "there is none"
        return (
            f"it is to be a frozen dataclass whose fields are its `keys`; only one of both: {lone}"
        )
    # A dataclass takes an attribute that it inherits for the default of its field.
    bases = form.__mro__[1:-1]
    inherited = {field.name for base in bases if is_dataclass(base) for field in fields(base)}
    for base in bases:
        if taken := (field_names - inherited) & vars(base).keys():
            return f"key {min(taken)!r} is an attribute of {base.__name__}: name it otherwise"
    return ""


def _modules_with(name: str) -> list[AddedModule]:
    """The modules that are not hodo's and state a model of this name."""
    return [*{added.origin: added for added, form in _added_forms() if form.name == name}.values()]


def _load(path: str, name: str) -> AddedModule:
    """A file of the user's own as a module of this package.

    Raises HodoError, one line with the place, if it cannot be read or run.
    """
    module = ModuleType(f"{__name__}.{name}")
    module.__file__, module.__package__ = path, __name__
    # Before it runs, because `dataclass` looks its module up.
    sys.modules[module.__name__] = module
    # Its own folder goes last: no file there is taken for a library.
    if (folder := str(Path(path).resolve().parent)) not in sys.path:
        sys.path.append(folder)
    try:
        # Read once, so that the text hashed is the text run, even if the file is edited meanwhile.
        text = Path(path).read_bytes()
        exec(compile(text, path, "exec"), vars(module))
    except OSError as error:
        raise HodoError(f"{path}: {str(error.strerror).lower()}") from None
    except MISTAKES as error:
        raise HodoError(with_source_line(error, path)) from error
    return AddedModule(path, module, texts_of(Path(path), text))


def mistake_in(system: Model) -> str:
    """The mistake in equations that are not hodo's, tried at the start of a motion; empty if there
    is none."""
    modules = _modules_with(system.name)
    return equations_mistake(system, str(modules[0].module.__file__)) if modules else ""


def find(name: str, form: str) -> type[Model]:
    """The class of one form of a model.

    Raises HodoError for a model or form that is not there (a result file of another version, say).
    """
    try:
        return catalogue()[name][form]
    except KeyError:
        raise HodoError(f"there is no model {name!r} with the form {form!r}") from None


# At once, so that a file with a mistake is refused before anything runs.
_own_modules = [
    _load(path, f"own{i}")
    for i, path in enumerate(
        filter(None, os.environ.get(OWN_MODELS_VARIABLE, "").split(os.pathsep))
    )
]
