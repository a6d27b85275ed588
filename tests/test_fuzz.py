"""Hostile case files, HODO_FUZZ (default 60) of each kind: the loader gives a Config or a
HodoError, with work in proportion to the text."""

import json
import os
from copy import deepcopy
from functools import cache
from typing import Any

import yaml
from conftest import ROOT, counted
from hypothesis import given, settings
from hypothesis import strategies as st

from hodo_cli import HodoError
from hodo_cli.cases.case import dump, parse_case
from hodo_cli.cases.config import parse

COUNT = settings(max_examples=int(os.environ.get("HODO_FUZZ", "60")))
CONFIGS = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "configs").glob("*.yaml"))]
PIECES = st.sampled_from(
    ["[", "]", "{", "}", ":", ": ", "- ", "? ", "&a ", "*a", "!!int ", "!x ", "|\n", ">\n", "'",
     '"', "#", "\n", "\t",
     "  ", "<<: ", "---\n", "...\n", "%YAML 1.1\n", "\0", "\x85", "\u2028", "\ufeff", "1e400",
     ".nan", "-.inf", "~",
     "no", "9" * 5000, "0x" + "f" * 400, "60 deg", "é", "model: tensor", "form: averaged", "[" * 60,
     "initial: {x: -1}",
     "time: {end: 1e308, start: -1e308}", "inertia: [1, 1, 1e-320]", "G: 1e-300", "defaults: ",
     "cases: ", "a" * 200]
)  # fmt: skip
WORDS = st.sampled_from(["on", "x", "60 deg", "taylor", "continue"])
SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | WORDS
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from("pqrGabxyz"), inner, max_size=4)
    ),
    max_leaves=8,
)


@st.composite
def mutants(draw: st.DrawFn) -> str:
    """A shipped config with some stretches deleted, doubled or replaced."""
    text = draw(st.sampled_from(CONFIGS))
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 40)))
        piece = draw(PIECES | st.just(text[start:end] * 2) | st.text(max_size=5))
        text = text[:start] + piece + text[end:]
    return text


@cache
def sections(text: str) -> Any:
    """The sections of a case file, read once."""
    return yaml.safe_load(text)


@st.composite
def misfits(draw: st.DrawFn) -> str:
    """A shipped config, still YAML, in which some values are replaced by others of any shape."""
    document = deepcopy(sections(draw(st.sampled_from(CONFIGS))))
    for _ in range(draw(st.integers(1, 4))):
        parent, key = document, draw(st.sampled_from(sorted(document)))
        while isinstance(parent[key], dict) and parent[key] and draw(st.integers(0, 3)):
            parent, key = parent[key], draw(st.sampled_from(sorted(parent[key])))
        parent[key] = draw(VALUES)
    # JSON is YAML but for these two.
    return json.dumps(document).replace("Infinity", ".inf").replace("NaN", ".nan")


def outcome(text: str, overrides: tuple[str, ...] = ()) -> Any:
    """The config, or None if it was refused as it should be; any other exception is a failure."""

    def read() -> tuple[Any, str]:
        try:
            return parse(text, "x.yaml", overrides), ""
        except HodoError as error:
            return None, str(error)

    (config, said), work = counted(read)
    # 4 a letter by libyaml, and 20,000 for what is made once for all texts.
    assert work < 50_000 + 100 * len(text)
    lines = [] if config else said.split("\n")
    assert all(line.startswith(("x.yaml:", "--set ")) and line.isprintable() for line in lines)
    for case in config.cases.values() if config else ():
        assert parse_case(dump(case)) == case
    return config


@COUNT
@given(st.text(max_size=60) | st.lists(PIECES, max_size=30).map("".join))
def test_any_text(text: str) -> None:
    outcome(text)
    outcome("cases:\n  a:\n    " + text)


@COUNT
@given(mutants())
def test_a_config_with_its_text_mangled(text: str) -> None:
    outcome(text)


@COUNT
@given(misfits())
def test_a_config_with_its_values_replaced(text: str) -> None:
    outcome(text)


@COUNT
@given(
    st.text(max_size=20)
    | st.lists(PIECES | st.sampled_from([".", "=", "*", "initial", "p", "0"])).map("".join)
)
def test_any_override(text: str) -> None:
    outcome(CONFIGS[0], (text, "fig4." + text, "*.initial=" + text))
