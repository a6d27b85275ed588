"""Set documents in Markdown as one PDF: `python tools/print_papers.py OUT.pdf PAGE...`.

Runs in the environment of `make papers`, with pandoc and typst.
"""

import re
import sys
import tempfile
from pathlib import Path

import pypandoc
import typst

PREAMBLE = """\
#set page(paper: "a4", margin: 22mm, numbering: "1")
#set text(font: ("Libertinus Serif", "New Computer Modern"), size: 10pt)
#set par(justify: true)
#show heading.where(level: 1): it => { pagebreak(weak: true); it }
#show heading: set block(above: 1.4em, below: 0.8em)
#let horizontalrule = line(length: 100%)
"""
"""A4, with a new page for each document."""


def main(out: Path, pages: list[Path]) -> None:
    """Write the PDF; pictures are found beside the pages."""
    texts = {page.name: page.read_text(encoding="utf-8") for page in pages}
    text = "\n\n".join(texts.values())
    # A link to a page, or to a heading of one, leads to that place of the PDF.
    for name, words in texts.items():
        title = words.partition("\n")[0].lstrip("# ").lower()
        anchor = re.sub(r"[^\w -]", "", title).replace(" ", "-")
        text = text.replace(f"]({name})", f"](#{anchor})").replace(f"]({name}#", "](#")
    # A bar holds what it encloses together: a line may end before |G|, and not within it.
    text = text.replace("|", "\u2060|\u2060")
    body = pypandoc.convert_text(text, "typst", "gfm", extra_args=["--wrap=none"])
    out.parent.mkdir(parents=True, exist_ok=True)
    # Typst reads no file outside its root, which is that of the pictures.
    with tempfile.NamedTemporaryFile("w", suffix=".typ", dir=pages[0].parent) as source:
        source.write(PREAMBLE + body)
        source.flush()
        typst.compile(source.name, output=str(out))


if __name__ == "__main__":
    main(Path(sys.argv[1]), [Path(page) for page in sys.argv[2:]])
