"""The mechanics. MODELS says which module has which model; a user's own files may add others.
Imports schema and arithmetic only; knows no solver, result or plot."""

import os
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from importlib import import_module
from types import ModuleType

from .. import HodoError
from .base import Label, Model
from .own import OwnFile, equations_mistake, load_own

OWN_MODELS_VARIABLE = "HODO_MODELS"
"""The variable of the environment with the user's own files, separated as in PATH: worker processes
inherit it."""

MODELS = {
    "linear-diag": "linear_diag",
    "tensor": "tensor",
    "cavity+constant": "cavity",
    "torques": "torques",
    "Lagrange-averaged": "top.lagrange",
}


def _forms(module: ModuleType) -> list[type[Model]]:
    """The forms that a module itself states, not those that it builds on."""
    return [
        item
        for item in vars(module).values()
        if isinstance(item, type) and issubclass(item, Model) and hasattr(item, "name")
        if item.__module__ == module.__name__ and "form" in vars(item)
    ]


@cache
def forms_of(name: str) -> Mapping[str, type[Model]]:
    """The classes of a model by form, the first of which is its default."""
    if name in MODELS:
        return {form.form: form for form in _forms(import_module(f"{__name__}.{MODELS[name]}"))}
    return {form.form: form for form in _own_forms if form.name == name}


@cache
def catalogue() -> Mapping[str, Mapping[str, type[Model]]]:
    """Every model class by its YAML name and form."""
    return {name: forms_of(name) for name in (*MODELS, *(form.name for form in _own_forms))}


def find(name: str, form: str) -> type[Model]:
    """The class of one form of a model.

    Raises HodoError for a model or form that is not there (a result file of another version, say).
    """
    try:
        return forms_of(name)[form]
    except KeyError:
        raise HodoError(f"there is no model {name!r} with the form {form!r}") from None


def added_variables() -> dict[str, Label]:
    """What the user's own models store."""
    return {name: label for form in _own_forms for name, label in form.variables.items()}


def _files_with(name: str) -> list[OwnFile]:
    """The user's own files with a model of this name; all of them for an empty one."""
    return list(
        {file.path: file for form, file in _own_forms.items() if name in ("", form.name)}.values()
    )


def added_models_digest(name: str = "") -> str:
    """The digest of the user's own files with a model of this name, or of all; empty without."""
    return " ".join(file.digest for file in _files_with(name))


def added_source(name: str) -> str:
    """The source of a user's own model, with all that it imports from its folder; else empty."""
    return "\n".join(file.source for file in _files_with(name))


def mistake_in(system: Model) -> str:
    """The mistake in a user's own equations, tried at the start of a motion; empty if there is
    none."""
    file = _own_forms.get(type(system))
    return equations_mistake(system, file.path) if file else ""


def _read_own_forms() -> dict[type[Model], OwnFile]:
    """The forms in the user's own files."""
    found: dict[type[Model], OwnFile] = {}
    for i, path in enumerate(
        filter(None, os.environ.get(OWN_MODELS_VARIABLE, "").split(os.pathsep))
    ):
        file = load_own(path, f"{__name__}.own{i}")
        forms = _forms(file.module)
        if not forms:
            raise HodoError(f"{path}: there is no model in it (a class with `name` and `form`)")
        for form in forms:
            lone = {field.name for field in fields(form) if field.init} ^ form.keys.keys()
            if lone or "__dataclass_fields__" not in vars(form):
                raise HodoError(
                    f"{path}: {form.__name__}: it is to be a frozen dataclass whose fields are its "
                    f"`keys`; only one of both: {min(lone, default='there is none')}"
                )
            named = {(other.name, other.form) for other in found}
            if form.name in MODELS or (form.name, form.form) in named:
                raise HodoError(f"{path}: there is already a model {form.name!r}")
            # In the case's own units: who states degrees wrongly would get wrong numbers.
            form.degree = {}
            found[form] = file
    return found


# At once, so that a file with a mistake is refused before anything runs.
_own_forms = _read_own_forms()
