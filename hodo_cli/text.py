"""Plain tables, lists and numbers."""

import json
import math
import re
from collections.abc import Hashable, Iterable, Sequence
from typing import Any, TypeVar

_Kind = TypeVar("_Kind", bound=Hashable)
_Item = TypeVar("_Item")


def table(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    right: Sequence[str] = (),
    optional: Sequence[str] = (),
) -> str:
    """A table with a header and aligned columns. Columns named in `right` are aligned to the right;
    those named in `optional` are left out if all of their cells are empty. Lines have no trailing
    space.

    A character that a terminal would obey is shown as a question mark.
    """
    lines = [header, *([_printable(cell) for cell in row] for row in rows)]
    columns = [
        _aligned((name, *cells), to_right=name in right)
        for name, *cells in zip(*lines, strict=True)
        if any(cells) or name not in optional
    ]
    return "\n".join("  ".join(line).rstrip() for line in zip(*columns, strict=True))


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [[cell.replace("|", "\\|") for cell in row] for row in (header, *rows)]
    first, *others = (f"| {' | '.join(line)} |\n" for line in lines)
    return "".join([first, "|---" * len(header), "|\n", *others])


def _aligned(column: Sequence[str], to_right: bool) -> list[str]:
    width = max(map(len, column))
    return [cell.rjust(width) if to_right else cell.ljust(width) for cell in column]


def _printable(text: str) -> str:
    if text.isprintable():  # nearly every text is, and this test is twenty times as fast
        return text
    return "".join(c if c.isprintable() else "?" for c in text)


def seconds(value: float) -> str:
    """A duration with its unit, to three digits."""
    return with_unit(value, ((1.0, "s"), (1e-3, "ms"), (1e-6, "us")))


def in_bytes(count: int) -> str:
    """A number of bytes with its unit, to three digits."""
    return with_unit(count, ((1e15, "PB"), (1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1, "bytes")))


def with_unit(value: float, units: Sequence[tuple[float, str]]) -> str:
    """A size to three digits in the first unit that is not larger, or in the last one."""
    # By the rounded value: 999.9 us are 1 ms.
    rounded = float(f"{value:.3g}")
    size, unit = next((unit for unit in units if rounded >= unit[0]), units[-1])
    digits = ".0f" if value >= 100 * size else ".3g"
    return f"{value / size:{digits}} {unit}"


def magnitude(value: float) -> str:
    """An error to two digits; a dash where none was measured."""
    if math.isnan(value):
        return "-"
    return "0" if value == 0 else f"{value:.1e}"


def time_digits(time: float, start: float, digits: int = 6) -> int:
    """How many digits show a time to `digits` digits of the time since the start of a motion. The
    first digits of seconds since an epoch are the digits of the start, and say nothing."""
    passed = max(abs(time - start), math.ulp(time))
    in_common = math.ceil(math.log10(max(1.0, abs(time) / passed)))
    return min(digits + in_common, 15)


def time_text(time: float, start: float, digits: int = 6) -> str:
    """A time to `digits` digits of the time since the start of a motion."""
    return f"{time:.{time_digits(time, start, digits)}g}"


def to_error(value: float, error: float, digits: int, unmeasured: int = 6) -> str:
    """A number to the first digit that its error changes, at most `digits`, or to `unmeasured`
    digits if no error was measured."""
    if math.isnan(error):
        digits = unmeasured
    elif 0 < error < math.inf and value:
        right = 1 + math.floor(math.log10(abs(value))) - math.floor(math.log10(error))
        digits = max(1, min(digits, right))
    return f"{value:.{digits}g}"


PLURALS = {"erratum": "errata"}
"""The plurals that do not end with an s."""


def counted(count: int, noun: str) -> str:
    """A number of things in words: 1 case, 2 cases."""
    return f"{count} {noun if count == 1 else PLURALS.get(noun, f'{noun}s')}"


def first_line(error: BaseException) -> str:
    """The first line of a library's error, or its type if it is empty."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def case_words(name: str) -> str:
    """A case as a message names it; a case made in Python without a name is called `case`."""
    return "the case" if name == "case" else f"case {name}"


NAMES_LISTED = 5
"""The most names of cases in a line about all of them."""


def grouped(pairs: Iterable[tuple[_Kind, _Item]]) -> dict[_Kind, list[_Item]]:
    """The items of each kind, from pairs of a kind and an item, in their order."""
    groups: dict[_Kind, list[_Item]] = {}
    for kind, item in pairs:
        groups.setdefault(kind, []).append(item)
    return groups


def abridged(items: Sequence[str], most: int, remark: str = "") -> list[str]:
    """The items; if they are more than `most`, the first ones, the number of the rest, and the
    last one."""
    more = len(items) - most
    return [*items] if more <= 0 else [*items[: most - 1], f"{more} more{remark}", items[-1]]


def few(names: Sequence[str]) -> str:
    """The names of cases in one line; of many cases only some names."""
    return ", ".join(abridged(names, NAMES_LISTED))


DEVICE_NAMES = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
"""Names that Windows keeps for devices, whatever suffix they have."""


def file_name_fault(name: str, others: Iterable[str]) -> str:
    """Why a name cannot name a file on every system, in a folder with files of the names `others`;
    an empty string if it can. Results go from one system to another."""
    twins = [other for other in others if other != name and other.lower() == name.lower()]
    pair = " and ".join([name, *twins[:1]])
    faults = (
        (DEVICE_NAMES.fullmatch(name), f"{name} names a device on Windows: take another name"),
        (name.endswith("."), f"{name} ends with a dot, which Windows leaves out of names of files"),
        (twins, f"{pair} are one file on systems that ignore case: rename one"),
    )
    return next((fault for holds, fault in faults if holds), "")


def as_json(value: Any) -> str:
    """Plain data as JSON, with null for numbers that are not finite."""
    return json.dumps(json.loads(json.dumps(value), parse_constant=lambda word: None))
