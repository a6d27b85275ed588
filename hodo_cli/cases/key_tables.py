"""The keys of case files for readers, made from the keys themselves: the tables of three pages of
docs/, and the JSON Schema for editors."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, zip_longest
from typing import Any

from .. import models
from ..models.attitude import ATTITUDE, keys_of_form
from ..schema.document import resolve_scalar, write
from ..schema.kinds import BOUNDS, Choice, Key, Rule, Table, words
from ..text import grouped, markdown
from . import claim_block, figure_block
from .case import NAME
from .keys import COMMON, SECTIONS, keys_of
from .sweep_block import SWEEP

Row = tuple[str, str, str, str, str]
"""Path, value, unit, default and meaning of a key."""


def _default(rule: Rule) -> dict[str, Any]:
    """The default of a key as a case file writes it, in JSON Schema; empty if there is none."""
    default = rule.get("default")
    # A switch lists the word for True first.
    written = rule["enum"][not default] if isinstance(default, bool) else default
    return {} if written is None else {"default": written}


def _rows(path: str, rule: Rule, chosen: str = "") -> Iterator[Row]:
    """The row of a key, then the rows of the keys inside it."""
    default = "" if "default" in rule else "required"
    if (written := _default(rule).get("default")) is not None:
        is_word = isinstance(written, str) and resolve_scalar(written or "~") == written
        default = f"`{written if is_word else write(written)}`"
    yield f"`{path}`{chosen}", words(rule), rule["unit"], default, rule["description"]
    for option in rule.get("anyOf", [rule]):
        inner = option.get("items", option)
        for name, keys in {"": inner.get("properties", {}), **inner.get("tables", {})}.items():
            of_tag = f" ({inner.get('tag')}: {name})" if name else ""
            yield from chain.from_iterable(
                _rows(f"{path}.{key}", x, of_tag) for key, x in keys.items()
            )


def _table(keys: Mapping[str, Rule]) -> list[Row]:
    """The rows of several keys and of the keys inside them."""
    return [row for name, rule in keys.items() for row in _rows(name, rule)]


def _takers(named: Mapping[str, Sequence[str]], catalogue: Mapping[str, Mapping[str, Any]]) -> str:
    """The forms and models that take a key, in words; empty if all forms of its only model do."""
    some = {
        model: "" if [*forms] == [*catalogue[model]] else ", ".join(forms)
        for model, forms in named.items()
    }
    if len(some) == 1:
        (forms_of_one,) = some.values()
        return f" (form {forms_of_one})" if forms_of_one else ""
    return f" ({'; '.join(f'{model} {forms}'.rstrip() for model, forms in some.items())})"


def _pages() -> dict[str, dict[str, list[Row]]]:
    """The rows of all keys by page and by group, each with its heading."""
    catalogue = models.catalogue()
    takers = grouped(
        (row, (model, name))
        for model, forms in catalogue.items()
        for name, form in forms.items()
        for row in _table(keys_of_form(form))
    )
    of_models: dict[str, list[Row]] = {"Several models": []} | {
        f"Model `{model}`": _table({"form": keys_of(model, None)[1]["form"]}) for model in catalogue
    }
    for row, taking in takers.items():
        named = grouped(taking)
        group = "Several models" if len(named) > 1 else f"Model `{next(iter(named))}`"
        of_models[group].append((row[0] + _takers(named, catalogue), *row[1:]))
    first, *others = figure_block.FIGURE_KINDS.values()
    # A key belongs to "most figures" if most kinds take it with the same meaning.
    common = {
        k: x for k, x in first.items() if sum(keys.get(k) == x for keys in others) > len(others) / 2
    }
    # Statements and styles have tables of their own.
    of_file = [row for row in _table(SECTIONS) if not re.match(r"`(claims|errata|style)\.", row[0])]
    return {
        "Keys of case files": {
            "The file": of_file,
            "Every case": _table({"model": keys_of(None, None)[1]["model"]} | COMMON),
        }
        | of_models,
        "Keys of figures": {"Most figures": _table({"kind": figure_block.FIGURE["head"]} | common)}
        | {
            f"Figure `{name}`": _table({k: x for k, x in keys.items() if common.get(k) != x})
            for name, keys in figure_block.FIGURE_KINDS.items()
        },
        "Keys of statements": {
            "Every claim": [row for row in _table(claim_block.CLAIM) if "(kind: " not in row[0]]
        }
        | {
            f"Check `{name}`": _table({f"check.{key}": x for key, x in keys.items()})
            for name, keys in claim_block.CHECK_KINDS.items()
        },
    }


def key_tables() -> str:
    """Every key of a case file, in Markdown: a table a page, with a row in bold before each
    group."""
    tables = {}
    for page, groups in _pages().items():
        headed = ([(f"**{heading}**", "", "", "", ""), *rows] for heading, rows in groups.items())
        rows = [row for group in headed if len(group) > 1 for row in group]
        tables[page] = markdown(("key", "value", "unit", "default", "meaning"), rows)
    # The components of a vector have the same meaning, and share a row.
    named = grouped((meaning, f"`{x}`") for x, meaning in claim_block.QUANTITY_NAMES.items())
    quantities = [(", ".join(names), meaning) for meaning, names in named.items()]
    halves = zip_longest(quantities[::2], quantities[1::2], fillvalue=("", ""))
    tables["Quantities of checks"] = markdown(
        ("quantity", "meaning") * 2, ((*left, *right) for left, right in halves)
    )
    return "\n".join(f"## {heading}\n\n{table}" for heading, table in tables.items())


# The words of a rule that go into its JSON Schema unchanged; the others are translated or are
# hodo's own.
_TAKEN_OVER = (
    *("type", "enum", "pattern", *BOUNDS),
    *("minLength", "maxLength", "minItems", "maxItems", "minProperties", "maxProperties"),
)


def schema_of(rule: Rule, is_partial: bool = False) -> dict[str, Any]:
    """A rule as JSON Schema, or as a reference to its definition; `is_partial`: no key is required,
    and empty values are allowed."""
    words = {word: rule[word] for word in ("description",) if word in rule} | _default(rule)
    if "definition" in rule:
        return words | {"$ref": f"#/$defs/{rule['definition']}"}
    return words | _schema_in_full(rule, is_partial)


def _schema_in_full(rule: Rule, is_partial: bool = False) -> dict[str, Any]:
    """A rule as JSON Schema without its description and default, and without a reference to its
    own definition."""
    if "tag" in rule:
        heads = {name: Key(Choice(name), rule["head"]["description"]) for name in rule["tables"]}
        tables = (Table({rule["tag"]: heads[name]} | keys) for name, keys in rule["tables"].items())
        return {"oneOf": [schema_of(table) for table in tables]}
    of_inner = _or_empty if is_partial else schema_of
    schema: dict[str, Any] = {word: rule[word] for word in _TAKEN_OVER if word in rule}
    schema |= {"anyOf": [*map(schema_of, rule["anyOf"])]} if "anyOf" in rule else {}
    schema |= {"items": schema_of(rule["items"])} if "items" in rule else {}
    if "additionalProperties" in rule:
        schema |= {"additionalProperties": of_inner(rule["additionalProperties"])}
    if (keys := rule.get("properties")) is None:
        return schema
    required = [name for name, key in keys.items() if "default" not in key and not is_partial]
    schema |= {"required": required} if required else {}
    return schema | _closed({name: of_inner(key) for name, key in keys.items()})


def _closed(properties: dict[str, Any]) -> dict[str, Any]:
    """JSON Schema of a mapping that takes these keys and no others."""
    return {"properties": properties, "additionalProperties": False}


def _or_empty(rule: Rule) -> dict[str, Any]:
    """JSON Schema of a key of a case or of the defaults, where an empty value removes a default."""
    schema = schema_of(rule, is_partial=True)
    described = {word: schema.pop(word) for word in ("description", "default") if word in schema}
    return described | {"anyOf": [schema, {"type": "null"}]}


DEFINED = (
    *(claim_block.CHECK, claim_block.QUANTITY, claim_block.CURVE),
    *(SWEEP, ATTITUDE, figure_block.STYLE),
)
"""The rules that several keys share."""


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of case files. No key of a case is required, because `defaults:` may
    give it; the keys of a model are closed only where the case names the model."""
    catalogue = models.catalogue()
    common = {name: _or_empty(rule) for name, rule in COMMON.items()}
    head = {"model": {"enum": [*catalogue]}}
    rules = []
    for model, forms in catalogue.items():
        keys = {k: _or_empty(x) for form in forms.values() for k, x in keys_of_form(form).items()}
        form = {"form": {"enum": [*forms, None]}}
        named = {"properties": {"model": {"const": model}}, "required": ["model"]}
        known = dict.fromkeys([*head, *common], True)  # which every case states
        rules.append({"if": named, "then": _closed(known | form | keys)})
    sections = {name: _or_empty(rule) for name, rule in SECTIONS.items()}
    names = {"propertyNames": {"pattern": f"^{NAME.pattern}$"}, "type": "object"}
    case = {"type": "object", "properties": head | common, "allOf": rules}
    sections["cases"] = names | {"additionalProperties": case, "minProperties": 1}
    figures = names | {"additionalProperties": schema_of(figure_block.FIGURE)}
    sections["figures"] = {"anyOf": [figures, {"type": "null"}]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "hodo case file",
        "type": "object",
        "required": ["cases"],
        **_closed(sections),
        "$defs": {rule["definition"]: _schema_in_full(rule) for rule in DEFINED},
    }
