"""The mechanics. MODELS says which module has which model; a user's own files may add others.
Imports schema and arithmetic only; knows no solver, result or plot."""

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
"""The modules of hodo's own models, each imported where its model is asked for."""

_own_files: list[OwnFile] = []


def _own_forms() -> list[type[Model]]:
    """The forms in the user's own files."""
    return [form for file in _own_files for form in file.forms]


def model_names() -> tuple[str, ...]:
    """The names of all models, hodo's first."""
    return tuple(dict.fromkeys((*MODELS, *(form.name for form in _own_forms()))))


@cache
def forms_of(name: str) -> Mapping[str, type[Model]]:
    """The classes of a model by form, the first of which is its default; none of an unknown one."""
    modules = (import_module(f"{__name__}.{module}") for module in MODELS.get(name, ()))
    known = [form for module in modules for form in forms_in(module)] or _own_forms()
    return {form.form: form for form in known if form.name == name}


@cache
def catalogue() -> Mapping[str, Mapping[str, type[Model]]]:
    """Every model class by its YAML name and form."""
    return {name: forms_of(name) for name in model_names()}


def find(name: str, form: str) -> type[Model]:
    """The class of one form of a model.

    Raises HodoError for a model or form that is not there (a result file of another version, say).
    """
    if form not in (forms := forms_of(name)):
        raise HodoError(f"there is no model {name!r} with the form {form!r}")
    return forms[form]


def _files_with(name: str) -> list[OwnFile]:
    """The user's own files with a model of this name; all of them for an empty name."""
    return [file for file in _own_files if name in ("", *(form.name for form in file.forms))]


def added_variables() -> dict[str, Label]:
    """What the user's own models store."""
    return {name: label for form in _own_forms() for name, label in form.variables.items()}


def added_source(name: str = "") -> str:
    """The text of the user's own file with a model of this name, or of all files, and of what they
    import from their folders; empty without any."""
    return "\n".join(file.source for file in _files_with(name))


def added_models_digest(name: str = "") -> str:
    """The digests of these texts; empty without any."""
    return " ".join(hashlib.sha256(x.source.encode()).hexdigest() for x in _files_with(name))


def mistake_in(system: Model) -> str:
    """The mistake in a user's own equations, tried at the start of a motion; empty if there is
    none."""
    return "".join(equations_mistake(system, file.path) for file in _files_with(system.name))


# At once, so that a file with a mistake is refused before anything runs. Workers inherit the
# environment; its paths are separated as in PATH.
for _path in filter(None, os.environ.get("HODO_MODELS", "").split(os.pathsep)):
    _own_files.append(load_own(_path, f"{__name__}.own{len(_own_files)}", model_names()))
