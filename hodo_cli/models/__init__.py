"""The mechanics. A model is one file, found by scanning this folder: to add one, add a file.
Imports schema and text only; knows no solver, file or plot."""

import pkgutil
from functools import cache
from importlib import import_module

from .. import HodoError
from .base import Model


def _is_form(item: type[Model]) -> bool:
    """Whether a class states a form that a case can name: what only stands in for one, or has no
    model's name yet, does not."""
    return "form" in vars(item) and hasattr(item, "name")


@cache
def catalogue() -> dict[str, dict[str, type[Model]]]:
    """Every model class by its YAML name and form; the first form of a model is its default."""
    found: dict[str, dict[str, type[Model]]] = {}
    for module in pkgutil.iter_modules(__path__):
        for item in vars(import_module(f"{__name__}.{module.name}")).values():
            if isinstance(item, type) and issubclass(item, Model) and _is_form(item):
                found.setdefault(item.name, {})[item.form] = item
    return found


def find(name: str, form: str) -> type[Model]:
    """The class of one form of a model.

    Raises HodoError for a model or form that is not there (a result file of another version, say).
    """
    try:
        return catalogue()[name][form]
    except KeyError:
        raise HodoError(f"there is no model {name!r} with the form {form!r}") from None
