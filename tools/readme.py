"""Put a table from stdin into README.md, between `<!-- begin: NAME -->` and `<!-- end: NAME
-->`."""

import re
import sys
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def block(name: str) -> re.Pattern[str]:
    """The part of README between a name's markers, as group 2."""
    return re.compile(
        rf"(<!-- begin: {re.escape(name)} -->\n)(.*?)(<!-- end: {re.escape(name)} -->)", re.DOTALL
    )


def main(name: str) -> None:
    """Replace the block, which must exist, by what stdin holds."""
    table = sys.stdin.read().strip()
    text = README.read_text(encoding="utf-8")
    if not table or not block(name).search(text):
        sys.exit(f"nothing on stdin, or no markers for {name!r} in {README}")
    README.write_text(
        block(name).sub(lambda found: f"{found[1]}\n{table}\n\n{found[3]}", text), encoding="utf-8"
    )


if __name__ == "__main__":
    main(sys.argv[1])
