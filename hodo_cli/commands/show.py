"""`hodo show`: the cases in result files, and how they were computed, in words for a paper."""

import math
import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from sys import float_info
from textwrap import fill
from typing import Any

import numpy as np

from .. import HodoError
from ..cases.case import Case, parse_axes, parse_case
from ..cases.keys import keys_of
from ..cases.sweep_block import Axis, axes_of, with_number
from ..quantities import angle_turned
from ..results.layout import MODEL_SOURCE, SUMMARY, typed_as, units_of_case
from ..results.resume import result_named, results_named, warn_of_changes
from ..storage import Group, ResultFile, folder_of, open_batch
from ..text import counted, few, grouped, in_bytes, magnitude, seconds, table


def stored_cases(paths: Iterable[Path], with_data: bool = False) -> list[dict[str, Any]]:
    """The cases of result files, with the attributes that a line of the table shows; `with_data`
    adds the settings of each case that determine its motion.

    A path may name a result or its config. Raises HodoError as `open_batch` does, or if a case
    lacks such attributes.
    """
    rows: list[dict[str, Any]] = []
    for path, config in results_named(paths):
        with open_batch(path) as run:
            warn_of_changes(run, config)
            warn_of_chunks(path)
            for name in run.cases():
                row = run.row(name, SUMMARY | typed_as("case"))
                text = row.pop("case")
                more = {"assumes": assumes_of(text)}
                more |= {"data": data_in_words(parse_case(text))} if with_data else {}
                rows.append({"run": str(path), "case": name, **row, **more})
    return rows


def assumes_of(text: str) -> str:
    """The values that a stored case assumes because its source does not print them, in one line."""
    if "\nassumes:" not in text:  # most cases assume nothing, and need not be parsed
        return ""
    try:
        return "; ".join(f"{name}: {value}" for name, value in parse_case(text).assumes.items())
    except HodoError:  # its model is in a file that --models does not name
        return ""


def warn_of_chunks(path: Path) -> None:
    """Warn of unfinished chunks of sweeps next to a result."""
    if chunks := [*folder_of(path).glob("chunk-*")]:
        size = in_bytes(sum(chunk.stat().st_size for chunk in chunks if chunk.exists()))
        warnings.warn(
            f"{path}: {counted(len(chunks), 'chunk')} of unfinished sweeps, {size}, lie beside it: "
            "hodo run goes on with them, and --prune removes those that it does not need",
            stacklevel=2,
        )


METHODS_IN_WORDS = {
    "exact": "in closed form",
    "quadrature": "averaged over the turns of the free motion to first order, by quadrature",
    "taylor": "by Taylor series of adaptive order and step (heyoka {heyoka}; Biscani and Izzo, "
    "MNRAS 504, 2614, 2021)",
    "collocation": "by collocation (Radau IIA, 16 stages)",
    **dict.fromkeys(
        ("DOP853", "RK45", "LSODA", "Radau", "BDF"),
        "by {method} (SciPy {scipy}; Virtanen et al., Nature Methods 17, 261, 2020)",
    ),
}

REFERENCES_IN_WORDS = {
    "extended": "a second integration in extended precision",
    "quadruple": "a second integration in quadruple precision",
    "exact": "the closed form in extended precision",
    "quadrature": "the same quadrature with more nodes in extended precision, without the error of "
    "averaging itself, which is of first order",
    "refined": "a second integration at another tolerance",
}
"""The references of measured errors in words, by `error_kind`."""


def methods_of(path: Path) -> dict[str, str]:
    """How the cases of a result were computed, as a paragraph for a paper: versions, methods,
    tolerances, measured errors, models of the author's own, and what to cite. The path may name a
    result or its config.

    Raises HodoError as `open_batch` does, or if no case of the result ended well.
    """
    path, _ = result_named(path)
    with open_batch(path) as run:
        rows = [row_of_methods(run, name) for name in run.cases()]
        own_models = ", ".join(dict.fromkeys(row["model"] for row in rows if row["is_own_model"]))
        ended_well = [row for row in rows if row["status"] == "ok"]
        if not ended_well:
            raise HodoError(f"{path} holds no case that ended well")
        others = [row["case"] for row in rows if row["status"] != "ok"]
        cited = filter(None, (f"{run.attributes.get('source')}", run.attributes.get("references")))
        sentences = (
            sentence_on_methods(run, ended_well),
            *(f"Sweep {x['case']}: {', '.join(x['swept'])}." for x in ended_well if x["swept"]),
            sentence_on_errors(ended_well),
            f"The equations of {own_models} are our own; the result holds their text."
            if own_models
            else "",
            f"Left out, since they did not end well: {few(others)}." if others else "",
            f"All computations used Python {stored_version(run, 'python')} "
            f"and NumPy {stored_version(run, 'numpy')}.",
            f"To be cited: {'; '.join(map(str.strip, cited))}.",
        )
    return {"run": str(path), "methods": " ".join(filter(None, sentences))}


def row_of_methods(run: ResultFile, name: str) -> dict[str, Any]:
    """What the paragraph says of a case. A sweep counts as one motion for each member; the errors
    of a sample of them are measured. The error of an attitude is an angle, `off`."""
    row = {"off": math.nan, "turned": math.nan} | run.row(
        name, SUMMARY | typed_as("tol", "error_kind", "case")
    )
    more = run.summary(name, ("members", "error_sample", MODEL_SOURCE))
    motions = int(more.get("members", 1))
    axes = parse_axes(row["case"]) if "members" in more else []
    if "\nattitude:" in row.pop("case") and "members" not in more:
        row |= errors_of_attitude(run.read(name))
    return {
        "case": name,
        **row,
        "swept": [f"{'.'.join(map(str, path))} {words}" for path, words in ranges_in_words(axes)],
        "motions": motions,
        "motions_measured": int(more.get("error_sample", motions)),
        "is_own_model": MODEL_SOURCE in more,
    }


def errors_of_attitude(group: Group) -> dict[str, float]:
    """The error of a stored motion without its attitude, the angle `off` by which the attitude is
    wrong, and the angle `turned`; empty if these errors or omega are not stored."""
    errors = {name: float(x.attrs.get("error", math.nan)) for name, x in group.variables.items()}
    off, measured = errors.pop("attitude", math.nan), [x for x in errors.values() if x >= 0]
    if math.isnan(off) or not measured or "omega" not in group.variables:
        return {}
    time, omega = (group.variables[name].data for name in ("time", "omega"))
    return {"error": max(measured), "off": off, "turned": angle_turned(time, omega)}


def methods_paragraphs(rows: Iterable[Mapping[str, str]]) -> str:
    """The paragraphs of results, in lines of 100 characters."""
    return "\n\n".join(fill(row["methods"], 100, break_on_hyphens=False) for row in rows)


def stored_version(run: ResultFile, library: str) -> str:
    """The version of a library with which a result was made."""
    return str(run.attributes.get(f"{library}_version", "of unknown version"))


def sentence_on_methods(run: ResultFile, rows: Sequence[Mapping[str, Any]]) -> str:
    """The sentence on methods and tolerances, with the number of motions of each."""
    libraries = {name: stored_version(run, name) for name in ("heyoka", "scipy")}
    methods = Counter[tuple[str, float]]()
    for row in rows:
        methods[row["method"], row["tol"]] += row["motions"]
    phrases = []
    for (method, tol), count in methods.items():
        words = METHODS_IN_WORDS.get(method, "by {method}").format(method=method, **libraries)
        tolerance = (
            "" if method in ("exact", "quadrature") else f" at a relative tolerance of {tol:.2g}"
        )
        # The bound is on the omitted terms of a Taylor series; the numbers themselves have 2.2e-16.
        finer = ", below the rounding of double precision" if tol < float_info.epsilon else ""
        phrases.append(f"{count} {words}{tolerance}{finer if tolerance else ''}")
    models = ", ".join(dict.fromkeys(f"{row['model']} ({row['form']})" for row in rows))
    commit = str(run.attributes.get("git_commit", ""))[:10]
    program = f"{run.attributes.get('source', 'hodo')}{f' (commit {commit})' if commit else ''}"
    total = methods.total()
    subject, verb = (f"{total} motions", "were") if total > 1 else ("1 motion", "was")
    return f"With {program}, {subject} of {models} {verb} computed: {'; '.join(phrases)}."


def sentence_on_errors(rows: Sequence[Mapping[str, Any]]) -> str:
    """The sentence on measured errors, by their references; a sweep has errors of a sample of its
    members."""
    phrases, kinds = [], grouped((row["error_kind"], row) for row in rows)
    for kind, of_kind in kinds.items():
        worst = max(of_kind, key=itemgetter("error"))
        motions, sample = (sum(row[x] for row in of_kind) for x in ("motions", "motions_measured"))
        of_them = f", for {motions} of them" if len(kinds) > 1 else ""
        chosen = f", for a sample of {sample} of {motions}" if sample < motions else of_them
        phrases.append(
            f"at most {magnitude(worst['error'])} ({worst['case']}) "
            f"against {REFERENCES_IN_WORDS[kind]}{chosen}"
            if kind in REFERENCES_IN_WORDS
            else f"not measured in {motions} of them"
        )
    posed = max(rows, key=lambda row: float(np.nan_to_num(row["off"], nan=-1)))
    if posed["off"] >= 0:
        turned = f"{posed['case']}, which turns by {posed['turned']:.3g} rad"
        phrases.append(f"attitudes are off by at most {magnitude(posed['off'])} rad ({turned})")
    return f"The relative errors of the stored variables are {'; '.join(phrases)}."


def latex_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table of cases for a paper, in LaTeX, by the rules of the package booktabs."""
    header = ("case", "model", "data", "method", "error")
    lines = [
        (row["case"], f"{row['model']} ({row['form']})", row["data"], row["method"],
         magnitude(row["error"]))
        for row in rows
    ]  # fmt: skip
    head, *body = (" & ".join(map(latex, line)) + r" \\" for line in (header, *lines))
    begin, end = r"\begin{tabular}{llp{0.5\textwidth}ll}", r"\end{tabular}"
    return "\n".join([begin, r"\toprule", head, r"\midrule", *body, r"\bottomrule", end])


def ranges_in_words(axes: Iterable[Axis]) -> Iterator[tuple[Sequence[Any], str]]:
    """The paths of the keys that a sweep varies, with their ranges."""
    for axis in axes:
        if axis.sphere:
            yield ("initial", "direction"), f"{len(axis)} at random"
        for path, value_range in axis.ranges:
            ((word, span),) = value_range.items()
            ends = span if word == "values" else span[:2]
            yield path, f"{min(ends):g} to {max(ends):g} in {len(axis)} values"


def data_in_words(case: Case) -> str:
    """The data of a case in a line, with units and without defaults of its model; for a key that a
    sweep varies its range."""
    data, axes = dict(case.data), axes_of(case.sweep or {})
    if any(axis.sphere for axis in axes):  # |G| stays
        body: Any = case.system
        G = body.momentum(body.from_principal(np.array(body.start[:3])))
        data["initial"] = {**dict.fromkeys(data["initial"]), "G": math.hypot(*G), "direction": None}
    for path, words in ranges_in_words(axes):
        data = with_number(data, path, words)
    _, rules = keys_of(case.model, case.form)
    given = {key: x for key, x in data.items() if x != rules[key].get("default")}
    span = f"{case.time.start:g} to {case.time.end:g} [{case.time.unit}]".removesuffix(" [1]")
    return f"{in_words(given, case)}, t = {span}"


def in_words(value: Any, case: Case, key: str = "") -> str:
    """The value of a key in a line, with its units where the case gives them: lists in parentheses,
    and mappings as `key = value`."""
    from ..sweeps.sweep import stated_unit  # late: every run prints a table, and few have sweeps

    if isinstance(value, Mapping):
        inner = ((k, in_words(x, case, f"{key}.{k}")) for k, x in value.items() if x is not None)
        return ", ".join(f"{k} {x}" if "=" in x else f"{k} = {x}" for k, x in inner if x)
    words = f"{value:g}" if isinstance(value, float) else str(value).removesuffix(".0")
    if isinstance(value, tuple):
        words = f"({', '.join(in_words(x, case) for x in value)})"
    stated = stated_unit(case, key.removeprefix("."))
    is_open = {"mass", "length"} | ({"inertia"} if case.inertia_unit == "1" else set())
    unit = "1" if any(word in stated for word in is_open) else units_of_case(stated, case)
    return words if unit == "1" else f"{words} [{unit}]"


def latex(text: str) -> str:
    """A text in LaTeX, with its signs escaped, and numbers with powers of ten."""
    escaped = re.sub(r"([&%$#_{}])", r"\\\1", text)
    escaped = re.sub(r"\^(-?\d+)", r"$^{\1}$", escaped)
    return re.sub(r"(\d)e\+?(-?)0*(\d+)\b", r"\1$\\times10^{\2\3}$", escaped)


def case_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The cases with their method, cost, error and warnings; below them, once each, warnings that
    several cases share and, where it is known, what cases assume."""
    header = ("case", "model", "form", "method", "steps", "run time", "error", "warnings")
    names = grouped(
        (text, row["case"])
        for row in rows
        for text in [*remarks(row), f"assumes {row['assumes']}" if row.get("assumes") else ""]
        if text
    )
    lines = [
        [
            row["case"],
            row["model"],
            row["form"],
            row["method"],
            str(row["steps"]),
            seconds(row["run_time"]),
            magnitude(row["error"]),
            "; ".join(text for text in remarks(row) if len(names[text]) == 1),
        ]
        for row in rows
    ]
    shared = [
        f"{few(cases)}: {text}"
        for text, cases in names.items()
        if len(cases) > 1 or text.startswith("assumes ")
    ]
    return "\n".join([table(header, lines, right=("steps", "run time", "error")), *shared])


def remarks(row: Mapping[str, Any]) -> list[str]:
    """How a case ended, unless it ended well at its end time, and its warnings."""
    ended = row["message"] if row["status"] == "ok" else f"{row['status']}: {row['message']}"
    return [*filter(None, [ended]), *row["warnings"].splitlines()]
