"""The data of a page as they lie in its folders. A folder may be a stranger's: whatever it holds is
text, numbers and names of files in the shape that `section_of` writes, or is left out."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..cases.figure_block import PAGE_DATA

Section = dict[str, Any]

STORED_FIGURE = {
    "name": "", "caption": "", "about": "", "problem": "", "files": [""], "size": [0],
    "assumed": [""], "cases": [""],
}  # fmt: skip
CASE = {
    "name": "", "model": "", "method": "", "steps": "", "error": 0.0, "error_kind": "",
    "run_time": 0.0, "parameters": "", "notes": [""], "ends": [""], "crossings": [[""]],
}  # fmt: skip
JUDGED = {
    "name": "", "where": "", "text": "", "original": "", "should_be": "", "verdict": "",
    "evidence": "", "contradicted_by": "", "notes": [""], "cases": [""],
}  # fmt: skip
SECTION = {
    "name": "", "title": "", "references": "", "file": "", "paper": False,
    "figures": [STORED_FIGURE], "statements": [JUDGED], "errata": [JUDGED], "cases": [CASE],
}  # fmt: skip
"""The shape of a section: the types of its values, by an example."""


def stored_sections(folder: Path, first: Sequence[str]) -> list[Section]:
    """The sections of a page: those of papers first, then those of the names given, in their order,
    then all others by name; equal titles are told apart by the names of the results."""
    ranks = {name: rank for rank, name in enumerate(first)}
    sections = sorted(
        readable_sections(folder),
        key=lambda section: (not section["paper"], ranks.get(section["name"], len(ranks))),
    )
    titles = Counter(section["title"] for section in sections)
    for section in sections:
        if titles[section["title"]] > 1:  # of a result, and of another that it was merged into
            section["title"] += f" ({section['name']})"
    return sections


def readable_sections(folder: Path) -> Iterator[Section]:
    """The sections of a folder's results by name; one that is damaged is drawn anew some time."""
    for file in sorted(folder.glob(f"*/{PAGE_DATA}")):
        with suppress(ValueError, TypeError, KeyError, AttributeError, RecursionError):
            yield in_shape(json.loads(file.read_text(encoding="utf-8")), SECTION)


def in_shape(value: Any, shape: Any) -> Any:
    """A value with the keys and types of an example; all else is left out.

    Raises ValueError, TypeError, KeyError or AttributeError if it lacks any.
    """
    if isinstance(shape, dict):
        return {key: in_shape(value[key], part) for key, part in shape.items()}
    if isinstance(shape, list):
        return [in_shape(item, shape[0]) for item in value]
    return type(shape)(value)
