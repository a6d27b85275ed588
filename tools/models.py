"""Print docs/models.md's account of the models: each form's docstring, with its formulas in TeX."""

import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from itertools import chain

from hodo_cli import models
from hodo_cli.models.base import Model

GREEK = ("Delta", "delta", "epsilon", "gamma", "kappa", "lambda", "mu", "nu", "omega", "phi", "rho")
COMMANDS = {name: f"\\{name}" for name in (*GREEK, "tau", "theta", "pi", "cos", "ln", "sin")}
COMMANDS |= {name: rf"\mathrm{{{name}}}" for name in ("cn", "dn", "sn")}
NAMES = "|".join([*COMMANDS, "abc", "[A-Za-z]"])
# The d of a differential, a name, and its index; "do" is a word.
SYMBOL = re.compile(rf"(?<![A-Za-z])(d(?!n|o\b))?({NAMES})(?:_([a-z]+)|(\d+|(?<=G)z))?(?![A-Za-z])")
WORDS = re.compile(r"[aAI]|[A-Z]\.|V?[\d.,;:()/+* -]+")
"""What may be read as a formula and is none: an article, an initial, a number."""

# Signs without letters come first, so that no command is read as a symbol.
BEFORE = {
    r"\{": "⦃",
    r"\}": "⦄",
    r"\b(omega|gamma|A\)) x (?=\w)": r"\1 × ",
    r"sqrt\(((?:[^()]|\([^()]*\))*)\)": r"√{\1}",
    r"<([^<>= ](?:[^<>=]*[^<>= ])?)>": r"⟨\1⟩",
    r"\^(-\w+|\w\w+|-\|\w+\|)": r"^{\1}",
}
AFTER = {"×": r"\times ", "√": r"\sqrt", "⟨": r"\langle ", "⟩": r"\rangle ", "*": r"\cdot "}
AFTER |= {"⦃": r"\lbrace ", "⦄": r"\rbrace "}
AFTER |= {"<=": r"\le ", ">=": r"\ge ", "!=": r"\ne ", "<": r"\lt ", ">": r"\gt ", "~": r"\sim "}


def tex(formula: str) -> str:
    """A formula of a docstring in TeX."""
    for pattern, replacement in BEFORE.items():
        formula = re.sub(pattern, replacement, formula)
    formula = SYMBOL.sub(_symbol, formula)
    for sign, command in AFTER.items():
        formula = formula.replace(sign, command)
    return re.sub(r" +(?=[ ,)|^']|/(?! )|$)", "", formula)


def _symbol(match: re.Match[str]) -> str:
    """A symbol with its index, and with the d of a differential."""
    differential, name, letters, digits = match.groups()
    index = braced("_", letters or digits or "")
    # A command ends at a blank.
    return (differential or "") + COMMANDS.get(name, name) + index + " " * (name in COMMANDS)


def braced(sign: str, script: str) -> str:
    """An index or a power, in braces where it has several characters."""
    return sign + (script if len(script) == 1 else f"{{{script}}}") if script else ""


def is_formula(word: str) -> bool:
    """Whether a word is made of symbols, numbers and signs, and no number of an equation."""
    if re.fullmatch(r"\([\d.]+\)\W?", word):
        return False
    return not re.search("[A-Za-z`]", SYMBOL.sub("", word.replace("sqrt(", "(")))


def parts(text: str) -> Iterator[tuple[bool, str]]:
    """Formulas and words in turn; a formula ends at a comma that no parenthesis holds."""
    formula = ""
    for word in re.findall(r"`[^`]*`\S*|\S+", text):
        if is_formula(word):
            formula = f"{formula} {word}".lstrip()
            is_open = formula.count("(") > formula.count(")")
            if is_open or not word.endswith((",", ";", ":", ".")):
                continue
            word = ""
        if formula:
            yield True, formula
        if word:
            yield False, word
        formula = ""
    if formula:
        yield True, formula


def inline(formula: str) -> str:
    """A formula within a sentence, its stop outside; an article or a number remains a word."""
    if WORDS.fullmatch(formula):
        return formula
    whole = re.fullmatch(r"(\(?)(.*?)(\)?[,;:.]?)", formula)
    opening, inner, closing = whole.groups() if whole else ("", formula, "")
    if inner.count("(") != inner.count(")"):
        opening, inner, closing = "", *re.fullmatch(r"(.*?)([,;:.]?)", formula).groups()
    return f"{opening}${tex(inner)}${closing}"


def sentence(text: str) -> str:
    """A paragraph with its formulas in TeX, in lines of a page."""
    # A formula stays on one line.
    words = (inline(x).replace(" ", "~") if is_math else x for is_math, x in parts(text))
    lines = textwrap.wrap(" ".join(words), 138, break_long_words=False, break_on_hyphens=False)
    return "\n".join(re.sub(r"^([-+#])", r"\\\1", line.replace("~", " ")) for line in lines)


def display(equations: str) -> str:
    """Lines of equations, aligned at the first sign of equality; one without continues."""
    lines = []
    for line in equations.splitlines():
        label, _, rest = line.rpartition(":  ")
        pieces = (tex(part) if is_math else rf"\text{{ {part} }}" for is_math, part in parts(rest))
        row = re.sub(r" ?\} \\text\{ ?", " ", " ".join(pieces))
        row = f"{tex(label)}: \\quad {row}" if label else row
        lines.append(row.replace("=", "&=", 1) if "=" in row else rf"&\quad {row}")
    if len(lines) == 1:
        return f"$${lines[0].replace('&', '')}$$"
    return "$$\\begin{aligned}\n" + " \\\\\n".join(lines) + "\n\\end{aligned}$$"


def markdown(paragraph: str) -> str:
    """A paragraph of a docstring; one without a full stop is equations."""
    is_equation = "=" in paragraph and not paragraph.endswith((".", ":"))
    return display(paragraph) if is_equation else sentence(paragraph)


def accounts(cls: type[Model], lead: str = "") -> Iterator[str]:
    """The docstring of a form after a lead; in place of a paragraph that names another class, the
    docstring of that class."""
    docstring = lead + (inspect.getdoc(cls) or "").replace("\n\nSource", "\nSource")
    for paragraph in docstring.split("\n\n"):
        names = re.findall(r"`([A-Z]\w+)`", paragraph)
        named = [getattr(sys.modules[cls.__module__], name) for name in names]
        if named:
            yield from chain.from_iterable(map(accounts, named))
        else:
            yield markdown(paragraph)


def sections() -> Iterator[str]:
    """One section a model, one part a form; the first form is the default."""
    for name, forms in models.catalogue().items():
        yield f"## `model: {name}`"
        for form, cls in forms.items():
            default = " (the default)" if form == next(iter(forms)) else ""
            yield from accounts(cls, f"**`form: {form}`**{default}: " * (len(forms) > 1))


if __name__ == "__main__":
    print("\n\n".join(sections()))
