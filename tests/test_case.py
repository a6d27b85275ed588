"""The loader of case files: values, mistakes with their places, overrides, round trips, hostile
files."""

import dataclasses
import itertools
import json
import math
import operator
import os
import pickle
import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import cache, partial, reduce
from pathlib import Path
from random import Random
from typing import Any

import pytest
import yaml
from conftest import ROOT, call, counted, schema
from hypothesis import given, settings
from hypothesis import strategies as st

from hodo_cli import Case, HodoError
from hodo_cli.cases.case import Time, dump, parse_case
from hodo_cli.cases.config import load, parse
from hodo_cli.schema import document

CONFIGS = sorted((ROOT / "configs").glob("*.yaml"))
NAME_RULE = (
    "a name is up to 100 of the characters A-Z a-z 0-9 . _ - and begins with a letter or digit"
)
BODY = "model: linear-diag, inertia: [1, 0.8, 0.6], initial: {p: 0.8, q: 0.5, r: 0.74}"
SPAN = "time: {end: 10}"
GOOD = f"cases:\n  a: {{{BODY}, {SPAN}, damping: 0.1}}\n  a.b: {{{BODY}, {SPAN}}}\n"


def mistakes(text: str, *overrides: str) -> list[str]:
    """The lines of the error that a file's text gives."""
    with pytest.raises(HodoError) as caught:
        parse(text, "x.yaml", overrides)
    return str(caught.value).split("\n")


def one_case(entries: str) -> Case:
    return parse(f"cases: {{a: {{{entries}}}}}", "x.yaml").cases["a"]


# What is read


ONE = """\
cases:
  a: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: 0,
      initial: {p: 1, q: 0, r: 0}, time: {end: 1}}
"""


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_every_config_obeys_the_schema_and_its_cases_come_back_from_their_dump(path: Path) -> None:
    config = load(path)
    assert config.text == path.read_text(encoding="utf-8")
    assert obeys_schema(config.text)
    for name, case in config.cases.items():
        assert case.name == name
        assert parse_case(dump(case)) == pickle.loads(pickle.dumps(case)) == case
        assert dump(parse_case(dump(case))) == dump(case)


def test_dump_is_complete_and_json_line_by_line() -> None:
    keys = f"{BODY}, time: {{end: 1e3}}, damping: 1e-5, tol: 1e-10, note: 'no: \"1\"'"
    assert dump(one_case(keys)) == (
        'name: "a"\nmodel: "linear-diag"\nform: "full"\ninertia: [1.0, 0.8, 0.6]\n'
        'damping: [1e-05, 1e-05, 1e-05]\ninitial: {"p": 0.8, "q": 0.5, "r": 0.74}\n'
        'time: {"start": 0.0, "end": 1000.0, "samples": 2722, "unit": "1"}\n'
        'inertia_unit: "1"\nmethod: "auto"\ntol: 1e-10\nprecision: "double"\nerror: true\n'
        'store: []\nnote: "no: \\"1\\""\n'
    )


@pytest.mark.parametrize(
    ("common", "own", "time"),
    [("end: 10, samples: 3", "values: [1, 2]", Time(end=2, samples=2, values=(1, 2))),
     ("start: -1, values: [1, 2]", "end: 3, samples: 5", Time(start=-1, end=3, samples=5)),
     ("end: 4, epoch: 3", "samples: 7", Time(end=4, samples=7, epoch=3)),
     ("start: 4, end: 0", "samples: 7", Time(start=4, end=0, samples=7)),
     ("start: 4", "values: [4, 3, 1]", Time(start=4, end=1, samples=3, values=(4, 3, 1))),
     ("end: 4, samples: 7", "start: 4", Time(start=4, end=4, samples=1)),
     ("start: 4", "end: 4", Time(start=4, end=4, samples=1)),
     ("end: 4, samples: 7", "end: 0", Time(samples=1, end=0))],
)  # fmt: skip
def test_listed_times_and_even_ones_replace_each_other(common: str, own: str, time: Time) -> None:
    text = f"defaults: {{time: {{{common}}}}}\ncases: {{a: {{{BODY}, time: {{{own}}}}}}}"
    case = parse(text, "x").cases["a"]
    assert case.time == time
    assert parse_case(dump(case)) == case


def test_defaults_are_merged_key_by_key_and_time_within_itself() -> None:
    text = """
defaults: {inertia: [3, 2, 1.5], damping: 0.2, resistance: {diagonal: 1, off_diagonal: 0},
           time: {end: 7, samples: 3}, initial: {p: 1, q: 1, r: 1}}
cases:
  one: {model: linear-diag, time: {samples: 5}, initial: {p: 2, q: 0, G: 9}}
  two: {model: tensor, inertia: [1, 1, 1]}
"""
    one, two = parse(text, "x.yaml").cases.values()
    assert one.time == Time(start=0.0, end=7.0, samples=5)
    start = {"p": 2.0, "q": 0.0, "r": None, "G": 9.0}
    assert one.data == {"inertia": (3.0, 2.0, 1.5), "damping": (0.2,) * 3, "initial": start}
    assert two.time == Time(end=7.0, samples=3)
    assert two.data["inertia"] == (1.0, 1.0, 1.0)
    assert "damping" not in two.data


def test_an_empty_value_takes_a_default_back() -> None:
    text = """\
defaults: {model: Lagrange-averaged, inertia: {A: 1.5, C: 1}, mu: 0.5, a: 0.1, b: 0.1, m: 0.2,
           initial: {theta: 1, r: 2}, tol: 1e-8, time: {values: [1, 2]}}
cases:
  all: {note: as it is}
  some: {form: averaged-u, m: null, tol: , time: {values: null, end: 3}}
"""
    every, some = parse(text, "x").cases.values()
    assert (every.data["m"], every.tol, every.time.values) == (0.2, 1e-8, (1, 2))
    assert (some.data["m"], some.tol, some.time) == (None, None, Time(end=3))
    kept = "m: form averaged-u has no m, which all other forms have"
    with pytest.raises(HodoError, match=f"^x:1:.*: defaults.{kept}$"):
        parse(text.replace(" m: null,", ""), "x")
    with pytest.raises(HodoError, match=r"^x:4:9: cases.all.tol: .* got an empty value\nx:5:37: "):
        parse(text.replace("tol: 1e-8, ", "").replace("note: as it is", "tol: "), "x")


SCALARS = [
    ("1e-3", 1e-3), ("1E5", 1e5), (".5", 0.5), ("5.", 5.0), ("-.5e+1", -5.0), ("+1", 1),
    ("010", 10), ("-0", 0), ("0x1F", 31), ("0o17", 15), ("True", True), ("false", False),
    ("~", None), ("null", None), ("Null", None), ("", None), (".inf", math.inf),
    ("-.INF", -math.inf), ("1e400", math.inf), ("1" * 400, math.inf), ("'1'", "1"),
    ('"a\\tb"', "a\tb"), ("'-'", "-"),
    *((text, text) for text in (
        "1_000", "0b1", "12:30:00", "1.2.3", "2026-01-01", "no", "off", "yes", "on", "y", "tRUE",
        "inf", "e5", "٣", "=")),
]  # fmt: skip
"""Plain and quoted texts, and their values."""


def test_scalars_follow_the_core_schema_of_yaml_1_2() -> None:
    text = "".join(f"a{i}: {text}\n" for i, (text, _) in enumerate(SCALARS))
    found = [*document.Source("x").read(text).values()]
    assert [repr(value) for value in found] == [repr(value) for _, value in SCALARS]
    assert math.isnan(document.Source("x").read(".NaN"))


def test_an_alias_is_its_anchor() -> None:
    text = f"cases:\n  a: &a {{{BODY}, {SPAN}}}\n  b: *a\n"
    text += f"  c: {{{BODY}, time: {{end: &e 3, start: *e}}}}\n"
    cases = parse(text, "x").cases
    assert cases["a"].data == cases["b"].data
    assert cases["c"].time == Time(start=3.0, end=3.0, samples=1)


def test_a_config_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_bytes(b"\xef\xbb\xbf" + GOOD.encode())
    assert list(load(tmp_path / "a.yaml").cases) == ["a", "a.b"]


# Mistakes


RULES = schema()


def resolved(rule: Any) -> Any:
    """A part of the schema, which may be one of its definitions."""
    return RULES["$defs"][rule["$ref"].rsplit("/", 1)[1]] if "$ref" in rule else rule


def properties(*path: str | int) -> dict[str, Any]:
    """The keys of a part of the schema."""
    rule = RULES
    for step in path:
        rule = resolved(rule[step])
    return resolved(rule)["properties"]


CASE_KEYS = properties("properties", "cases", "additionalProperties")
COMMON = [key for key in CASE_KEYS if key != "model"]
LINEAR = ", ".join(["model", "form", "inertia", "damping", "initial", "attitude", *COMMON])
*FIRST_METHODS, LAST_METHOD = resolved(resolved(CASE_KEYS["method"])["anyOf"][0])["enum"]
METHODS = f"{', '.join(FIRST_METHODS)} or {LAST_METHOD}"
CLAIM = properties("properties", "claims", "anyOf", 0, "items")
LINES = ["model: linear-diag", "inertia: [1, 0.8, 0.6]", "initial: {p: 0.8, q: 0.5, r: 0.74}",
         "time: {end: 10}"]  # fmt: skip
ENTRIES = r"""
dampng: 1 -> 5 .dampng: unknown key; did you mean 'damping'? (valid: LINEAR)
DAMPING: 1 -> 5 .DAMPING: unknown key; did you mean 'damping'? ...
lambda: 1 -> 5 .lambda: unknown key; did you mean 'damping'? ...
torque: [0, 0, 1] -> 5 .torque: is a key of model cavity+constant or torques, and this is ...
resistance: 1 -> 5 .resistance: is a key of model tensor or torques, ... mean 'damping'?
initial: {p:0.8, q: 1, r: 1} -> 15 .initial.p:0.8: unknown key; put a space after the colon: ...
initial: {p: 60 degrees, q: 1, r: 1} -> 18 .initial.p: expected ... or such as '2.5 deg', got ...
initial: {p: 0, q: 1e-300, r: 1} -> 24 .initial.q: 1e-300 is out of range, 1e-154 to 1e+154: ...
damping: [1e-155, 0, 0] -> 15 .damping.0: 1e-155 is out of range, 1e-154 to 1e+154: take other ...
time: {end: 1e155} -> 17 .time.end: 1e+155 is out of range, ...
sweep: {initial.q: {values: [1e-154, 1e155]}} -> 42 .sweep.initial.q.values.1: 1e+155 is out ...
initial: {p: 1, q: 1} -> 14 .initial: r missing: give p, q and r, or two of them and G
initial: [1, .1, .1] -> 14 .initial: expected ... a list of 3; write {p: 1, q: 0.1, r: 0.1}
initial: {omega: [1, .1, .1]} -> 15 .initial.omega: unknown key; its components are p, q and r ...
inertia: [1 kg, 1, 1] -> 15 .inertia.0: ... `unit` of time and `inertia_unit` name units
inertia: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] -> 14 .inertia: ... got 3 rows; a full tensor is ...
inertia: [1, 0, 1] -> 18 .inertia.1: expected a positive number, got 0
inertia: [1, 2, 4] -> 21 .inertia.2: no body has A3 = 4 larger than the sum of the other two
inertia: [1, 1, 1e-120] -> 21 .inertia.2: 1e-120 is out of range, 1e-100 to 1e+100: ...
damping: 0,005 -> 14 .damping: ..., got '0,005'; decimals are written with a point, as 1.5
damping: [0,005, 0,004, 0,003] -> 14 .damping: expected 3 ... list of 6; decimals are written ...
damping: '0.1' -> 14 .damping: expected a finite number, got '0.1'; leave out the quotes
damping: true -> 14 .damping: expected a finite number, got true
damping: [0, -.inf, 0] -> 18 .damping.1: expected a finite number, got -inf
damping: [0, 0] -> 14 .damping: expected 3 numbers or one for all, got a list of 2
tol: 0 -> 10 .tol: expected a positive number < 1, got 0
tol: 1d-3 -> 10 .tol: expected ..., got '1d-3'; an exponent is written with e, as 1e-3
tol: 1_000 -> 10 .tol: expected ..., got '1_000'; digits stand together, without _
tol: 1__x -> 10 .tol: expected a finite positive number < 1, got '1__x'
tol: 60 deg -> 10 .tol: ... only angles and angular velocities are given in degrees
tol: !foo 1 -> 10 .tol: the tag '!foo' is not allowed here
tol: !!int 1.5 -> 10 .tol: the tag 'tag:yaml.org,2002:int' is not allowed here
tol: *t -> 10 .tol: *t has no anchor before it
time: 10 -> 11 .time: expected a mapping of start, end, ..., unit, got 10; write {end: 10}
time: [5, 10] -> 11 .time: ..., got a list of 2; write {start: 5, end: 10}
time: {end: 1, end: 2} -> 20 .time.end: duplicate key; the first is in line 3
time: {end: 1, samples: 0} -> 29 .time.samples: expected an integer >= 1, <= 1e+15, got 0
time: {start: 2} -> 11 .time: missing 'end'
time: {values: 3} -> 20 .time.values: expected a list of one or more: number, got 3
time: {values: [1, 2, 2]} -> 27 .time.values.2: expected a time after 2, got 2
time: {values: [-1, -2, -2]} -> 29 .time.values.2: expected a time before -2, got -2
time: {start: 2, values: [1, 3]} -> 31 .time.values.0: expected no time before start, 2, got 1
time: {values: [1], samples: 3} -> 34 .time.samples: leave it out where values: gives the times
time: {steps: yes, end: 1} -> 12 .time.steps: unknown key; did you mean 'samples'? ...
time: {start: 1.7e9, end: 1700000000.00001, samples: 1001} -> 58 .time.samples: ... at most 22, ...
method: dop853 -> 13 .method: expected METHODS, got 'dop853'; did you mean 'DOP853'?
precision: long -> 16 .precision: expected double, extended or quadruple, got 'long'
error: 1 -> 12 .error: expected on or off, got 1
note: 12 -> 11 .note: expected text, got 12; put it in quotes
note: -> 5 .note: expected text, got an empty value
note: "a\0b" -> 11 .note: control characters are not allowed in text
store: {a: 1} -> 12 .store: expected a name or a list of names, got a mapping
store: [omega, omga] -> 20 .store.1: unknown variable 'omga'; did you mean 'omega'? ...
sweep: 3 -> 12 .sweep: expected a mapping of keys (damping.2) to {linspace: [first, last, ...
sweep: {damping: [.1, .2]} -> 22 .sweep.damping: ... a list of 2; write {values: [0.1, 0.2]}
sweep: {damping.2: {values: [1, .nan]}} -> 37 .sweep.damping.2.values.1: expected a finite ...
sweep: {damping.2: {values: [1, 2], linspace: [1, 2, 3]}} -> 24 ..., of 2 keys: 'values, linspace'
sweep: {damping.2: {linspce: [1, 2, 3]}} -> 25 ... did you mean 'linspace'? ...
sweep: {damping.2: {logspace: [0, 2, 5]}} -> 36 .sweep....logspace.0: ... positive number, got 0
sweep: {damping.3: {values: [1]}} -> 24 ...: the case has no such number: damping.3
sweep: {dampng: {values: [1]}} -> 21 .sweep.dampng: ... did you mean 'damping'? ...
sweep: {time.end: {values: [1]}} -> 23 ...: time.end is not a number of the model, ...
sweep: {inertia.0: {values: [1, -1]}} -> 37 ...values.1: expected a positive number, got -1.0
sweep: {inertia: {values: [1]}} -> 22 ...: inertia is not a number: name one of its places, ...
sweep: {initial: {values: [1]}} -> 32 ...values.0: expected a mapping of p, q, r, G, got 1.0
sweep: {time: {sphere: {count: 2}}} -> 19 ...: time is a name in every result: call the axis ...
sweep: {d: {sphere: {count: 0}}} -> 33 ...: expected an integer >= 1, <= 1e+09, got 0
sweep: {d: {sphere: {count: 2}}, e: {sphere: {count: 2}}} -> 50 ...: one axis may be a sphere
sweep: {d: {zip: {damping.0: {values: [1]}, damping.1: {values: [1, 2]}}}} -> 22 ... zipped
sweep: {damping.2: {values: [1]}, d: {zip: {damping.2: {values: [1]}}}} -> 60 ... already, ...
sweep: {d: {sphere: {count: 1e6}}, damping.2: {linspace: [0, 1, 1e4]}} -> 12 ... 1e+09 members
sweep: &s {p: [*s]} -> 20 .sweep.p.0: *s stands inside itself
model: linear-dig -> 12 .model: expected ..., got 'linear-dig'; did you mean 'linear-diag'?
<<: {p: 1} -> 5 : merge keys (<<) are not part of YAML 1.2; write the keys out, or use defaults:
? [p]\n    : 1 -> 7 : a key is plain text, without anchor or tag
"""
"""An entry of a case, the column and the end of its message; `...` stands for any words."""


def rows_of(table: str) -> list[list[str]]:
    return [line.split(" -> ") for line in table.strip().splitlines()]


def fits(line: str, right: str) -> bool:
    """Whether a line of an error is the right one, in which `...` stands for any words."""
    return bool(re.fullmatch(re.escape(right).replace(r"\.\.\.", ".*"), line))


@pytest.mark.parametrize(("entry", "place_and_message"), rows_of(ENTRIES))
def test_a_mistake_is_named_with_its_place(entry: str, place_and_message: str) -> None:
    right = place_and_message.replace("LINEAR", LINEAR).replace("METHODS", METHODS)
    column, _, message = right.partition(" ")
    rest = [line for line in LINES if line.split(":")[0] != entry.split(":")[0]]
    text = "\n    ".join(["cases:\n  a:", entry.replace(r"\n", "\n"), *rest]) + "\n"
    (line,) = mistakes(text)
    assert fits(line, f"x.yaml:3:{column}: cases.a{message}")


def test_a_switch_takes_the_words_of_python_and_yaml_too() -> None:
    """`true` in a file is Python's True."""
    text = f"cases: {{a: {{{BODY}, {SPAN}, attitude: %s, error: %s}}}}"
    yes, no = (parse(text % words, "x").cases["a"] for words in (("true",) * 2, ("no", "off")))
    assert yes == parse(text % ("yes", "on"), "x").cases["a"]
    assert (yes.error, no.error, no.data.get("attitude")) == (True, False, None)


CLAIMS = f"""{ONE}\
claims:
- &c {{id: c, where: w, statement: s, cases: [a], expect: reproduced, check: CHECK}}
"""
TOP = "{model: Lagrange-averaged, inertia: {A: 2, C: 5}, mu: 1, a: [1], b: x, time: {end: 10}"
MESSAGES: list[tuple[str, ...]] = [
    ("", "1:1: expected a mapping of keys to values, got an empty value"),
    ("[1, 2]", "1:1: expected a mapping of keys to values, got a list of 2"),
    ("cases: {}", "1:8: cases: there is no case"),
    ("cases:\n", "1:1: missing 'cases'"),
    ("cases: {a: 3}", "1:12: cases.a: expected a mapping, got 3"),
    ("cases:\n  a: {}", "2:6: cases.a: missing 'model', 'time'"),
    (f"{GOOD}titel: t\n", "4:1: titel: unknown key; did you mean 'title'? (valid: title, "
     "references, defaults, cases, figures, style, bench, claims, errata)"),
    (f"{GOOD}extra:\n", "4:1: extra: unknown key (valid: ...)"),
    (f"{GOOD}claims: [1]\n", f"4:10: claims.0: expected a mapping of {', '.join(CLAIM)}, got 1"),
    (f"{GOOD}defaults: {{resistance: 3}}\n",
     "4:12: defaults.resistance: no case here takes this key"),
    (f"{GOOD}bench: {{methods: [Radauu]}}", "4:19: bench.methods.0: ... did you mean 'Radau'?"),
    # Not YAML, or none that is allowed.
    ("a: 1\n--- 2", "2:1: a second document starts here; one is allowed"),
    ("a: [1, 2\n", "2:1: not YAML: the [ of line 1 is not closed, or lacks a comma"),
    ("a: [1,, 2]", "1:7: not YAML: the [ or { of line 1 is not closed, or has a comma too many"),
    ("cases: {a: {model: linear-diag\n",
     "2:1: not YAML: the { of line 1 is not closed, or lacks a comma"),
    ("title: 'a\ncases: {}\n", "3:1: not YAML: the quote of line 1 is not closed"),
    ("a:\n\tb: 1", "2:1: not YAML: indent with spaces, not with a tab; ..."),
    ("title: *bold*\n", "1:13: not YAML: put a text that begins with * in quotes"),
    ("title: @me\n", "1:8: not YAML: indent with spaces, not with a tab; put a text ..."),
    ("cases:\n  a:\n    model linear-diag\n    tol: 1\n",
     "4:8: not YAML: a second ': ' on one line, or none on the line before: ..."),
    ("cases:\n  a: b: c\n",
     "2:7: not YAML: a second ': ' on one line, or none on the line before: ..."),
    *((f"cases:\n  a:\n    tol: 1\n    damping:0.01\n{rest}",
       "4:5: not YAML: no ': ' between key and value: put a space after the colon")
      for rest in ("", "    # r\n", "\n    error: no\n", "    time:\n      end: 1\n")),
    ("a: b\n c\0d", "2:3: the character U+0000 is not allowed"),
    ("a: \ud800", "1:4: the character U+D800 is not allowed"),
    ("a: !!python/object:os.system []",
     "1:4: a: the tag 'tag:yaml.org,2002:python/object:os.system' is not allowed here"),
    # Names.
    ("cases: {a/b: {}}", f"1:9: cases.a/b: {NAME_RULE}"),
    (f"cases: {{{'n' * 101}: {{}}}}", f"1:9: cases.{'n' * 101}: {NAME_RULE}"),
    (f"{GOOD}figures: {{../f: {{kind: sphere, cases: a}}}}\n", f"4:11: figures.../f: {NAME_RULE}"),
    *((f"cases: {{{name}: {{}}}}", "1:9: cases: a key is printable text of at most 128 characters")
      for name in ('"a\\0b"', "n" * 300)),
    # Figures, and claims.
    (f"{GOOD}figures: {{f: {{cases: a}}}}\n", "4:14: figures.f: missing 'kind'"),
    (f"{GOOD}figures: {{f: {{kind: hodgraph, foo: 1}}}}\n",
     "4:21: figures.f.kind: expected hodograph, sphere, ..."),
    (f"{GOOD}figures: {{f: {{kind: sphere, cases: [a, aa]}}}}\n",
     "4:40: figures.f.cases.1: unknown name 'aa'; did you mean 'a'? (valid: a, a.b)"),
    (f"{ONE}figures: {{f: {{kind: sphere, cases: a, style: {{font_size: 9}}}}}}",
     "4:47: figures.f.style.font_size: unknown key (valid: width, height, rc, axes)"),
    (f"{ONE}figures: {{f: {{kind: series, cases: a, variables: T, formula: {{T: exp(-t}}}}}}",
     "4:66: figures.f.formula.T: column 4 of the expression: '(' was never closed"),
    (CLAIMS.replace("CHECK", "{kind: monotone, of: [foo], sense: falls}"),
     "5:99: claims.0.check.of.0: expected a quantity over time, got 'foo'"),
    (CLAIMS.replace("CHECK", "{kind: bound, of: energy, least: 1}"),
     "5:95: claims.0.check.of: expected a quantity, got 'energy'; did you mean 'T'?"),
    # Names that are true and false are to be quoted.
    (CLAIMS.replace("CHECK", "{kind: crossings, least: 1}").replace("id: c", "id: true"),
     "5:11: claims.0.id: expected text, got true; put it in quotes"),
    # What follows from a mistake is not a second one; one in a default is named at its place.
    (f"cases: {{a: {TOP}, initial: {{theta: 1, r: 2}}}}}}",
     "1:58: cases.a.inertia.C: no body has C = 5 larger than 2 A = 4",
     "1:80: cases.a.b: column 1 of the expression: unknown name 'x' ..."),
    (f"cases:\n  a: {{model: cavity+constant, {SPAN}, spin_reversal: stop}}\n",
     "2:6: cases.a: missing 'inertia', 'initial'",
     "2:48: cases.a.spin_reversal: is a key of form averaged or averaged-as-printed, ..."),
    ("defaults: {inertia: [1, 1, 3], time: {end: x}, tol: no}\ncases:\n" + "".join(
        f"  c{i}: {{model: linear-diag, initial: {{p: 1, q: 1, r: 1}}, time: {{samples: 3}}}}\n"
        for i in range(5)),
     "1:28: defaults.inertia.2: no body has A3 = 3 larger than the sum of the other two",
     "1:44: defaults.time.end: expected a finite number, got 'x'",
     "1:53: defaults.tol: expected a finite positive number < 1, got 'no'"),
    ("case: {a: 1}\nfigures: {f: {kind: sphere, cases: [a]}}",
     "1:1: case: unknown key; did you mean 'cases'? ..."),
    (f"cases:\n  a: {{{BODY}, time: {{end: 1,5}}}}\n",
     "2:101: cases.a.time.5: unknown key; decimals are written with a point, as 1.5 ..."),
    # All mistakes are raised together, by line.
    ("figures:\n"
     "  f: {kind: sphere, cases: [b, c]}\n"
     "cases:\n"
     f"  a: {{{BODY}, {SPAN}, tol: 3, foo: 1}}\n"
     "  b: {model: tensor}\n"
     "  a: {}\n"
     "titel: t\n",
     "2:32: figures.f.cases.1: unknown name 'c' (valid: a, b)",
     "4:109: cases.a.tol: expected a positive number < 1, got 3",
     "4:112: cases.a.foo: unknown key (valid: ...",
     "5:6: cases.b: missing 'inertia', 'resistance', 'initial', 'time'",
     "6:3: cases.a: duplicate key; the first is in line 4",
     "7:1: titel: unknown key; did you mean 'title'? (valid: ..."),
]  # fmt: skip
"""Texts of files and the lines of their errors."""


@pytest.mark.parametrize("row", MESSAGES)
def test_mistakes_in_a_file_are_lines_with_their_places(row: tuple[str, ...]) -> None:
    text, *expected = row
    lines = mistakes(text)
    assert len(lines) == len(expected)
    for line, right in zip(lines, expected, strict=True):
        assert fits(line, f"x.yaml:{right}")


def test_a_broken_line_in_a_name_stays_on_one_line() -> None:
    with pytest.raises(HodoError, match=r"^a\\nb.yaml:1:1: [^\n]*$"):
        parse("[]", "a\nb.yaml")


# Files that cannot be read


@pytest.mark.parametrize(
    ("raw", "message"),
    [(b"a: 1\nb: \xff", ":2:4: not UTF-8 text (byte 0xff)"),
     (GOOD.encode("utf-16"), ":1:1: not UTF-8 text (byte 0xff)"),
     (b"#" * (document.MAX_BYTES + 1), ":1:1: larger than 16 MB; split the file"),
     (b"\x89HDF\r\n", ": a result, where a case file (*.yaml) is expected")],
)  # fmt: skip
def test_what_is_no_text_is_refused(tmp_path: Path, raw: bytes, message: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(raw)
    with pytest.raises(HodoError) as caught:
        load(path)
    assert str(caught.value) == f"{path}{message}"


@pytest.mark.parametrize("name", ["missing.yaml", ".", "a\0b", "n" * 300])
def test_what_is_no_file_is_one_line(tmp_path: Path, name: str) -> None:
    with pytest.raises(HodoError, match=r"\A[^\n]+: [^\n]+\Z"):
        load(str(tmp_path) + "/" + name)


@pytest.fixture(params=["CSafeLoader", "SafeLoader"])
def loader(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both parsers of PyYAML: its own, and libyaml's where there is one."""
    monkeypatch.setattr(document, "_LOADER", getattr(yaml, request.param, yaml.SafeLoader))


BOMBS = {
    **{mark: mark * 10**5 for mark in ("[", "{a: ", "- ", "? ", "&a ", "!", "'")},
    "closed brackets": "a: " + "[" * 10**4 + "]" * 10**4,
    "indentation": "\n".join(" " * i + "a:" for i in range(2000)),
    "aliases": "a0: &a0 [x, x, x, x, x, x, x, x, x]\n"
    + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)),
    "wide aliases": "a: &a [" + "1, " * 1000 + "1]\nb: [" + "*a, " * 1000 + "1]",
    "unknown keys": f"cases: {{a: {{{', '.join(f'resistanc{i}: 1' for i in range(600))}}}}}",
    "itself": "cases: &c {a: *c}",
}


@pytest.mark.usefixtures("loader")
@pytest.mark.parametrize("text", BOMBS.values(), ids=BOMBS.keys())
def test_a_bomb_is_refused_at_once(text: str) -> None:
    lines, work = counted(mistakes, text)
    # Up to 80 a letter, of many wrong keys; what a bomb is meant to do takes for ever.
    assert work < 20_000 + 200 * len(text)
    assert len(lines) <= 1001  # the last one says that it stopped there
    assert max(map(len, lines)) < 600


@pytest.mark.parametrize(
    ("name", "place"), [("aliases", "6:10: a5.0"), ("wide aliases", "2:401: b.99")]
)
def test_the_values_that_aliases_stand_for_are_counted(name: str, place: str) -> None:
    words = f"x.yaml:{place}: aliases stand for more than 100000 values"
    assert mistakes(BOMBS[name]) == [words]


@pytest.mark.usefixtures("loader")
def test_both_parsers_read_the_same() -> None:
    path = ROOT / "configs" / "paper1.yaml"
    config = parse(path.read_text(encoding="utf-8"), str(path))
    assert config == load(path)
    assert mistakes("cases:\n  é: {ö: ü, ö: 1}") == [
        f"x.yaml:2:3: cases.é: {NAME_RULE}",
        "x.yaml:2:13: cases.é.ö: duplicate key; the first is in line 2",
    ]


def test_a_large_file_is_read_in_proportion() -> None:
    def work(n: int) -> int:
        cases = "".join(f"  c{i}: {{damping: [0, 0, {i}]}}\n" for i in range(n))
        config, work = counted(parse, f"defaults: {{{BODY}, {SPAN}}}\ncases:\n{cases}", "x")
        assert len(config.cases) == n
        return work

    few, many = work(40), work(400)
    assert few < many < 11 * few


# Overrides


def overridden(*overrides: str, text: str = GOOD) -> dict[str, Case]:
    return parse(text, "x.yaml", overrides).cases


def test_a_flat_disc_is_a_body_in_any_order_of_its_axes() -> None:
    for moments in itertools.permutations(["0.1", "0.3", "0.4"]):
        assert one_case(f"{BODY.replace('1, 0.8, 0.6', ', '.join(moments))}, {SPAN}")


UNDER_TORQUES = BODY.replace("linear-diag", "torques")
COMMON_TIMES = f"defaults: {{time: {{end: 9, samples: 3}}}}\ncases:\n  a: {{{BODY}}}\n"
SWEPT = "sweep: {initial.p: {values: [1, 2]}, damping.0: {linspace: [0, 1, 9]}}"
START = {"p": 0.8, "q": 0.5, "r": 0.74}
NINE = {"start": 0.0, "end": 9.0, "samples": 3, "unit": "1"}
ALIASES = (
    f"cases:\n  a: &a {{{BODY}, time: &t {{end: 5, samples: 3}}}}\n  b: *a\n"
    f"  c: {{{BODY}, time: *t}}\n"
)
OVERRIDDEN: list[tuple[str, str, dict[str, dict[str, Any]]]] = [
    (GOOD, "a.initial.p=0.1", {"a": {"initial": {**START, "p": 0.1}}}),
    (GOOD, "a.initial.p=90 deg", {"a": {"initial": {**START, "p": math.pi / 2}}}),
    (GOOD, "a.damping.2=0.001", {"a": {"damping": (0.1, 0.1, 0.001)}}),
    (GOOD, "a.damping=3e-1", {"a": {"damping": (0.3, 0.3, 0.3)}}),
    (GOOD, "a.damping=[1, 2, 3]", {"a": {"damping": (1.0, 2.0, 3.0)}}),
    (GOOD, "a.b.damping.0=1", {"a.b": {"damping": (1.0, 0.0, 0.0)}}),
    (GOOD, "a*.damping=2", {x: {"damping": (2.0, 2.0, 2.0)} for x in ("a", "a.b")}),
    (GOOD, "*.damping.1=2",
     {"a": {"damping": (0.1, 2.0, 0.1)}, "a.b": {"damping": (0.0, 2.0, 0.0)}}),
    (GOOD, "a.b.max_steps=10", {"a.b": {"max_steps": 10}}),
    # In their order.
    (GOOD, "a.damping.0=1; a.damping.0=2", {"a": {"damping": (2.0, 0.1, 0.1)}}),
    (GOOD, "*.assumes.r0=G(0) = 1; a.assumes.T=2 s",
     {"a": {"assumes": {"r0": "G(0) = 1", "T": "2 s"}}, "a.b": {"assumes": {"r0": "G(0) = 1"}}}),
    (GOOD, "a.sweep.damping.0.values=[0, 1]", {"a": {"sweep": {"damping.0": {"values": (0, 1)}}}}),
    # What stands for equal ones is written out.
    *((f"cases:\n  a: {{{UNDER_TORQUES}, {SPAN}, {key}: 0.004}}\n", f"a.{key}.2=0.5",
       {"a": {key: (0.004, 0.004, 0.5)}}) for key in ("damping", "quadratic", "torque")),
    (f"cases:\n  a: {{{UNDER_TORQUES}, {SPAN}, damping: exp(-k*t), constants: {{k: 1}}}}\n",
     "a.damping.1=0.5; a.constants.k=2",
     {"a": {"damping": ("exp(-k*t)", 0.5, "exp(-k*t)"), "constants": {"k": 2.0}}}),
    # Keys of sweeps have points.
    (f"cases:\n  a: {{{BODY}, {SPAN}, {SWEPT}}}\n", "a.sweep.damping.0.linspace.2=5",
     {"a": {"sweep": {"initial.p": {"values": (1, 2)}, "damping.0": {"linspace": (0, 1, 5)}}}}),
    # Times replace those that do not count beside them; defaults stay where they do.
    (COMMON_TIMES, "a.time.values=[1, 2]",
     {"a": {"time": {"start": 0.0, "values": (1.0, 2.0), "unit": "1"}}}),
    (COMMON_TIMES, "a.time.epoch=2", {"a": {"time": {**NINE, "epoch": 2.0}}}),
    (COMMON_TIMES, "a.time.samples=4", {"a": {"time": {**NINE, "samples": 4}}}),
    # Where aliases stand for a value, one is changed.
    (ALIASES, "a.time.end=7; a.initial.p=9; a.inertia.0=1.1",
     {"a": {"time": {**NINE, "end": 7.0}, "initial": {**START, "p": 9.0},
            "inertia": (1.1, 0.8, 0.6)}}),
]  # fmt: skip
"""Texts, overrides, and the entries that these change, by cases."""


@pytest.mark.parametrize(("text", "overrides", "changes"), OVERRIDDEN)
def test_overrides_change_what_they_name_and_nothing_else(text, overrides, changes):
    plain, found = overridden(text=text), overridden(*overrides.split("; "), text=text)
    for name, case in found.items():
        before = plain[name].entries
        changed = {key: x for key, x in case.entries.items() if before.get(key) != x}
        assert changed == changes.get(name, {})


OF_OVERRIDES = f"""
a.damping -> an override reads CASE.KEY=VALUE
a=1 -> an override reads CASE.KEY=VALUE
a{".a" * 1000}=1 -> an override reads CASE.KEY=VALUE
aa.tol=1e-3 -> unknown case 'aa'; did you mean 'a'? (valid: a, a.b)
z*.tol=1e-3 -> unknown case 'z*' (valid: a, a.b)
a.dampng=1 -> cases.a.dampng: unknown key; did you mean 'damping'? (valid: {LINEAR})
a.damping.3=1 -> cases.a.damping.3: there is no '3' in a list whose positions are 0 to 2
a.damping.x=1 -> cases.a.damping.x: there is no 'x' in a list whose positions are 0 to 2
a.damping.1=x -> cases.a.damping.1: expected a finite number, got 'x'
a.store.0=omega -> cases.a.store.0: there is no '0' in an empty list
a.time.end.0=1 -> cases.a.time.end.0: there is no '0' in 10.0
a.constants.w=1 -> cases.a.constants: is a key of model Lagrange-averaged or torques, ...
a.sweep.damping.0=[1, 2] -> cases.a.sweep.damping.0: expected ...; write {{values: [1, 2]}}
a.tol= -> cases.a.tol: expected a finite positive number < 1, got an empty value
a.inertia.0=9 -> cases.a.inertia.0: no body has A1 = 9 larger than the sum of the other two
a.tol=[1 -> not YAML: the [ is not closed, or lacks a comma
a.tol={"[" * 100} -> nested deeper than 50 levels
"""


@pytest.mark.parametrize(("override", "message"), rows_of(OF_OVERRIDES))
def test_a_mistake_of_an_override_names_it(override: str, message: str) -> None:
    (line,) = mistakes(GOOD, override)
    assert fits(line, f"--set {override}: {message}")


def test_mistakes_of_overrides_follow_those_of_the_file() -> None:
    text = GOOD.replace("damping: 0.1", "damping: x")
    assert mistakes(text, "b.tol=1", "a.tol=[", "a.b.tol=3") == [
        "x.yaml:2:113: cases.a.damping: expected a finite number, got 'x'",
        "--set a.b.tol=3: cases.a.b.tol: expected a positive number < 1, got 3",
        "--set a.tol=[: not YAML: the [ or { is not closed, or has a comma too many",
        "--set b.tol=1: unknown case 'b' (valid: a, a.b)",
    ]


# Round trips

TEXTS = st.text(
    st.characters(exclude_categories=["Cs", "Cc"]) | st.sampled_from("\n\t:#'\"\\-{}[]"),
    max_size=30,
)
WORDS = st.sampled_from(["no", "1e-3", "null", "", "0x1", "~", "True", ".inf", "-", "010"])
PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | TEXTS
    | WORDS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
    max_leaves=12,
)


@given(PLAIN)
def test_what_is_written_is_read_back(value: Any) -> None:
    assert repr(document.Source("x").read(document.write(value))) == repr(value)


def test_what_is_no_dump_is_refused() -> None:
    whole = dump(one_case(f"{BODY}, {SPAN}"))
    for text in (
        "",
        "[]",
        whole.replace('name: "a"', ""),
        whole.replace('name: "a"', 'name: "../a"'),
        whole + "foo: 1\n",
        whole + "note: twice\n",
    ):
        with pytest.raises(HodoError, match=r"\Acase:\d+:\d+: [^\n]+\Z"):
            parse_case(text)


# Schema and key table


TYPES = {"object": dict, "array": list, "string": str, "null": type(None)}
SILENT = {"$schema", "$defs", "title", "description", "default", "then"}


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value == value


def has_type(value: Any, name: str) -> bool:
    if name in TYPES:
        return isinstance(value, TYPES[name])
    return is_number(value) and (name == "number" or value == int(value))


def conforms(value: Any, rule: Any) -> bool:
    """Whether a value obeys a JSON Schema: those words of it that the one of case files uses."""
    if isinstance(rule, bool):
        return rule
    obeys = partial(conforms, value)
    entries, items, text = (value if isinstance(value, of) else None for of in (dict, list, str))

    def within(of: Any, compare: Callable[[Any, Any], bool], size: Any = len) -> Any:
        return lambda most: of is None or compare(size(of), most)

    of_number = partial(within, value if is_number(value) else None, size=float)
    known = rule.get("properties", {})
    words: dict[str, Callable[[Any], bool]] = {
        "$ref": lambda name: obeys(resolved(rule)),
        "anyOf": lambda parts: any(map(obeys, parts)),
        "oneOf": lambda parts: sum(map(obeys, parts)) == 1,
        "allOf": lambda parts: all(map(obeys, parts)),
        "if": lambda part: not obeys(part) or obeys(rule["then"]),
        "type": lambda x: any(has_type(value, y) for y in ([x] if isinstance(x, str) else x)),
        # Python's True is 1, and JSON's is not.
        "enum": lambda entries: (type(value), value) in [(type(x), x) for x in entries],
        "const": lambda other: value == other,
        "minimum": of_number(operator.ge), "exclusiveMinimum": of_number(operator.gt),
        "maximum": of_number(operator.le), "exclusiveMaximum": of_number(operator.lt),
        "minLength": within(text, operator.ge), "maxLength": within(text, operator.le),
        "pattern": lambda pattern: text is None or bool(re.search(pattern, text)),
        "minItems": within(items, operator.ge), "maxItems": within(items, operator.le),
        "items": lambda part: all(conforms(item, part) for item in items or ()),
        "minProperties": within(entries, operator.ge),
        "maxProperties": within(entries, operator.le),
        "required": lambda names: entries is None or {*names} <= {*entries},
        "propertyNames": lambda part: all(conforms(name, part) for name in entries or ()),
        "properties": lambda parts: all(
            conforms(item, parts.get(name, True)) for name, item in (entries or {}).items()),
        "additionalProperties": lambda part: all(
            conforms(item, part) for name, item in (entries or {}).items() if name not in known),
    }  # fmt: skip
    return all(words[word](wanted) for word, wanted in rule.items() if word not in SILENT)


def loads(text: str) -> bool:
    try:
        parse(text, "mine.yaml")
    except HodoError:
        return False
    return True


def obeys_schema(text: str) -> bool:
    return conforms(document.Source("x").read(text), RULES)


@pytest.mark.parametrize(
    "entry",
    ["dampng: 1", "damping: x", "damping: [0, 0]", "inertia: [1, 0, 1]", "initial: {x: 1}",
     "time: {samples: 0}",
     "model: foo", "form: foo", "method: foo", "tol: 0", "error: x", "note: 1", "resistance: 1"],
)  # fmt: skip
def test_the_schema_finds_the_mistakes_that_a_schema_can(entry: str) -> None:
    rest = [line for line in LINES if line.split(":")[0] != entry.split(":")[0]]
    assert obeys_schema("\n    ".join(["cases:\n  a:", *LINES]))
    assert not obeys_schema("\n    ".join(["cases:\n  a:", entry, *rest]))


@pytest.mark.parametrize(
    ("default", "own"),
    [("method: RK45", "method: null"), ("time: {samples: 5}", "time: {end: 10, samples: null}"),
     ("time: null", "tol: 1e-9"), ("time: {samples: null}", "time: {end: 10, samples: 5}"),
     ("assumes: {x: y, z: y}", "assumes: {x: null}"), ("assumes: {x: y}", "assumes: {}"),
     ("assumes: {x: y}", "assumes: null"), ("form: full", "form: null"),
     ("damping: 1", "damping: null"), ("model: null", "method: RK45")],
)  # fmt: skip
def test_the_schema_takes_empty_values_where_the_loader_does(default: str, own: str) -> None:
    rest = SPAN if "time" not in own else "error: off"
    text = f"defaults: {{{default}}}\ncases: {{a: {{{BODY}, {rest}, {own}}}}}\n"
    assert loads(text)
    assert obeys_schema(text)
    sections = RULES["properties"].keys() - {"cases", "defaults"}
    empty = "".join(f"{section}:\n" for section in sections)
    assert loads(text + empty)
    assert obeys_schema(text + empty)


def test_an_empty_default_may_be_written() -> None:
    rules = [reduce(operator.getitem, path, RULES) for path in paths(RULES)]
    declared = [rule for rule in rules if isinstance(rule, dict) and "description" in rule]
    empty = [rule for rule in declared if rule.get("default") in ([], {})]
    assert len(empty) > 10
    for rule in empty:
        assert conforms(rule["default"], rule), rule["description"]


def test_the_schema_takes_what_the_loader_takes() -> None:
    whole = plain(document.Source("x").read((ROOT / "configs" / "attitude.yaml").read_text()))
    # What no case inherits of the defaults is not looked at by the loader.
    for path in Random(1).sample([x for x in paths(whole) if x[0] != "defaults"], 20):
        *above, key = path
        parent = reduce(operator.getitem, above, whole)
        known = parent[key]
        for value in (None, {}, [], [known], True, "x1", 1.0):
            parent[key] = value
            text = document.write(whole)
            assert obeys_schema(text) or not loads(text), path
        parent[key] = known
    for key in ("damping", "quadratic", "torque"):
        for value in ("0.1", "0.1*exp(-t)", "[0.1, 0.1*t, 0.2]", "[0, 1]", "{law: x}"):
            text = f"cases: {{a: {{{UNDER_TORQUES}, {key}: {value}, {SPAN}}}}}"
            is_right = value not in ("[0, 1]", "{law: x}")
            assert (obeys_schema(text), loads(text)) == (is_right, is_right)


def plain(value: Any) -> Any:
    """A value of a document as Python's own dictionaries and lists."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    return [plain(entry) for entry in value] if isinstance(value, list) else value


def paths(value: Any) -> Iterator[tuple[Any, ...]]:
    """Where the values within a value stand."""
    is_list = isinstance(value, list)
    for key, entry in enumerate(value) if is_list else dict.items(value or {}):
        yield (key,)
        yield from ((key, *path) for path in paths(entry)) if isinstance(entry, dict | list) else ()


def test_the_key_tables_have_every_key_of_each_group() -> None:
    printed = call(ROOT, "schema", "--table").stdout
    groups = dict(part.split("** |", 1) for part in printed.split("\n| **")[1:])
    named = {
        heading: [row.split("`")[1] for row in text.splitlines() if row.startswith("| `")]
        for heading, text in groups.items()
    }
    every = {*named["Every case"], *named["Several models"]}
    of_models = {x: {*keys} for x, keys in named.items() if x.startswith("Model ")}
    assert {"time.end", *COMMON} <= every.union(*of_models.values())
    assert {f"Model `{model}`" for model in resolved(CASE_KEYS["model"])["enum"]} == {*of_models}
    assert named["Model `linear-diag`"] == ["form", "damping"]
    assert "| `damping` | 3 numbers or one for all |" in groups["Model `linear-diag`"]
    assert "`epsilon` (form full)" in groups["Model `Lagrange-averaged`"]
    keys = {f"check.{key}" for key in ("least", "most", "from", "to")}
    assert {*named["Check `crossings`"]} == keys


def test_a_case_is_a_key_and_cannot_be_changed() -> None:
    text = f"{BODY}, {SPAN}, sweep: {{damping.0: {{values: [0, 1]}}}}"
    case, same = one_case(text), one_case(text)
    assert {case: "found"}[same] == "found"
    other = dataclasses.replace(same, data={**same.data, "damping": [1, 2, 3]})
    assert other not in {case}
    assert other.data["damping"] == (1, 2, 3)
    again = pickle.loads(pickle.dumps(case))
    assert (again, hash(again)) == (case, hash(case))
    data: Any = again.data
    for change in (partial(operator.setitem, data, "p", 1), partial(data["initial"].update, p=1)):
        with pytest.raises(TypeError, match="the data of a case do not change"):
            change()
    assert case.system is case.system
    for stored in (case, one_case(f"{BODY}, {SPAN}, attitude: yes")):
        assert pickle.loads(pickle.dumps(stored)).system == stored.system


# Torques of one's own

TORQUES = (
    "model: torques", "inertia: [2, 1.5, 1]", "initial: {p: 0.3, q: 2.5 deg, r: -0.9}",
    "time: {end: 9}",
)  # fmt: skip


def torques(entries: str, **more: str) -> str:
    sections = "".join(f"{name}: {text}\n" for name, text in more.items())
    return f"{sections}cases:\n  a: {{{', '.join(TORQUES)}, {entries}}}\n"


OF_TORQUES = """
error: off -> ...: no torque is named ... damping: 0 is free motion
torqe: [0, 0, 1] -> torqe: unknown key; did you mean 'torque'? ...
torqe: [0, 0, 1], attitude: yes -> torqe: unknown key; did you mean 'torque'? ...
torque: {x: 1} -> torque: expected 3 numbers or expressions in t, or one for all, got a mapping
damping: {law: exponential, value: 0.004, rate: 0.01} -> damping: ...; write "0.004*exp(-0.01*t)"
brake: {law: power, value: 1, rate: 0.1, exponent: -2} -> brake: ...; write "1*(1 + 0.1*t)**-2"
damping: [0.1, [0, 1], 0] -> damping.1: ... in t, got a list of 2; write "1*t"
kappa: [1, -3, 1] -> kappa: expected a number...write "1 - 3...
resistance: {diagonal: [1], off_diagonal: 0} -> resistance.diagonal: expected a...
damping: 0, inertia: [[1e120, 0, 0], [0, 1e120, 0], [0, 0, 1e120]] -> inertia: 1e+120 is out of ...
damping: 0, inertia: [[1e-120, 0, 0], [0, 1e-120, 0], [0, 0, 1e-120]] -> inertia: 1e-120 is out ...
damping: tan(t) -> damping: column 1 of the expression: unknown function 'tan'; write sin(x)/...
brake: 2*p -> brake: column 3 of the expression: unknown name 'p' ...
brake: 0x1F*t -> brake: column 1 of the expression: not a decimal number; ...
brake: z1, attitude: yes -> brake: column 1 of the expression: unknown name 'z1' ...
expression: [w*t, 0, 0] -> expression.0: column 1 of the expression: unknown name 'w'...
expression: [z1, 0, 0] -> expression.0: z1 needs attitude: yes
expression: [1, 2] -> expression: expected 3 expressions in p, q, r, t and constants, got ...
kappa: -0.1 -> kappa: a negative coefficient drives the body: ...
kappa: k - 1, constants: {k: 0.5} -> kappa: a negative coefficient drives the body: ...
quadratic: [1, -1, 1] -> quadratic.1: a negative coefficient drives the body: ...
kappa: 0.1, cavity: {kappa: 0.1} -> cavity: kappa is given...
brake: 1, initial: {p: 0, q: 0, r: 0} -> brake: a body at rest...
brake: 1, time: {end: -1} -> time.end: a motion of a brake runs forward: ...
space_torque: {size: 1, direction: [0, 0, 0]} -> space_torque.direction: ... has a length, ...
expression: [1/t, 0, 0] -> expression.0: has no finite value at the start of the motion
expression: [0, 0, -r/sqrt(r**2)], brake: 0.01 -> expression.2: has no finite value at rest...
brake: log(t - 1) -> brake: has no finite value at the start of the motion
damping: k, constants: {k: x} -> constants.k: expected a finite number, got 'x'
damping: 1, constants: {k: 1} -> constants.k: no expression of the case names it
damping: 1, constants: {y1: 1} -> constants.y1: means something else in an expression
damping: 1, constants: {exp: 1} -> constants.exp: means something else in an expression
damping: 1, constants: {2a: 1} -> constants.2a: the name of a constant is a ...
damping: k, constants: {k: 1}, sweep: {constants.w: {values: [1]}} -> ...no such number: constants.w
kappa: 1, sweep: {cavity.kappa: {values: [0.3]}} -> ...: the case has no such number: cavity.kappa
damping: 1, sweep: {p: {values: [1]}} -> sweep.p: unknown key 'p'; did you mean 'initial.p'? ...
damping: 1, sweep: {initial.p: {values: [1 deg, 2]}} -> ...: expected all values in degrees, or none
damping: 1, sweep: {damping.0: {values: [1 deg]}} -> sweep.damping.0.values.0: ...
damping: 1, initial: {p: 0, q: 0, G: 1}, sweep: {initial.r: {values: [1]}} -> ...G stands for ...
damping: 1, sweep: {initial.p: {values: [1]}}, store: [crosing_time] -> ...mean 'crossing_time'?...
damping: 1, sweep: {initial.p: {values: [1]}}, store: [event_time] -> ...unknown variable 'event...
damping: 1, method: exact, precision: quadruple -> precision: method exact works in double and...
damping: 1, method: DOP853, precision: extended -> precision: method DOP853 works in double...
damping: 1, method: collocation, precision: quadruple -> precision: method collocation works in...
damping: [1, 2, 3], method: exact -> method: method exact needs torques along G...
damping: 1, time: {end: -1}, sweep: {damping.0: {values: [1]}} -> time.end: a sweep runs forward...
"""


@pytest.mark.parametrize(("entries", "right"), rows_of(OF_TORQUES))
def test_a_mistake_in_torques_of_ones_own_is_answered(entries: str, right: str) -> None:
    given = {entry.partition(":")[0] for entry in re.split(r", (?=\w+:)", entries)}
    whole = ", ".join(x for x in TORQUES if x.partition(":")[0] not in given)
    (line,) = mistakes(f"cases:\n  a: {{{whole}, {entries}}}\n")
    assert fits(line, f"x.yaml:2:...: cases.a...{right}")


def test_constants_are_merged_by_name_and_those_of_defaults_may_be_unused() -> None:
    common = "{constants: {k: 0.1, w: 2, v: 3}}"
    text = torques("damping: [k, 0.1*sin(w*t), 0], constants: {w: 5}", defaults=common)
    case = parse(text, "x").cases["a"]
    assert case.data["constants"] == {"k": 0.1, "w": 5.0}
    assert parse_case(dump(case)) == case
    swept = overridden("a.sweep.constants.w.linspace=[1, 2, 3]", text=text)["a"]
    assert swept.sweep == {"constants.w": {"linspace": (1.0, 2.0, 3)}}


@pytest.mark.parametrize("moments", ["[0.3333, 0.1333, 0.4667]", "[1, 2.001, 1]"])
def test_a_body_may_be_rounded_to_its_last_digit(moments: str) -> None:
    text = torques("damping: 0.1").replace("[2, 1.5, 1]", moments)
    assert parse(text, "x").cases["a"].system.warnings[0].startswith("one moment exceeds the sum")
    further = moments.replace("0.4667", "0.4668").replace("2.001", "2.0011")
    (line,) = mistakes(text.replace(moments, further))
    assert "larger than the sum of the other two" in line


def test_a_tensor_that_is_unsymmetric_by_rounding_is_its_symmetric_part() -> None:
    tensor = "[[2, 0.1233, 0], [0.1234, 1.5, 0], [0, 0, 1]]"
    text = torques("damping: 0.1").replace("[2, 1.5, 1]", tensor)
    inertia = parse(text, "x").cases["a"].data["inertia"]
    assert inertia[0][1] == inertia[1][0] == pytest.approx(0.12335)
    (line,) = mistakes(text.replace("0.1234", "0.1235"))
    assert "a tensor of inertia is symmetric" in line


# Hostile case files, HODO_FUZZ (default 60) of each kind: the loader gives a Config or a HodoError,
# with work in proportion to the text.

COUNT = settings(max_examples=int(os.environ.get("HODO_FUZZ", "60")))
SHIPPED = [path.read_text(encoding="utf-8") for path in CONFIGS]
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
SHORT = st.sampled_from(["on", "x", "60 deg", "taylor", "continue"])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | SHORT,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(st.sampled_from("pqrGabxyz"), inner, max_size=4)
    ),
    max_leaves=8,
)


@st.composite
def mutants(draw: st.DrawFn) -> str:
    """A shipped config with some stretches deleted, doubled or replaced."""
    text = draw(st.sampled_from(SHIPPED))
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
    document = deepcopy(sections(draw(st.sampled_from(SHIPPED))))
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
    outcome(SHIPPED[0], (text, "fig4." + text, "*.initial=" + text))
