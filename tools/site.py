"""Build the documents as a site with search and typeset equations, read without a network:
`python tools/site.py OUT CONFIG...`, after `make figures`.

Runs in the environment of `make site`, with Sphinx and MyST. Pictures of each CONFIG are taken from
runs/figures/.
"""

import re
import shutil
import sys
import unicodedata
from pathlib import Path

import yaml
from latex2mathml.converter import convert
from sphinx.cmd.build import main as build

PAGES = {
    "Use": ["docs/case-files", "docs/sweeps", "docs/models", "docs/results", "docs/api"],
    "Trust": ["docs/papers", "docs/claims", "docs/accuracy"],
    "Code": ["docs/architecture", "CONTRIBUTING", "CHANGELOG"],
}
"""The groups of the table of contents; pages on single papers and on figures follow `papers`."""

CONFIGURATION = """\
project = html_title = "hodo"
root_doc = "README"
extensions = ["myst_parser"]
myst_enable_extensions = ["html_image"]
myst_heading_anchors = 3
html_theme = "furo"
html_show_sphinx = html_copy_source = html_show_sourcelink = False
html_static_path = ["static"]
html_css_files = ["equations.css"]
"""

INDEX = '<meta http-equiv="refresh" content="0; url=README.html"><a href="README.html">hodo</a>\n'

EQUATIONS = """\
math[display="block"] { margin: 1em 0; font-size: 1.1em; overflow-x: auto; }
mtd:nth-child(1) { text-align: right; }
mtd:nth-child(2) { text-align: left; }
"""
"""Browsers align the columns of MathML by style sheets alone."""

ACCESSIBLE = {
    'class="caption" role="heading"': 'class="caption" role="heading" aria-level="2"',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="Contents">',
    '<aside class="toc-drawer">': '<aside class="toc-drawer" aria-label="This page">',
    "<pre>": '<pre tabindex="0">',
}
"""What the theme's pages lack for readers without a pointer or a screen, and its replacement."""

GREEK = [
    *("alpha", "beta", "gamma", "Delta", "epsilon", "theta", "kappa", "lambda"),
    *("mu", "nu", "rho", "sigma", "tau", "phi", "psi", "omega"),
]
FUNCTIONS = ["cos", "sin", "ln", "sqrt"]
ROMAN = ["and", "cyclically", "about", "for", "x1", "x3"]
"""What stands in an equation and is no symbol."""

TOKEN = re.compile(
    r"(?P<gap> {2,})|(?P<cross> x )|(?P<word>[A-Za-z]+)(?P<index>_\w|\d+)?"
    r"|\^(?P<power>\w+|\([^)]*\))|(?P<mean><[^<>=]+>)|(?P<sign><=|>=|.)"
)
CODE = re.compile(
    r"(^```.*?^```$|^    [^\n]*$|`[^`]*`|<!--.*?-->|\]\([^)]*\))", re.DOTALL | re.MULTILINE
)
SYMBOL = re.compile(rf"\b({'|'.join(GREEK)})(\d?)\b")
POWER = re.compile(r"\^(-?\d)")
LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SIGNS = {"'": "′", "<=": r"\le ", ">=": r"\ge ", "{": r"\{", "}": r"\}", "*": r"\,", ",": r",\;"}


def main(out: Path, configs: list[Path]) -> int:
    """The exit status of Sphinx, for which a dead link is an error."""
    source = out.with_name("source")
    for folder in (source, out):
        shutil.rmtree(folder, ignore_errors=True)
    for folder in ("docs", "static"):
        (source / folder).mkdir(parents=True)
    (source / "conf.py").write_text(CONFIGURATION, encoding="utf-8")
    (source / "static" / "equations.css").write_text(EQUATIONS, encoding="utf-8")
    shutil.copytree("configs", source / "configs")
    for path in [
        Path("LICENSE"),
        Path("CITATION.cff"),
        *Path().glob("*.md"),
        *Path("docs").iterdir(),
    ]:
        shutil.copy(path, source / path)
        if path.suffix == ".md":
            (source / path).write_text(typeset(path.read_text(encoding="utf-8")), encoding="utf-8")
    papers = [f"docs/{config.stem}" for config in configs]
    galleries = [gallery(config, source) for config in configs]
    with (source / "README.md").open("a", encoding="utf-8") as front:
        for title, pages in PAGES.items():
            entries = "\n".join(pages + papers + galleries if title == "Trust" else pages)
            front.write(f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{entries}\n```\n")
    status = build(["-q", "-W", "--keep-going", "-b", "html", str(source), str(out)])
    for page in out.rglob("*.html"):
        html = page.read_text(encoding="utf-8")
        for lacking, whole in ACCESSIBLE.items():
            html = html.replace(lacking, whole)
        page.write_text(html, encoding="utf-8")
    (out / "index.html").write_text(INDEX, encoding="utf-8")
    return status


def gallery(config: Path, source: Path) -> str:
    """A page of the figures of a config, in its order; returns its name."""
    content = yaml.safe_load(config.read_text(encoding="utf-8"))
    pictures = Path("runs/figures", config.stem)
    shutil.copytree(pictures, source / "figures" / config.stem, dirs_exist_ok=True)
    lines = [f"# Figures: {content['title']}"]
    for name, figure in content["figures"].items():
        picture = f"![{name}](figures/{config.stem}/{name}.png)"
        lines += [f"## {name}", picture, figure.get("caption", "")]
    page = f"figures-{config.stem}"
    (source / f"{page}.md").write_text("\n\n".join(lines) + "\n", encoding="utf-8")
    return page


def typeset(page: str) -> str:
    """The page with each block of equations as MathML, and letters and powers in its prose."""
    page = re.sub(r"^```text\n(.*?)^```$", _mathml, page, flags=re.DOTALL | re.MULTILINE)
    # Every second part is code, a comment or the target of a link, and stays as it is.
    parts = CODE.split(page)
    parts[::2] = [POWER.sub(_raised, SYMBOL.sub(_letter, part)) for part in parts[::2]]
    return "".join(parts)


def _letter(symbol: re.Match[str]) -> str:
    size = "CAPITAL" if symbol[1].istitle() else "SMALL"
    name = symbol[1].replace("lambda", "lamda").upper()
    return unicodedata.lookup(f"GREEK {size} LETTER {name}") + symbol[2].translate(LOWERED)


def _raised(power: re.Match[str]) -> str:
    return power[1].translate(RAISED)


def _mathml(block: re.Match[str]) -> str:
    if "=" not in block[1]:
        return block[0]
    rows = r" \\ ".join(_row(line) for line in block[1].splitlines())
    mathml = convert(rf"\begin{{array}}{{rl}}{rows}\end{{array}}", display="block")
    return f"```{{raw}} html\n{mathml}\n```"


def _row(line: str) -> str:
    """A row of two cells; a line that begins with blanks goes on with the one before it."""
    if line.startswith(" "):
        return r"& \quad " + _tex(line.strip())
    left, equals, right = line.partition("=")
    return f"{_tex(left)} & {equals} {_tex(right)}" if equals else f"& {_tex(line)}"


def _tex(line: str) -> str:
    """A line of plain text, such as `A1 p' = -lambda1 A1 <dn^2>`, in TeX."""
    parts = []
    for token in TOKEN.finditer(line):
        if token["gap"]:
            parts.append(r"\quad " if parts else "")
        elif token["cross"]:
            parts.append(r"\times ")
        elif word := token["word"]:
            index = (token["index"] or "").strip("_")
            parts.append(_word(word) + (f"_{{{index}}}" if index else ""))
        elif token["power"]:
            parts.append(f"^{{{token['power'].strip('()')}}}")
        elif token["mean"]:
            parts.append(rf"\langle {_tex(token['mean'][1:-1])}\rangle ")
        else:
            parts.append(SIGNS.get(token["sign"], token["sign"]))
    return "".join(parts)


def _word(word: str) -> str:
    if word in FUNCTIONS:
        return rf"\{word} "
    if word in ROMAN:
        return rf"\text{{ {word} }}"
    letter = word.removeprefix("d")  # of dtau, dGz
    if letter in GREEK:
        return word.removesuffix(letter) + rf"\{letter} "
    return word


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), [Path(config) for config in sys.argv[2:]]))
