"""One page with every figure, statement and number of the results that were drawn into a folder:
HTML that opens from disk and asks no network for anything. It reads datasets and draws nothing."""

import json
from collections.abc import Sequence
from pathlib import Path

from ..cases.figure_block import PAGE_DATA
from ..storage import replacing
from .contents import PageResult, section_of
from .html import page_of, with_pictures_inside
from .stored import stored_sections

__all__ = ["PageResult", "write_alone", "write_page"]


def write_page(path: Path, results: Sequence[PageResult]) -> None:
    """Write the page at `path` anew: the figures just drawn, and those of other configs that were
    drawn into the same folder before.

    Links are relative to the page. Raises HodoError if a file cannot be written.
    """
    folder = path.parent
    for result in results:
        with replacing(folder / result.cases.path.stem / PAGE_DATA) as draft:
            draft.write_text(json.dumps(section_of(result, folder)), encoding="utf-8")
    names = [result.cases.path.stem for result in results]
    with replacing(path) as draft:
        draft.write_text(page_of(stored_sections(folder, names)), encoding="utf-8")


def write_alone(page: Path, path: Path) -> None:
    """Write a page once more as one file, which holds its pictures and leads to no other file.

    Raises HodoError if it cannot be written.
    """
    text = with_pictures_inside(page.read_text(encoding="utf-8"), page.parent)
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")
