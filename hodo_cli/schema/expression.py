"""Expressions of a case file: formulas in named variables, read by a walk over a syntax tree.

Nothing of a text is ever evaluated as code. It is tested word by word first, so that what Python's
parser would take besides (hexadecimal, 1_0, 1j, True, comments, letters of other scripts that it
turns into ASCII) never reaches the parser. Its tree is then taken apart node by node, and a node
that is not known is refused.
"""

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from .kinds import Kind, Wrong, as_finite, expected
from .spelling import number_advice, unknown

LONGEST, MOST_NODES, DEEPEST, LARGEST_EXPONENT = 500, 200, 30, 16
"""Characters, nodes, levels of nesting, and the exponent: more than a torque takes, and few enough
that no text is slow to read, to compile or to integrate."""

Tree = float | str | tuple[Any, ...]
"""A constant, the name of a variable, or an operation with its operands, `("*", 2.0, "p")`."""

FUNCTIONS: Mapping[str, Callable[..., float]] = {
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "exp": math.exp,
}

_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}

_OF_FLOATS: Mapping[str, Callable[..., float]] = {
    **FUNCTIONS,
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
    "neg": operator.neg,
}

# Without the leading zeros of 007, which Python's parser refuses for reasons of its own.
_DIGITS = r"(?!0+[1-9][0-9]*(?![0-9.eE]))(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_WORD = re.compile(
    rf"(?P<number>{_DIGITS}(?:[eE][-+]?[0-9]+)?(?![0-9A-Za-z_.]))"
    r"|(?P<name>[A-Za-z][0-9A-Za-z_]*(?:\.[A-Za-z][0-9A-Za-z_]*)?)|[-+*/() ]|(?P<other>.)",
    re.DOTALL,
)


@dataclass(frozen=True)
class Expression(Kind):
    """A formula in variables of these names, resolved to its text; a number is one too. A title
    stands for a list of names that is too long to read."""

    names: tuple[str, ...]
    title: str = ""

    def check(self, value: Any) -> str:
        if isinstance(value, str):
            parse_expression(value, self.names)
            return str(value)
        if as_finite(value) is None:
            raise expected(self, value)
        return repr(float(value))

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [{"type": "string", "maxLength": LONGEST}, {"type": "number"}]}

    def __str__(self) -> str:
        return self.title or f"an expression in {', '.join(self.names)}"


@lru_cache(maxsize=256)
def parse_expression(text: str, names: tuple[str, ...]) -> Tree:
    """The tree of an expression in variables of these names, its constants folded; its value is
    that of `arithmetic.evaluate`. Raises Wrong, with the column.

    Numbers are decimals; + - * / ** with a whole number as exponent, signs, parentheses, and the
    functions of FUNCTIONS.
    """
    if len(text) > LONGEST:
        raise _wrong(LONGEST, f"longer than {LONGEST} characters")
    _check_words(text, names)
    # Python takes an indented line for a block.
    line = text.lstrip()
    indent = len(text) - len(line)
    try:
        body = ast.parse(line, mode="eval").body
    except (SyntaxError, MemoryError, RecursionError) as error:
        # An offset of 0 is the end of the text.
        position = indent + (getattr(error, "offset", None) or len(line) + 1) - 1
        message = error.msg if isinstance(error, SyntaxError) else "too many nested parentheses"
        # Python's own words elsewhere speak of commas, or of nothing but invalid syntax.
        parentheses = re.search(r"[()]|parenthes", message)
        raise _wrong(
            position, message if parentheses else "an operand or an operator is missing"
        ) from None
    nodes = sum(isinstance(node, ast.expr) for node in ast.walk(body))
    if nodes > MOST_NODES:
        raise _wrong(indent, f"{nodes} numbers, names and operations, more than {MOST_NODES}")
    return _Walk(line, indent).tree(body, 1)


def names_in(tree: Tree) -> set[str]:
    """The variables in the tree of an expression."""
    if isinstance(tree, str):
        return {tree}
    return set().union(*map(names_in, tree[1:])) if isinstance(tree, tuple) else set()


def _wrong(position: int, sentence: str) -> Wrong:
    """The mistake at a position, from 0, of an expression's text."""
    return Wrong(((), f"column {position + 1} of the expression: {sentence}"))


def _check_words(text: str, names: tuple[str, ...]) -> None:
    """That all of a text is numbers, known names and operators. Raises Wrong."""
    valid = [*names, *FUNCTIONS]
    for word in _WORD.finditer(text):
        number, name, other = word.groups()
        if other:
            what = f"unexpected {other!r}{'; a power is **' if other == '^' else ''}"
            if other in "0123456789":
                what = "not a decimal number; a product is written with its *, as 2*p"
            raise _wrong(word.start(), what)
        if name and name not in valid:
            advice = number_advice(name)
            what = f"name {name!r}{advice}"
            raise _wrong(word.start(), unknown(what, "" if advice else name, valid))
        if number and not math.isfinite(float(number)):
            raise _wrong(word.start(), "a number too large for a double")


@dataclass(frozen=True)
class _Walk:
    """The way through one syntax tree; its line begins `indent` columns into the text."""

    line: str
    indent: int

    def wrong(self, node: ast.expr, sentence: str) -> Wrong:
        return _wrong(self.indent + node.col_offset, sentence)

    def source(self, node: ast.expr) -> str:
        return self.line[node.col_offset : node.end_col_offset]

    def tree(self, node: ast.expr, level: int) -> Tree:
        """The tree of one node. Raises Wrong."""
        if level > DEEPEST:
            raise self.wrong(node, f"nested more than {DEEPEST} levels deep")
        match node:
            case ast.Constant():
                return float(self.source(node))
            case ast.Name(id=name) if name not in FUNCTIONS:
                return name
            case ast.Attribute(value=ast.Name(id=vector), attr=part):
                return f"{vector}.{part}"
            case ast.UnaryOp(op=ast.UAdd()):
                return self.tree(node.operand, level + 1)
            case ast.UnaryOp(op=ast.USub()):
                return self.folded(node, "neg", self.tree(node.operand, level + 1))
            case ast.BinOp() if type(node.op) in _OPERATORS:
                # A long sum leans to the left and is not nested for that.
                operand, word = self.tree(node.left, level), _OPERATORS[type(node.op)]
                if word == "**":
                    return self.folded(node, word, operand, self.exponent(node.right))
                return self.folded(node, word, operand, self.tree(node.right, level + 1))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in FUNCTIONS
            ):
                return self.folded(node, name, self.tree(argument, level + 1))
        raise self.wrong(node, "expected a number, a variable, or a function of one argument")

    def exponent(self, node: ast.expr) -> int:
        """A whole number, in digits only. Raises Wrong."""
        value = None
        with suppress(ValueError):  # it is no literal: q, or 1+1
            value = ast.literal_eval(node)
        if not isinstance(value, int) or abs(value) > LARGEST_EXPONENT:
            most = LARGEST_EXPONENT
            raise self.wrong(node, f"an exponent is a whole number from {-most} to {most}")
        return value

    def folded(self, node: ast.expr, word: str, *operands: Any) -> Tree:
        """An operation, or its value where its operands are constants. Raises Wrong."""
        if word == "/" and operands[1] == 0:
            raise self.wrong(node, "a division by 0")
        if any(isinstance(operand, str | tuple) for operand in operands):
            return word, *operands
        try:
            value = float(_OF_FLOATS[word](*operands))
        except (ArithmeticError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            raise self.wrong(node, f"{self.source(node)} is not a finite number")
        return value
