"""Print what a result says about its paper, in Markdown: `python tools/papers.py runs/paper1.h5`.

The verdicts must be stored (`hodo claims`). Statements, errata and readings come from the result
itself; the head of each page in docs/ is written by hand.
"""

import re
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hodo_cli.cases.claim_block import (
    AS_PRINTED,
    CONTRADICTED,
    MISPRINTS,
    ONCE_CORRECTED,
    THEOREM,
    UNDERDETERMINED,
    VERDICTS,
)
from hodo_cli.cases.config import Config, parse
from hodo_cli.commands.claims import totals
from hodo_cli.storage.hdf5 import ResultFile, open_run

WIDTH = 120
"""Characters of a line of the source, so that a change shows as a change of few lines."""

LONGEST = 700
"""Characters of evidence that an entry holds; `hodo claims` prints all of it."""

OURS = "not in the paper"
"""How the place of a statement begins that is not the paper's."""

NOT_SIMPLY = (CONTRADICTED, AS_PRINTED, ONCE_CORRECTED, UNDERDETERMINED)
"""The verdicts on statements that do not simply hold, in the order in which they are told."""

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "epsilon": "ε", "theta": "θ", "kappa": "κ",
    "lambda": "λ", "mu": "μ", "nu": "ν", "rho": "ρ", "tau": "τ", "chi": "χ", "omega": "ω",
}  # fmt: skip

SIGNS = {"^2": "²", "^3": "³", "<=": "≤", ">=": "≥"}
"""Powers and signs as they are set."""

SPOKEN = {
    "separatrix_distance": "|D|/G^2",
    "x1_direction": "|G1|/|G|",
    "first_crossing": "first crossing",
    "visible_turns_x1": "turns about x1",
    "visible_turns_x3": "turns about x3",
    "area_largest": "area in A",
    "speed =": "|omega| =",
    "area_smallest": "area in B",
    "growth_smallest": "rate of growth",
    "end_of_spin": "end of spin",
    "damping.0": "lambda1",
    "damping.1": "lambda2",
    "damping.2": "lambda3",
    "initial.G": "|G(0)|",
    "a.0": "a0",
    "b.0": "b0",
    "resistance.0.0": "I_11",
    "resistance.0.2": "I_13",
    "resistance.2.0": "I_31",
    "resistance.2.2": "I_33",
    "resistance.diagonal": "I_ii",
    "resistance.off_diagonal": "I_ij",
}
"""The words of a paper for the names that stand in the evidence."""


def spoken(text: str) -> str:
    """Text as a paper has it: with its own names, Greek letters, indices and powers."""
    for name, words in SPOKEN.items():
        text = re.sub(rf"(?<![\w.]){re.escape(name)}(?![\w.])", words, text)
    letters = "|".join(GREEK)
    text = re.sub(rf"(?<![A-Za-z])({letters})(?![a-z])", lambda m: GREEK[m[1]], text)
    # Of a formula; t* is a time.
    text = re.sub(r"(?<=\S)\*(?=\S)", " ", text.replace("**", "^"))
    for printed, sign in SIGNS.items():
        text = text.replace(printed, sign)
    text = re.sub(r"sqrt\((\w+)\)", r"√\1", text).replace("sqrt(", "√(")
    text = re.sub(r"(?<=\d)%", " %", text)
    text = re.sub(r"(?<![\w.])(\d[\d.]*)e([+-]\d+)", power_of_ten, text)
    # Indices: x1, 2TA2, r_0, I_ij; ui and λi stand so in quotations.
    text = re.sub(r"(?<![A-Za-z])(T?[A-Za-zλω])([0-3])(?![A-Za-z0-9]|\.\d)", lowered, text)
    text = re.sub(r"([A-Za-zλω])_([ij0-3]+)", lowered, text)
    return re.sub(r"(?<![A-Za-z])([λu])(i)(?!\w)", lowered, text)


LOWERED = str.maketrans("0123ij", "₀₁₂₃ᵢⱼ")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
"""Indices and exponents as they are set."""


def lowered(match: re.Match[str]) -> str:
    """A letter with its index."""
    return match[1] + match[2].translate(LOWERED)


def power_of_ten(match: re.Match[str]) -> str:
    """A number such as 1.2e-15 with a power of ten."""
    factor = "" if match[1] == "1" else f"{match[1]}·"
    return f"{factor}10{str(int(match[2])).translate(RAISED)}"


def plain(text: str) -> str:
    """`spoken` text on one line, with no character that Markdown obeys."""
    text = spoken(text)
    for mark in "\\*_<[":
        text = text.replace(mark, f"\\{mark}")
    return " ".join(text.split())


def shortened(text: str) -> str:
    """`plain` text, cut where it is long."""
    return plain(text if len(text) <= LONGEST else f"{text[:LONGEST].rsplit(' ', 1)[0]} ...")


def sentence(text: str) -> str:
    """A remark that stands by itself: it begins with a capital, unless its first word is a letter
    of a formula, and ends with a stop."""
    text = spoken(text.rstrip("."))
    if not text:
        return ""
    is_word = text[1:2].isalpha() or text.startswith("a ")
    return f"{text[:1].upper() + text[1:] if is_word else text}."


def item(parts: Iterable[str]) -> str:
    """An item of a list, of sentences, in lines of WIDTH."""
    lines = textwrap.wrap(
        " ".join(filter(None, parts)),
        WIDTH - 2,
        break_long_words=False,
        break_on_hyphens=False,
    )
    # A sign, or a number with a stop, at the start of a line would begin a list of its own.
    lines = [lines[0], *(re.sub(r"^(\d*)([-+#>.)])(?= |$)", r"\1\\\2", x) for x in lines[1:])]
    return "- " + "\n  ".join(lines)


def stored(run: ResultFile, name: str) -> list[dict[str, Any]]:
    """The rows of `_claims` or `_errata`."""
    if name not in run:
        sys.exit(f"{run.path} holds no verdicts: run `hodo claims` first")
    variables = run.read(name).variables
    columns = {key: variable.data.tolist() for key, variable in variables.items()}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def place(row: Mapping[str, Any]) -> str:
    """Where in the paper an entry stands."""
    return f"**{plain(sentence(row['where']))}**"


def saying(row: Mapping[str, Any]) -> Iterator[str]:
    """Where a statement stands, the statement, and the paper's own words."""
    yield place(row)
    yield plain(row["statement"])
    if row["original"]:
        yield f"*{plain(row['original'])}*"


def deciding(row: Mapping[str, Any]) -> Iterator[str]:
    """The verdict with what decides it, what would contradict it, and the remarks."""
    yield f"**{row['verdict'].capitalize()}**: {shortened(row['evidence'])}."
    if row["verdict"] not in NOT_SIMPLY:
        yield f"Contradicted by {shortened(row['contradicted_by'])}."
    yield from remarks(row)


def remarks(row: Mapping[str, Any]) -> Iterator[str]:
    """What is measured, where that is not what is said, and the remark on a statement."""
    if row["measured"]:
        yield f"Measured: {plain(row['measured'])}."
    yield plain(sentence(row["note"]))


def statement(row: Mapping[str, Any]) -> str:
    """A statement with what decides it, unless another section tells it."""
    if row["verdict"] in NOT_SIMPLY:
        return item([*saying(row), f"**{row['verdict'].capitalize()}**, see above."])
    return item([*saying(row), *deciding(row)])


def theorem(row: Mapping[str, Any]) -> str:
    """A statement that holds by theorem, with the reason and the motions that tried it."""
    why, tried = plain(sentence(row["theorem"])), shortened(row["evidence"])
    return item([*saying(row), f"**{sentence(THEOREM)}**", why, f"Tried: {tried}.", *remarks(row)])


def misprint(row: Mapping[str, Any]) -> str:
    """A misprint with what shows it."""
    parts = [place(row), f"Printed: {plain(row['printed'])}."]
    parts.append(f"Should be: {plain(row['should_be'])}.")
    # What is confirmed is contradicted as printed and reproduced once corrected.
    evidence = re.sub(
        r"as printed: contradicted \((.*)\); corrected: reproduced \((.*)\)$",
        r"as printed, \1; corrected, \2",
        row["evidence"],
    )
    shown = f": {plain(evidence)}" if evidence else ""
    parts.append(f"**{row['verdict'].capitalize()}**{shown}.")
    if row["contradicted_by"]:
        parts.append(f"Refuted by {plain(row['contradicted_by'])}.")
    return item([*parts, plain(sentence(row["note"]))])


def shown(config: Config) -> list[str]:
    """The cases that figures show, each once."""
    names = [name for figure in config.figures.values() for name in figure.get("cases", ())]
    return list(dict.fromkeys(names))


def numbered(names: Iterable[str]) -> str:
    """The figures and cases of the paper that cases are made for, by their numbers."""
    parts = []
    for stem, words in (("fig", "Fig"), ("case", "case")):
        matches = (re.match(rf"{stem}(\d+)", name) for name in names)
        if numbers := sorted({int(match[1]) for match in matches if match}):
            plural = "s" if len(numbers) > 1 else ""
            parts.append(f"{words}{plural} {', '.join(map(str, numbers))}")
    return "; ".join(parts)


def assumptions(config: Config) -> Iterator[str]:
    """What the cases of the figures take that the paper does not print, by what it is."""
    cases: dict[str, dict[str, list[str]]] = {}
    for name in shown(config):
        for key, text in config.cases[name].assumes.items():
            cases.setdefault(key, {}).setdefault(text, []).append(name)
    for key, names_by_text in cases.items():
        figures = {text: numbered(names) for text, names in names_by_text.items()}
        words = [f"{plain(text)} ({numbers})" for text, numbers in figures.items() if numbers]
        if words:
            choices = (textwrap.indent(item([choice]), "  ") for choice in words)
            yield "\n".join([f"- **{plain(sentence(key)).rstrip('.')}**", *choices])


def section(heading: str, items: Iterable[str]) -> str:
    """A list under a heading; nothing where it is empty."""
    lines = "\n".join(items)
    return f"## {heading}\n\n{lines}" if lines else ""


def summary(run: ResultFile, config: Config, claims: Sequence[Any], errata: Sequence[Any]) -> str:
    """How many statements, errata, figures and motions there are, in one paragraph."""
    names = shown(config)
    errors = [run.row(name, {"error": float})["error"] for name in names]
    largest = max((error for error in errors if error == error), default=float("nan"))
    counts = re.sub(r"(?<!\b1) holds by", " hold by", totals("statement", claims, VERDICTS))
    words = (
        f"{counts}. {totals('erratum', errata, MISPRINTS)}. "
        f"{len(config.figures)} figures are drawn from {len(names)} motions, whose measured errors "
        f"are at most {largest:.1g}."
    )
    return textwrap.fill(plain(words), WIDTH, break_on_hyphens=False)


def page(run: ResultFile) -> str:
    """All that a result says about its paper."""
    config = parse(run.text, str(run.path), stored=True)
    errata, rows = stored(run, "_errata"), stored(run, "_claims")
    claims = [row for row in rows if not row["where"].startswith(OURS)]
    not_simply = [row for verdict in NOT_SIMPLY for row in claims if row["verdict"] == verdict]
    proved = [row for row in claims if row["verdict"] == THEOREM]
    others = [row for row in claims if row["verdict"] != THEOREM]
    failing = (item([*saying(row), *deciding(row)]) for row in not_simply)
    parts = [
        summary(run, config, claims, errata),
        section("Errata", map(misprint, errata)),
        section("What the text leaves open, and what is taken here", assumptions(config)),
        section("What does not simply hold", failing),
        section("Every statement", map(statement, others)),
        section("What holds by theorem", map(theorem, proved)),
        section("Not in the paper", (theorem(row) for row in rows if row not in claims)),
    ]
    return "\n\n".join(filter(None, parts))


if __name__ == "__main__":
    with open_run(Path(sys.argv[1])) as result:
        print(page(result))
