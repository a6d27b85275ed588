"""The JSON Schema of case files, made from the keys themselves."""

from collections.abc import Iterable
from typing import Any

from .. import models
from ..models.attitude import keys_of_form
from ..models.base import Model
from .case import NAME
from .figure_block import FIGURE
from .keys import COMMON, SECTIONS


def _closed(form: dict[str, Any], classes: Iterable[type[Model]]) -> dict[str, Any]:
    """JSON Schema of a case of one of some forms of a model."""
    rules_of_key: dict[str, list[dict[str, Any]]] = {}
    for name, key in (item for form_class in classes for item in keys_of_form(form_class).items()):
        if (rule := key.schema()) not in rules_of_key.setdefault(name, []):
            rules_of_key[name].append(rule)
    rules = {
        name: some[0] if len(some) == 1 else {"anyOf": some} for name, some in rules_of_key.items()
    }
    return {
        "properties": dict.fromkeys(("model", *COMMON), True) | form | rules,
        "additionalProperties": False,
    }


def schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of the case files.

    No key is required of a case, since `defaults:` may supply it; the keys of a model are closed
    only where the case itself names the model. Conditions that join several keys (the triangle
    inequality, say) are beyond a schema.
    """
    catalogue = models.catalogue()
    head = {"model": {"enum": list(catalogue), "description": "equations of motion"}}
    common = {name: key.schema() for name, key in COMMON.items()}
    rules = []
    for model, forms in catalogue.items():
        named = {"properties": {"model": {"const": model}}, "required": ["model"]}
        rules.append(
            {"if": named, "then": _closed({"form": {"enum": list(forms)}}, forms.values())}
        )
        for form, form_class in forms.items():
            this = {"properties": {"form": {"const": form}}, "required": ["form"]}
            rules.append(
                {"if": {"allOf": [named, this]}, "then": _closed({"form": True}, [form_class])}
            )
    sections = {name: key.schema() for name, key in SECTIONS.items()}
    names = {"propertyNames": {"pattern": f"^{NAME.pattern}$"}}
    sections["cases"] |= names | {
        "additionalProperties": {"$ref": "#/$defs/case"},
        "minProperties": 1,
    }
    sections["figures"] |= names | {"additionalProperties": FIGURE.schema()}
    sections["defaults"] |= {"properties": head | common}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "hodo case file",
        "type": "object",
        "properties": sections,
        "required": ["cases"],
        "additionalProperties": False,
        "$defs": {"case": {"type": "object", "properties": head | common, "allOf": rules}},
    }
