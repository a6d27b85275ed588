"""The mechanics: the models, and where each of them is defined. A user's own files may add models.
This folder imports `schema` and `arithmetic` only; it knows no solver, result or plot."""

import hashlib
import os
from collections.abc import Mapping
from functools import cache
from importlib import import_module

from .. import HodoError
from .base import Label, Model
from .own import OwnFile, equations_mistake, forms_in, load_own

MODELS = {
    "cavity+constant": ("body", "averaged"),
    "linear-diag": ("body", "averaged"),
    "tensor": ("body", "averaged"),
    "Lagrange-averaged": ("top",),
    "torques": ("body",),
}
"""The modules that define the forms of hodo's own models. A module is imported when a case needs
its model."""

_own_files: list[OwnFile] = []


def _own_forms() -> list[type[Model]]:
    """The forms of the models in the user's own files."""
    return [form for file in _own_files for form in file.forms]


def model_names() -> tuple[str, ...]:
    """The names of all models, hodo's own first."""
    return tuple(dict.fromkeys((*MODELS, *(form.name for form in _own_forms()))))


@cache
def forms_of(name: str) -> Mapping[str, type[Model]]:
    """The classes of a model by form; the first form is the default. Empty for an unknown model."""
    modules = (import_module(f"{__name__}.{module}") for module in MODELS.get(name, ()))
    known = [form for module in modules for form in forms_in(module)] or _own_forms()
    return {form.form: form for form in known if form.name == name}


@cache
def catalogue() -> Mapping[str, Mapping[str, type[Model]]]:
    """The class of every form of every model, by the name of the model and of the form."""
    return {name: forms_of(name) for name in model_names()}


def find(name: str, form: str) -> type[Model]:
    """The class of one form of a model.

    Raises HodoError for an unknown model or form, which a result file of another version may name.
    """
    if form not in (forms := forms_of(name)):
        raise HodoError(f"there is no model {name!r} with the form {form!r}")
    return forms[form]


def _files_with(name: str) -> list[OwnFile]:
    """The user's own files that define a model of this name; all own files for an empty name."""
    return [file for file in _own_files if name in ("", *(form.name for form in file.forms))]


def added_variables() -> dict[str, Label]:
    """The stored variables of the user's own models."""
    return {name: label for form in _own_forms() for name, label in form.variables.items()}


def added_source(name: str = "") -> str:
    """The text of the user's own file that defines a model of this name, with the files that it
    imports from its folder. The texts of all own files for an empty name."""
    return "\n".join(file.source for file in _files_with(name))


def added_models_digest(name: str = "") -> str:
    """The SHA-256 digests of the texts that make up `added_source`; empty without own files."""
    return " ".join(hashlib.sha256(x.source.encode()).hexdigest() for x in _files_with(name))


def mistake_in(system: Model) -> str:
    """The mistake in the equations of a user's own model, which are tried at the start of a motion;
    empty if there is none."""
    return "".join(equations_mistake(system, file.path) for file in _files_with(system.name))


# The files are loaded at import, so that a mistake in one is reported before anything runs. Worker
# processes inherit the environment variable, whose paths are separated as in PATH.
for _path in filter(None, os.environ.get("HODO_MODELS", "").split(os.pathsep)):
    _own_files.append(load_own(_path, f"{__name__}.own{len(_own_files)}", model_names()))
