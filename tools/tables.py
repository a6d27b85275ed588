"""Put text from stdin into a document, between `<!-- begin: NAME -->` and `<!-- end: NAME -->`.

Run as `python tools/tables.py FILE NAME` by the targets that renew what documents quote from the
program.
"""

import re
import sys
from pathlib import Path


def block(name: str) -> re.Pattern[str]:
    """The text between a name's markers, as group 2."""
    return re.compile(
        rf"(<!-- begin: {re.escape(name)} -->\n)(.*?)(<!-- end: {re.escape(name)} -->)", re.DOTALL
    )


def main(document: Path, name: str) -> None:
    """Replace the block, which must exist, by what stdin holds."""
    new, text = sys.stdin.read().strip(), document.read_text(encoding="utf-8")
    if not new or not block(name).search(text):
        sys.exit(f"nothing on stdin, or no markers for {name!r} in {document}")
    # A function, because a replacement in text form would take the backslashes of TeX as escapes.
    renewed = block(name).sub(lambda match: f"{match[1]}\n{new}\n\n{match[3]}", text)
    document.write_text(renewed, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
