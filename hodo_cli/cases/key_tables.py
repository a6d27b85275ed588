"""The keys of case files for readers, made from the keys themselves: the tables of
docs/case-files.md, one a group of keys, and the JSON Schema for editors."""

import re
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from typing import Any

from .. import models
from ..models.attitude import keys_of_form
from ..models.base import Model
from ..models.terms.laws import law_mapping
from ..schema import kinds
from ..schema.document import write
from ..schema.kinds import Choice, Either, Key, ListOf, Table, Variant
from ..text import grouped, markdown
from . import claim_block, figure_block
from .case import MERGED_KEYS, NAME
from .keys import COMMON, SECTIONS, keys_of

Row = tuple[str, str, str, str, str]
"""Path, value, unit, default and meaning of a key."""


def _default(key: Key) -> str:
    """The default as it would be written in a case file."""
    if key.default is kinds.REQUIRED:
        return "required"
    return "" if key.default is None else f"`{write(key.kind.written(key.default))}`"


TIME_LAW = law_mapping("of the coefficient", "t")


def _within(key: Key) -> Iterator[tuple[str, Mapping[str, Key]]]:
    """The keys inside a key's value, each set with the words that choose it; not those of a law,
    which a dozen keys have in common and a table of its own gives once."""
    for kind in key.kind.kinds if isinstance(key.kind, Either) else (key.kind,):
        inner = kind.kind if isinstance(kind, ListOf) else kind
        if isinstance(inner, Table):
            yield "", inner.keys
        elif isinstance(kind, Variant) and kind.tag != TIME_LAW.tag:
            yield from ((f" ({kind.tag}: {name})", keys) for name, keys in kind.tables.items())


def _rows(path: str, key: Key, chosen: str = "") -> Iterator[Row]:
    """The row of a key, then the rows of the keys inside it."""
    yield f"`{path}`{chosen}", str(key.kind), key.unit, _default(key), key.doc
    for words, keys in _within(key):
        for name, inner in keys.items():
            yield from _rows(f"{path}.{name}", inner, words)


def _table(keys: Mapping[str, Key]) -> list[Row]:
    return [row for name, key in keys.items() for row in _rows(name, key)]


Groups = Iterator[tuple[str, list[Row]]]
"""The heading and the rows of each table."""


def _cases() -> Groups:
    catalogue = models.catalogue()
    head = {"model": Key(Choice(*catalogue), "equations of motion")}
    yield "Every case", _table(head | COMMON)
    for model, forms in catalogue.items():
        _, keys_of_first = keys_of(model, None)
        head = {"form": keys_of_first["form"]}
        takers = grouped(
            (row, name) for name, form in forms.items() for row in _table(head | keys_of_form(form))
        )
        # A key that only some forms take names them.
        rows = [
            row if taking == [*forms] else (f"{row[0]} (form {', '.join(taking)})", *row[1:])
            for row, taking in takers.items()
        ]
        yield f"Model `{model}`", rows
    laws = ((f" ({TIME_LAW.tag}: {name})", keys) for name, keys in TIME_LAW.tables.items())
    rows = [
        row for words, keys in laws for name, key in keys.items() for row in _rows(name, key, words)
    ]
    yield "A law of t, or of tau", rows


def _figures() -> Groups:
    kinds_of_figure = figure_block.FIGURE_KINDS
    every, *others = kinds_of_figure.values()
    # A key stands under "most figures" if most of the kinds take it, with the same meaning.
    shared = {
        name: key
        for name, key in every.items()
        if sum(keys.get(name) == key for keys in others) > len(others) / 2
    }
    yield "Most figures", _table(figure_block.FIGURE.head(*kinds_of_figure) | shared)
    for name, keys in kinds_of_figure.items():
        if own_keys := {key: value for key, value in keys.items() if shared.get(key) != value}:
            yield f"Figure `{name}`", _table(own_keys)


def _claims() -> Groups:
    yield "Every claim", [row for row in _table(claim_block.CLAIM) if "(kind: " not in row[0]]
    for name, keys in claim_block.CHECK.tables.items():
        yield f"Check `{name}`", _table({f"check.{key}": value for key, value in keys.items()})


def key_tables() -> str:
    """Every key of a case file, in Markdown: a heading and a table for each group."""
    header = ("key", "value", "unit", "default", "meaning")
    # Statements have tables of their own.
    sections = [row for row in _table(SECTIONS) if not re.match(r"`(claims|errata)\.", row[0])]
    groups = chain([("The file", sections)], _cases(), _figures(), _claims())
    tables = [(heading, markdown(header, rows)) for heading, rows in groups]
    # The components of a vector have their meaning in common.
    named = grouped((meaning, f"`{x}`") for x, meaning in claim_block.QUANTITY_NAMES.items())
    quantities = [(", ".join(names), meaning) for meaning, names in named.items()]
    tables.append(("Quantities of checks", markdown(("quantity", "meaning"), quantities)))
    return "\n".join(f"### {heading}\n\n{table}" for heading, table in tables)


EMPTY = {"anyOf": {"type": "null"}, "oneOf": {"type": "null"}, "enum": None, "type": "null"}
"""The entry for an empty value under each word of JSON Schema that lists what a value may be."""


def _or_empty(rule: Mapping[str, Any]) -> dict[str, Any]:
    """JSON Schema of a value that may be left empty."""
    word = next(word for word in EMPTY if word in rule)
    listed = rule[word] if isinstance(rule[word], list) else [rule[word]]
    return {**rule, word: [*listed, EMPTY[word]]}


def _of_case(name: str, rule: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of a key of a case or of the defaults: an empty value takes a default back, also
    of an entry of what is merged entry by entry."""
    if name in MERGED_KEYS:
        entries = {key: _or_empty(entry) for key, entry in rule.get("properties", {}).items()}
        others = rule["additionalProperties"] and _or_empty(rule["additionalProperties"])
        rule = rule | {"properties": entries, "additionalProperties": others, "minProperties": 0}
    return _or_empty(rule)


def _closed(form: dict[str, Any], classes: Iterable[type[Model]]) -> dict[str, Any]:
    """JSON Schema of a case of one of some forms of a model."""
    rules = {}
    keys = (item for form_class in classes for item in keys_of_form(form_class).items())
    for name, of_forms in grouped((name, key.schema()) for name, key in keys).items():
        distinct = [rule for i, rule in enumerate(of_forms) if rule not in of_forms[:i]]
        rules[name] = _or_empty(distinct[0] if len(distinct) == 1 else {"anyOf": distinct})
    return {
        "properties": dict.fromkeys(("model", *COMMON), True) | form | rules,
        "additionalProperties": False,
    }


def _of_model(forms: Mapping[str, type[Model]]) -> dict[str, Any]:
    """JSON Schema of a case of a model, whose keys are those of its form if it names one."""
    by_form = [
        {
            "if": {"properties": {"form": {"const": form}}, "required": ["form"]},
            "then": _closed({"form": True}, [form_class]),
        }
        for form, form_class in forms.items()
    ]
    return _closed({"form": _or_empty({"enum": list(forms)})}, forms.values()) | {"allOf": by_form}


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of the case files.

    No key is required of a case, since `defaults:` may supply it; the keys of a model are closed
    only where the case or the defaults name the model. Conditions that join several keys (the
    triangle inequality, say) are beyond a schema. It takes all that `load` takes but for a wrong
    value in `defaults:` that no case inherits.
    """
    catalogue = models.catalogue()
    head = {"model": {"enum": list(catalogue), "description": "equations of motion"}}
    common = {name: _of_case(name, key.schema()) for name, key in COMMON.items()}
    defined = {f"model{i}": _of_model(forms) for i, forms in enumerate(catalogue.values())}
    rules, defaults = [], []
    for model, definition in zip(catalogue, defined, strict=True):
        named = {"properties": {"model": {"const": model}}, "required": ["model"]}
        then = {"$ref": f"#/$defs/{definition}"}
        rules.append({"if": named, "then": then})
        inherited = {"if": {"properties": {"model": False}}, "then": then}
        defaults.append(
            {
                "if": {"properties": {"defaults": named}, "required": ["defaults"]},
                "then": {"properties": {"cases": {"additionalProperties": inherited}}},
            }
        )
    sections = {name: key.schema() for name, key in SECTIONS.items()}
    names = {"propertyNames": {"pattern": f"^{NAME.pattern}$"}}
    sections["cases"] |= names | {
        "additionalProperties": {"$ref": "#/$defs/case"},
        "minProperties": 1,
    }
    sections["figures"] |= names | {"additionalProperties": figure_block.FIGURE.schema()}
    sections["defaults"] |= {"properties": {"model": _or_empty(head["model"])} | common}
    # A section with nothing below it is one that is left out.
    optional = {name: _or_empty(rule) for name, rule in sections.items() if name != "cases"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "hodo case file",
        "type": "object",
        "properties": sections | optional,
        "required": ["cases"],
        "additionalProperties": False,
        "allOf": defaults,
        "$defs": defined
        | {"case": {"type": "object", "properties": head | common, "allOf": rules}},
    }
