"""Expressions of a case file: formulas in named variables, read by Python's parser and a walk over
its syntax tree.

No text is ever evaluated as code. It is first tested word by word, so that Python's parser never
sees other things that it would accept: hexadecimal numbers, 1_0, comments, letters of other scripts
that it turns into ASCII. Then each node of the tree has to be a known one.
"""

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

from .kinds import Rule, Wrong, as_finite, expected
from .spelling import shown, unknown

LONGEST, MOST_NODES, DEEPEST, LARGEST_EXPONENT = 500, 200, 30, 16
"""The most characters, nodes, levels of nesting, and the largest exponent: more than a torque
needs, and few enough to read, compile and integrate any text quickly."""

Tree = float | str | tuple[Any, ...]
"""A constant, the name of a variable, or an operation with its operands, `("*", 2.0, "p")`."""

FUNCTIONS: Mapping[str, Callable[..., float]] = {
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "exp": math.exp,
    "log": math.log,
    "abs": abs,
    "tanh": math.tanh,
}
"""The functions of an expression, each of one argument, for constants."""

OPERATOR_WORDS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}

OF_CONSTANTS: Mapping[str, Callable[..., float]] = {
    **FUNCTIONS,
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "**": operator.pow,
    "neg": operator.neg,
}

OTHER_FUNCTIONS = {
    "pi": "3.141592653589793",
    "e": "2.718281828459045",
    "tan": "sin(x)/cos(x)",
    "sinh": "(exp(x) - exp(-x))/2",
    "cosh": "(exp(x) + exp(-x))/2",
    "pow": "x**n",
    "ln": "log(x)",
    "sign": "tanh(x/width), or x/abs(x) for a jump",
    "y": "y1, y2 or y3",
    "z": "z1, z2 or z3",
}
"""What to write instead of names that are unknown here."""

# Without the leading zeros of 007, which Python's parser refuses.
_DIGITS = r"(?!0+[1-9][0-9]*(?![0-9.eE]))(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_WORD = re.compile(
    rf"(?P<number>{_DIGITS}(?:[eE][-+]?[0-9]+)?(?![0-9A-Za-z_.]))"
    r"|(?P<name>[A-Za-z][0-9A-Za-z_]*(?:\.[A-Za-z][0-9A-Za-z_]*)?)|[-+*/() ]|(?P<other>.)",
    re.DOTALL,
)


def Expression(names: tuple[str, ...] | None, title: str) -> Rule:
    """The rule of an expression in variables of these names or, for None, of any names. Its value
    is resolved to text; a number is an expression too."""

    def text_of(value: Any) -> str:
        if isinstance(value, str):
            parse_expression(value, names)
        elif as_finite(value) is None:
            raise expected(rule, value)
        return value if isinstance(value, str) else repr(float(value))

    text = {"type": "string", "maxLength": LONGEST}
    rule = {"anyOf": [text, {"type": "number"}], "title": title, "whole": text_of}
    return rule


@lru_cache(maxsize=256)
def parse_expression(text: str, names: tuple[str, ...] | None = None) -> Tree:
    """The tree of an expression in variables of these names or, for None, of any names, with
    constants folded; `arithmetic.evaluate` computes its value. Raises Wrong, with the column.

    It consists of decimal numbers, + - * /, ** with a whole number as exponent, signs, parentheses,
    and the functions of FUNCTIONS.
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
        raise _wrong(*_syntax_mistake(error, line, indent)) from None
    nodes = sum(isinstance(node, ast.expr) for node in ast.walk(body))
    if nodes > MOST_NODES:
        raise _wrong(indent, f"{nodes} numbers, names and operations, more than {MOST_NODES}")
    return _tree(body, indent, 1)


def names_in(tree: Tree) -> set[str]:
    """The variables in the tree of an expression."""
    if isinstance(tree, str):
        return {tree}
    return set().union(*map(names_in, tree[1:])) if isinstance(tree, tuple) else set()


def _wrong(position: int, sentence: str) -> Wrong:
    """The mistake at a position, from 0, of an expression's text."""
    return Wrong(((), f"column {position + 1} of the expression: {sentence}"))


def _check_words(text: str, names: tuple[str, ...] | None) -> None:
    """Check that a text consists of numbers, known names and operators. Raises Wrong."""
    for word in _WORD.finditer(text):
        number, name, other = word.groups()
        if other:
            hint = "; a power is **" if other == "^" else ""
            is_number = other in "0123456789"
            raise _wrong(
                word.start(),
                "not a decimal number; a product is written with its *, as 2*p"
                if is_number
                else f"unexpected {other!r}{hint}",
            )
        if number and not math.isfinite(float(number)):
            raise _wrong(word.start(), "a number too large for a double")
        is_call = bool(re.match(r" *\(", text[word.end() :]))
        is_name = name not in FUNCTIONS if names is None else name in names
        is_known = name in FUNCTIONS if is_call else is_name
        if name and not is_known:
            raise _wrong(word.start(), _unknown_name(name, names, is_call))


def _unknown_name(name: str, names: tuple[str, ...] | None, is_call: bool) -> str:
    """The message about a name that stands for nothing in an expression."""
    if name in FUNCTIONS:
        return f"{name} is a function of one argument: {name}(x)"
    answer = f"; write {OTHER_FUNCTIONS[name]}" if name in OTHER_FUNCTIONS else ""
    what, valid = ("function", FUNCTIONS) if is_call else ("name", [*(names or ()), *FUNCTIONS])
    return unknown(f"{what} {shown(name)}", name, valid, answer)


def _syntax_mistake(error: BaseException, line: str, indent: int) -> tuple[int, str]:
    """Where and why Python's parser refuses a line."""
    if not isinstance(error, SyntaxError):
        return indent, "too many nested parentheses"
    # Other messages of Python's speak of commas, or say "invalid syntax" alone.
    of_parentheses = re.search(r"[()]|parenthes", error.msg)
    # An offset of 0 means the end of the text.
    position = indent + (error.offset or len(line) + 1) - 1
    return position, error.msg if of_parentheses else "an operand or an operator is missing"


def _tree(node: ast.expr, indent: int, level: int) -> Tree:
    """The tree of one node of a line that begins `indent` columns into its text. Raises Wrong."""
    if level > DEEPEST:
        raise _wrong(indent + node.col_offset, f"nested more than {DEEPEST} levels deep")
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
        case ast.Name(id=name) if name not in FUNCTIONS:
            return name
        case ast.Attribute(value=ast.Name(id=vector), attr=part):
            return f"{vector}.{part}"
        case ast.UnaryOp(op=ast.UAdd()):
            return _tree(node.operand, indent, level + 1)
        case ast.UnaryOp(op=ast.USub()):
            return _folded(node, indent, "neg", _tree(node.operand, indent, level + 1))
        case ast.BinOp() if type(node.op) in OPERATOR_WORDS:
            # A long sum leans to the left, which is no nesting.
            left, right = _tree(node.left, indent, level), _tree(node.right, indent, level + 1)
            if isinstance(node.op, ast.Pow):
                right = _exponent(indent + node.right.col_offset, right)
            return _folded(node, indent, OPERATOR_WORDS[type(node.op)], left, right)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            return _folded(node, indent, name, _tree(argument, indent, level + 1))
    says = "expected a number, a variable, or a function of one argument"
    raise _wrong(indent + node.col_offset, says)


def _exponent(at: int, tree: Tree) -> int:
    """The exponent in a tree, as a whole number. Raises Wrong, with the column `at`."""
    if not isinstance(tree, float) or tree % 1 or abs(tree) > LARGEST_EXPONENT:
        most = LARGEST_EXPONENT
        hint = "; a root is sqrt(x)" if tree == 0.5 else ""
        raise _wrong(at, f"an exponent is a whole number from {-most} to {most}{hint}")
    return int(tree)


def _folded(node: ast.expr, indent: int, word: str, *operands: Any) -> Tree:
    """An operation, or its value if its operands are constants. Raises Wrong."""
    at = indent + node.col_offset
    if word == "/" and operands[1] == 0:
        raise _wrong(at, "a division by 0")
    if any(isinstance(operand, str | tuple) for operand in operands):
        return word, *operands
    try:
        value = float(OF_CONSTANTS[word](*operands))
    except (ArithmeticError, ValueError):
        value = math.nan
    if not math.isfinite(value):
        raise _wrong(at, f"{ast.unparse(node)} is not a finite number")
    return value
