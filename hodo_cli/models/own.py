"""Models in a user's own files: how they are loaded, and what is wrong with them, as one line with
its place."""

import hashlib
import sys
import traceback
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from .. import HodoError
from ..arithmetic import SYMBOLS
from .base import LENGTHS, OWN_FOLDER, Model, attributes

MISTAKES = (Exception, SystemExit)
"""What running a file of models may raise: one that calls `exit(0)` would end hodo as if all had
gone well."""


class OwnFile(NamedTuple):
    """A file of models: its path, its module, and the texts of the file and of what it has imported
    from its own folder, by their paths from there."""

    path: str
    module: ModuleType
    texts: dict[str, str]

    @property
    def digest(self) -> str:
        """The digest of all the texts."""
        return hashlib.sha256(repr(sorted(self.texts.items())).encode()).hexdigest()

    @property
    def source(self) -> str:
        """The texts for a reader, each below its file's path."""
        return "\n".join(f"# {path}\n{text}" for path, text in self.texts.items())


def load_own(path: str, name: str) -> OwnFile:
    """A file of a user's own as the module `name`.

    Raises HodoError, one line with the place, if it cannot be read or run.
    """
    module, folder = ModuleType(name), Path(path).resolve().parent
    module.__file__ = path
    # Before it runs, because `dataclass` looks its module up; its folder goes last: no file there
    # is taken for a library.
    sys.modules[name] = module
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    try:
        # Read once, so that the text hashed is the text run, even if the file is edited meanwhile.
        text = Path(path).read_text("utf-8")
        exec(compile(text, path, "exec"), vars(module))
    except OSError as error:
        raise HodoError(f"{path}: {str(error.strerror).lower()}") from None
    except MISTAKES as error:
        raise HodoError(with_place(error, path)) from error
    beside = {
        Path(str(other.__file__)) for other in [*sys.modules.values()] if _is_beside(other, folder)
    }
    texts = {
        file.relative_to(folder).as_posix(): file.read_text("utf-8") for file in sorted(beside)
    }
    return OwnFile(path, module, {Path(path).name: text} | texts)


def _is_beside(module: ModuleType, folder: Path) -> bool:
    """Whether a module lies in the folder of a model, and is no library's."""
    file = getattr(module, "__file__", None) or ""
    return (
        file.startswith(str(folder))
        and not file.startswith(OWN_FOLDER)
        and "site-packages" not in file
        and file.endswith(".py")
    )


def with_place(error: BaseException, path: str) -> str:
    """An error after the line, of a file of models or of one beside it, that raises it."""
    if isinstance(error, SyntaxError):
        return f"{error.filename or path}:{error.lineno or 1}: {error.msg}"
    folder = str(Path(path).resolve().parent)
    places = [
        f"{frame.filename}:{frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == path
        or (frame.filename.startswith(folder) and not frame.filename.startswith(OWN_FOLDER))
    ]
    kind = "" if isinstance(error, HodoError) else f"{type(error).__name__}: "
    message = f"{kind}{error}".partition("\n")[0]
    if isinstance(error, AttributeError) and isinstance(error.obj, SimpleNamespace):
        names = ", ".join(filter(str.isidentifier, vars(error.obj)))
        message = f"there is no constant {error.name!r} (`constants` has: {names})"
    return f"{places[-1] if places else f'{path}:1'}: {message}"


class Symbol:
    """What stands in equations for a number and for all that engines put there: it knows what they
    all know, and no more."""

    __array_ufunc__ = None
    __hash__ = None  # type: ignore[assignment]

    def _result(self, *others: Any) -> "Symbol":
        if any(isinstance(other, complex) for other in others):
            raise TypeError("a complex number is no coefficient of a motion")
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = _result
    __truediv__ = __rtruediv__ = __pow__ = __neg__ = _result

    def _undecided(self, *_: Any) -> Any:
        raise TypeError("which of two branches is taken must not depend on t, y or k")

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _undecided


FUNCTION_NAMES = ("sin", "cos", "exp", "log", "sqrt")
SYMBOLS[Symbol] = SimpleNamespace(**dict.fromkeys(FUNCTION_NAMES, lambda x: x))


def equations_mistake(system: Model, path: str) -> str:
    """The mistake in the equations of a file's model, tried at the start of a motion with symbols
    and with its numbers; empty if there is none."""
    try:
        _try_symbols(system)
        message = _misfit(system)
    except ArithmeticError:
        return ""  # that is for the numbers of a case to answer, not for its equations
    except NotImplementedError:
        message = f"the model {system.name} states no rhs"
    except MISTAKES as error:
        return with_place(error, path)
    return f"{path}: {message}" if message else ""


def _try_symbols(system: Model) -> None:
    """Pass symbols through the equations and events. Raises TypeError where these do what no symbol
    knows."""
    k = attributes(system.constants, lambda _: Symbol())
    # A tuple, since an engine's own list of the state is not to be changed.
    y = tuple(Symbol() for _ in system.state)
    try:
        for function in (system.rhs, *(event.function for event in system.run_events)):
            function(Symbol(), y, k)
    except TypeError as error:
        error.args = (
            f"{error}; equations consist of + - * / ** and {', '.join(FUNCTION_NAMES)} of "
            "hodo_cli.functions",
        )
        raise


def _misfit(system: Model) -> str:
    """Why the rates at the start of a motion, or what is stored of it, do not fit its state or its
    variables; empty if they do."""
    start, count = np.array(system.start), len(system.state)
    rates = system.rhs(0.0, start.tolist(), attributes(system.constants))
    if not len(start) == len(rates) == count:
        return f"{count} variables of the state, {len(start)} numbers of start, {len(rates)} of rhs"
    if np.iscomplexobj(np.array(rates)):
        return f"rhs gives complex rates at the start of a motion: {', '.join(map(str, rates))}"
    stored = system.output(np.zeros(2), np.array([start, start]), attributes(system.constants))
    lengths = {"time": 2, **LENGTHS}
    given = {name: np.shape(values) for name, values in stored.items()}
    asked = {
        name: tuple(lengths[dim] for dim in label.dims) for name, label in system.variables.items()
    }
    return (
        f"output gives the shapes {given} for 2 times, `variables` {asked}"
        if given != asked
        else ""
    )
