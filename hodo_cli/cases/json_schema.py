"""The key table and the JSON Schema of case files, made from the keys themselves."""

from collections.abc import Iterable, Iterator
from typing import Any

from .. import models
from ..models.base import Model
from ..schema import kinds
from ..schema.kinds import Choice, Either, Key, Table, Variant
from ..schema.write import write
from . import claim_block
from .case import NAME
from .figure_block import KINDS
from .keys import COMMON, SECTIONS, keys_of


def _rows(path: str, key: Key) -> Iterator[tuple[str, str, str, str, str]]:
    """The rows of the key table, but for `where`, of a key and the keys within it."""
    default = (
        "required"
        if key.default is kinds.REQUIRED
        else ""
        if key.default is None
        else write(key.default)
    )
    yield path, key.kind.describe(), key.unit, default, key.doc
    inner_kinds = key.kind.kinds if isinstance(key.kind, Either) else (key.kind,)
    for kind in inner_kinds:
        tables = (
            [kind.keys]
            if isinstance(kind, Table)
            else kind.tables.values()
            if isinstance(kind, Variant)
            else []
        )
        for table in tables:
            for name, inner in table.items():
                yield from _rows(f"{path}.{name}", inner)


def key_table() -> str:
    """Every key of a case file as a table in Markdown."""
    catalogue = models.catalogue()
    head = {"model": Key(Choice(*catalogue), "equations of motion")}
    scopes = [("file", "", SECTIONS), ("every case", "", head | COMMON)]
    for model, forms in catalogue.items():
        scopes.append((model, "", {"form": keys_of(model, None)[1]["form"]}))
        scopes += [(model, form, dict(found.keys)) for form, found in forms.items()]
    kind = {"kind": Key(Choice(*KINDS), "what is drawn")}
    scopes += [("figure", name, kind | taken) for name, taken in KINDS.items()]
    scopes.append(("claim", "", claim_block.CLAIM))
    where: dict[tuple[str, ...], dict[str, dict[str, None]]] = {}
    for group, member, taken in scopes:
        for row in (row for name, key in taken.items() for row in _rows(name, key)):
            where.setdefault(row, {}).setdefault(group, {})[member] = None
    every = {model: list(forms) for model, forms in catalogue.items()} | {"figure": list(KINDS)}
    lines = ["| key | where | value | unit | default | meaning |", "|---|---|---|---|---|---|"]
    for (name, *rest), groups in where.items():
        named = [
            g if list(some) in ([""], every.get(g)) else f"{g} ({', '.join(some)})"
            for g, some in groups.items()
        ]
        cells = (f"`{name}`", ", ".join(named), *rest)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _closed(form: dict[str, Any], classes: Iterable[type[Model]]) -> dict[str, Any]:
    """JSON Schema of a case of one of some forms of a model."""
    own: dict[str, list[dict[str, Any]]] = {}
    for name, key in (item for found in classes for item in found.keys.items()):
        if (rule := key.schema()) not in own.setdefault(name, []):
            own[name].append(rule)
    rules = {name: some[0] if len(some) == 1 else {"anyOf": some} for name, some in own.items()}
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
    common["time"].pop("required")
    rules = []
    for model, forms in catalogue.items():
        named = {"properties": {"model": {"const": model}}, "required": ["model"]}
        rules.append(
            {"if": named, "then": _closed({"form": {"enum": list(forms)}}, forms.values())}
        )
        for form, found in forms.items():
            this = {"properties": {"form": {"const": form}}, "required": ["form"]}
            rules.append({"if": {"allOf": [named, this]}, "then": _closed({"form": True}, [found])})
    figures = [
        Table({"kind": Key(Choice(kind), "what is drawn")} | taken).schema()
        for kind, taken in KINDS.items()
    ]
    sections = {name: key.schema() for name, key in SECTIONS.items()}
    names = {"propertyNames": {"pattern": f"^{NAME.pattern}$"}}
    sections["cases"] |= names | {
        "additionalProperties": {"$ref": "#/$defs/case"},
        "minProperties": 1,
    }
    sections["figures"] |= names | {"additionalProperties": {"oneOf": figures}}
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
