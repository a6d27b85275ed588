"""Models in a user's own file: loading the file, and reporting a mistake in it or in the equations
of its models in one line with its place."""

import sys
import traceback
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from .. import HodoError
from ..arithmetic import SYMBOLS
from .base import LENGTHS, OWN_FOLDER, START, UNIT, VELOCITY, Model, attributes

MISTAKES = (Exception, SystemExit)
"""The exceptions that running a user's file may raise. SystemExit is among them, because `exit(0)`
in the file would end hodo as if all had gone well."""


class OwnFile(NamedTuple):
    """A user's file: its path, the forms of models in it, and its text. The text includes the files
    that it imports from its own folder, each under a line with its path there."""

    path: str
    forms: list[type[Model]]
    source: str


def load_own(path: str, name: str, taken: tuple[str, ...]) -> OwnFile:
    """Load a user's file as the module `name`. The names of models in `taken` exist already.

    Raises HodoError, one line with the place, if the file cannot be read or run, has no model, or
    has a model that is stated wrongly or whose name exists.
    """
    module, file = ModuleType(name), Path(path).resolve()
    module.__file__ = path
    # Entered before the file runs, because `dataclass` looks up the module of a class.
    sys.modules[name] = module
    # The folder comes last in the path, so that no file there hides a library.
    sys.path.append(str(file.parent))
    # Modules that were loaded from the folder before are loaded anew: those that this file imports
    # are then known, and their texts belong to it.
    earlier = {other: sys.modules.pop(other) for other in _beside(file.parent)}
    try:
        # Read once, so that the text in the hash is the text that runs, even if somebody edits the
        # file meanwhile.
        texts = {file: file.read_text("utf-8")}
        exec(compile(texts[file], path, "exec"), vars(module))
        texts |= {other: other.read_text("utf-8") for other in _beside(file.parent).values()}
    except MISTAKES as error:
        raise HodoError(with_place(error, path)) from error
    finally:
        sys.modules.update(earlier)
    if not (forms := forms_in(module)):
        raise HodoError(f"{path}: there is no model in it (a class with `name` and `form`)")
    for form in forms:
        for message in _class_mistakes(form, taken):
            raise HodoError(f"{path}: {form.__name__}: {message}")
        # Motions of own models are integrated in the case's own units, whatever class they extend.
        form.degree = {}
    return OwnFile(
        path,
        forms,
        "\n".join(f"# {x.relative_to(file.parent).as_posix()}\n{texts[x]}" for x in texts),
    )


def _beside(folder: Path) -> dict[str, Path]:
    """The files of the user's modules that have been loaded from a folder, by module name."""
    return {
        name: file
        for name, module in sorted(sys.modules.items())
        if _is_own(file := Path(getattr(module, "__file__", None) or ""), folder)
        if name.partition(".")[0] not in ("hodo_cli", "__main__")
    }


def _is_own(file: Path, folder: Path) -> bool:
    """Whether a Python file in this folder is the user's own, and not part of hodo or a library."""
    return (
        file.is_relative_to(folder)
        and file.suffix == ".py"
        and not file.is_relative_to(OWN_FOLDER)
        and "site-packages" not in file.parts
    )


def forms_in(module: ModuleType) -> list[type[Model]]:
    """The forms that a module defines, without those that it imports."""
    return [
        item
        for item in vars(module).values()
        if isinstance(item, type) and issubclass(item, Model) and item.__module__ == module.__name__
        if hasattr(item, "name") and "form" in vars(item)
    ]


def _class_mistakes(form: type[Model], taken: tuple[str, ...]) -> Iterator[str]:
    """Sentences on the mistakes in the name, the keys and the fields of a class."""
    keys, base = {*getattr(form, "keys", ())}, form.__mro__[1]
    lone = keys ^ {field.name for field in fields(form) if field.init and not field.kw_only}
    # A dataclass takes an inherited attribute of the same name for the default of a field.
    lost = keys & {*dir(base)} - {field.name for field in fields(base)}
    sentences = {
        f"there is already a model {form.name!r}": form.name in taken,
        "expected a frozen dataclass": "__dataclass_fields__" not in vars(form),
        f"expected a field for each of its `keys`: only one of both has {', '.join(lone)}": lone,
        f"its key {', '.join(lost)} is an attribute of {base.__name__}: name it otherwise": lost,
    }
    yield from (sentence for sentence, is_so in sentences.items() if is_so)


def with_place(error: BaseException, path: str) -> str:
    """The message of an error with its place: the last line that ran in the user's file, or in
    another file of its folder."""
    # A SyntaxError has no such line; it holds its place itself.
    frames = [] if isinstance(error, SyntaxError) else traceback.extract_tb(error.__traceback__)
    places = [
        f"{getattr(error, 'filename', None) or path}:{getattr(error, 'lineno', None) or 1}",
        *(
            f"{frame.filename}:{frame.lineno}"
            for frame in frames
            if frame.filename == path or _is_own(Path(frame.filename), Path(path).resolve().parent)
        ),
    ]
    hint = f"; {ALLOWED}" if Symbol.__name__ in str(error) else ""
    return f"{places[-1]}: {type(error).__name__}: {error}".partition("\n")[0] + hint


class Symbol:
    """A stand-in for a number in equations. It has the operations that the symbols of every engine
    have, and no others."""

    __array_ufunc__ = __bool__ = __eq__ = __ne__ = None  # type: ignore[assignment]

    def _result(self, *_: Any) -> "Symbol":
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = _result
    __truediv__ = __rtruediv__ = __pow__ = __neg__ = _result


ALLOWED = "equations consist of + - * / ** and sin, cos, exp, log, sqrt of hodo_cli.functions"
SYMBOLS[Symbol] = SimpleNamespace(
    **dict.fromkeys(("sin", "cos", "exp", "log", "sqrt"), lambda x: x)
)


def equations_mistake(system: Model, path: str) -> str:
    """The mistake in the equations of a model in a user's file, which are tried at the start of a
    motion with symbols and with numbers; empty if there is none."""
    try:
        return "".join(f"{path}: {message}" for message in _misfits(system)[:1])
    except MISTAKES as error:
        # An ArithmeticError comes from the numbers of this case, not from the equations.
        return "" if isinstance(error, ArithmeticError) else with_place(error, path)


def _misfits(system: Model) -> list[str]:
    """Sentences on wrong names of constants and on wrong sizes of the start, of the rates there and
    of the stored variables."""
    k, symbols = (attributes(system.constants, of) for of in (float, lambda _: Symbol()))
    functions = (system.rhs, *(event.function for event in system.run_events))
    for function in functions:
        # The state is a tuple, so that equations that change it fail here.
        function(Symbol(), tuple(Symbol() for _ in system.state), symbols)
    start = np.array(system.start)
    # As real numbers: a complex one raises TypeError.
    rates, *_ = [np.array(function(0.0, start.tolist(), k), dtype=float) for function in functions]
    stored = system.output(np.zeros(2), np.array([start, start]), k)
    given = {"start": len(start), "rhs": len(rates)} | {x: np.shape(stored[x]) for x in stored}
    asked = dict.fromkeys(("start", "rhs"), len(system.state)) | {
        name: tuple(({"time": 2} | LENGTHS)[dim] for dim in label.dims)
        for name, label in system.variables.items()
    }
    return [
        *(
            f"the constant {x} is an engine's: name it otherwise"
            for x in {START, UNIT, VELOCITY} & vars(k).keys()
        ),
        *(
            f"{name} has the size {given.get(name)}, expected {asked.get(name)}"
            for name in given | asked
            if given.get(name) != asked.get(name)
        ),
    ]
