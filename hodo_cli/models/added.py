"""Models that are not hodo's: the texts that they are made of, and what is wrong with a file of
models, or with their equations, as one line with its place."""

import ast
import hashlib
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from itertools import compress, product
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .. import HodoError
from ..arithmetic import SYMBOLS
from .base import (
    LENGTHS,
    OWN_FOLDER,
    UNIT,
    VELOCITY,
    Bound,
    Constants,
    Event,
    Model,
    Structure,
    attributes,
    count,
    in_unit,
    moving,
    namespace,
    rescaled,
    state_powers,
    structure,
)

MISTAKES = (Exception, SystemExit)
"""What running a file of models may raise: one that calls `exit(0)` would end hodo as if all had
gone well."""


class AddedModule(NamedTuple):
    """A module with models that are not hodo's: where it comes from, the module, and the text of
    its file and of the files that it imports from its own folder, by their paths from there."""

    origin: str
    module: ModuleType
    texts: dict[str, bytes]

    @property
    def digest(self) -> str:
        """The digest of all the texts."""
        return hashlib.sha256(repr(sorted(self.texts.items())).encode()).hexdigest()

    @property
    def source(self) -> str:
        """The texts for a reader, each below its file's path."""
        return "\n".join(
            f"# {path}\n{text.decode(errors='replace')}" for path, text in self.texts.items()
        )


def texts_of(path: Path, text: bytes, module: str = "") -> dict[str, bytes]:
    """The text of a file, and those of the files that it imports from its own folder, and these in
    turn; by their paths from that folder.

    `module` is the dotted name of a module of an installed package: what it imports from this
    package counts, and not what other packages have beside it.
    """
    depth = module.count(".") + (bool(module) and path.name == "__init__.py")
    folder, package = path.resolve().parents[depth], module.partition(".")[0]
    texts: dict[str, bytes] = {}
    waiting = [(path.resolve(), text)]
    while waiting:
        file, text = waiting.pop()
        name = file.relative_to(folder).as_posix()
        if name in texts:
            continue
        texts[name] = text
        for imported in _imports(text, file.relative_to(folder).parent.parts):
            if imported[0] == package if package else imported[0] != "hodo_cli":
                waiting += [(source, source.read_bytes()) for source in _files(folder, imported)]
    return texts


def _imports(text: bytes, package: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """The parts of the names of all modules that a text may import, in functions too; `package` is
    that of the text's own module."""
    tree = ast.Module([], [])
    with suppress(SyntaxError):  # of a file that is not imported after all
        tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (tuple(alias.name.split(".")) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            named = tuple(filter(None, (node.module or "").split(".")))
            # What is imported from a package may be a module of it.
            yield from ((*base, *named, alias.name) for alias in node.names)


def _files(folder: Path, name: tuple[str, ...]) -> Iterator[Path]:
    """The files in a folder that importing a module runs: its own, and those of its packages."""
    for i in range(1, len(name) + 1):
        module = folder.joinpath(*name[:i])
        for file in (module.with_suffix(".py"), module / "__init__.py"):
            if file.is_file():
                yield file


def with_source_line(error: BaseException, path: str) -> str:
    """An error that a file of models raises, after the line of it, or of a file that it imports
    from its own folder, where it did."""
    if isinstance(error, SyntaxError):
        return f"{error.filename or path}:{error.lineno or 1}: {error.msg}"
    folder = Path(path).resolve().parent
    lines = [
        f"{frame.filename}:{frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == path or _is_beside(Path(frame.filename).resolve(), folder)
    ]
    kind = "" if isinstance(error, HodoError) else f"{type(error).__name__}: "
    message = f"{kind}{error}".partition("\n")[0]
    if isinstance(error, SystemExit):
        message = f"exit({error}) would end hodo: raise an error instead"
    if isinstance(error, AttributeError) and isinstance(error.obj, SimpleNamespace):
        names = ", ".join(filter(str.isidentifier, vars(error.obj)))
        message = f"there is no constant {error.name!r} (`constants` has: {names})"
    return f"{lines[-1] if lines else f'{path}:1'}: {message}"


def _is_beside(file: Path, folder: Path) -> bool:
    """Whether a file lies in the folder of a model, and is no library's or frozen in Python."""
    return (
        file.is_file()
        and file.is_relative_to(folder)
        # Hodo itself may stand in the folder of a model.
        and not file.is_relative_to(OWN_FOLDER)
        and "site-packages" not in file.parts
    )


def equations_mistake(system: Model, path: str) -> str:
    """The mistake in the equations of a file's model, tried at the start of a motion: with symbols,
    with its numbers, and with those of other units; empty if there is none."""
    try:
        _try_symbols(system)
        message = _misfit(system)
    except ArithmeticError:
        return ""  # that is for the numbers of a case to answer, not for its equations
    except NotImplementedError:
        message = f"the model {system.name} states no rhs"
    except MISTAKES as error:
        return with_source_line(error, path)
    return f"{path}: {message}" if message else ""


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
    """Why the rates of a motion at its start, or what is stored of it, do not fit its state, its
    variables or its `degree`; empty if they do."""
    k: dict[str, Any] = {**system.constants}
    for word, degrees, holder, known in (
        ("degree", system.degree, "constants", k),
        ("state_degree", system.state_degree, "state", system.state),
    ):
        if strange := [name for name in degrees if name not in known]:
            names = ", ".join(filter(str.isidentifier, known))
            return f"`{word}` names {strange[0]!r}, but `{holder}` has: {names}"
    if strange := [name for name, d in system.state_degree.items() if d not in range(100)]:
        return f"`state_degree` of {strange[0]!r} is no whole number from 0 on"
    if strange := [name for name, value in k.items() if np.iscomplexobj(value)]:
        return f"`constants` gives a complex {strange[0]!r}"
    start, variables = np.array(system.start), f"{len(system.state)} variables of the state"
    if len(start) != len(system.state):
        return f"start gives {len(start)} numbers for {variables}"
    rates = system.rhs(0.0, start.tolist(), attributes(k))
    if len(rates) != len(start):
        return f"rhs gives {len(rates)} rates for {variables}"
    if np.iscomplexobj(rates):
        return f"rhs gives complex rates at the start of a motion: {', '.join(map(str, rates))}"
    if system.degree and (misfits := _rates_off_degree(system, start)):
        return (
            "`degree` does not fit rhs: with the constants of other units it gives other rates of "
            f"{', '.join(misfits)}; a constant within a function, as w in sin(w*t), has no degree"
        )
    if constant := [event.kind for event in system.run_events if _is_constant(event, start, k)]:
        return f"the function of the event {constant[0]!r} is the same at all times and states"
    return _misfit_of_output(system, start)


@np.errstate(all="ignore")  # a state that no motion need come to
def _is_constant(event: Event, start: np.ndarray, k: Mapping[str, Any]) -> bool:
    """Whether an event has one value at several times and states, and so no zero."""
    states = (start + i * np.cos(1 + np.arange(len(start))) for i in range(3))
    values = [float(event.function(i / 2, y, attributes(k))) for i, y in enumerate(states)]
    return len({*values}) == 1


VELOCITY_EXPONENT, TIME_EXPONENT = 2, -3
"""The units in which equations are tried again, as powers of two: any two that no degrees make
equal."""


def _in_other_units(model: type[Model], k: Mapping[str, Any]) -> dict[str, Any]:
    """Constants in these units, as `degree` says."""
    units = {VELOCITY: 2.0**VELOCITY_EXPONENT, UNIT: 2.0**TIME_EXPONENT}
    return {
        name: in_unit(value, VELOCITY_EXPONENT * (model.degree[name] - 1) + TIME_EXPONENT)
        if name in model.degree
        else units.get(name, value)
        for name, value in k.items()
    }


def _rates_off_degree(system: Model, start: np.ndarray) -> list[str]:
    """The variables of whose rates rhs gives others for the same motion in other units of velocity
    and time, with the constants that `degree` says there; `t` stays the case's own."""
    model, k = type(system), system.constants
    other = attributes(_in_other_units(model, k))
    # Each variable by its own unit: a direction does not grow with omega, and numbers stay finite.
    size = (np.abs(start[moving(model)]).max() or 1.0) ** state_powers(model)
    # At other times and states too: a term may be 0 at the start, as sin t, or q where q begins.
    for t, moved in product((0.0, 0.618, 2.399), (0.0, 0.0817)):
        y = start + moved * size * np.cos(1 + np.arange(len(start)))
        try:
            rates = np.array(system.rhs(t, y.tolist(), attributes(k)))
            y = rescaled(model, y, -VELOCITY_EXPONENT)
            again = np.array(system.rhs(t, y.tolist(), other))
        except (ArithmeticError, ValueError):  # no motion need come there
            continue
        if not np.isfinite([rates, again]).all():  # nor may one where a law of the time overflows
            continue
        # Of the other units back to these.
        again = np.ldexp(rescaled(model, again, VELOCITY_EXPONENT), -TIME_EXPONENT)
        if (off := np.abs(rates - again) > 1e-9 * np.abs(rates).max()).any():
            return list(compress(system.state, off))
    return []


def _misfit_of_output(system: Model, start: np.ndarray) -> str:
    """Why what is stored of a state is not what `variables` name; empty if it is."""
    stored = system.output(np.zeros(2), np.array([start, start]), attributes(system.constants))
    if stored.keys() != system.variables.keys():
        return (
            f"output gives {', '.join(stored)}, but `variables` has: {', '.join(system.variables)}"
        )
    lengths = {"time": 2, **LENGTHS}
    for name, label in system.variables.items():
        shape = np.shape(stored[name])
        if shape != tuple(lengths.get(dim) for dim in label.dims):
            return (
                f"output gives {name} of the shape {shape} for 2 times: expected "
                f"({', '.join(label.dims)})"
            )
    return ""


# A level in an event, as that of `y[2] - k.level`, is a number of the case, which no degree turns
# into other units.

KEPT = "case's "
"""What precedes the name of a constant that is kept in the case's own units: no constant of a
user's is named so."""


class WithLevels(Model):
    """The class before a form of a user's own with `degree` and events: those that are not
    homogeneous see the state and the constants in the case's own units."""

    given: ClassVar[type[Model]]

    @cached_property
    def constants(self) -> Constants:
        k = super().constants
        kept = {KEPT + name: k[name] for name in self.degree if name in k}
        return {VELOCITY: 1.0, **k, **kept}

    @property
    def run_events(self) -> tuple[Event, ...]:
        form, powers = structure(self.constants), tuple(state_powers(self.given).tolist())
        return tuple(
            event._replace(function=Bound(in_case_units, (powers, event.function)))
            if _has_level(self.given, form, event.function)  # type: ignore[arg-type]
            else event
            for event in super().run_events
        )


def in_case_units(
    powers: Sequence[int], function: Callable[..., Any], t: Any, y: Sequence[Any], k: Any
) -> Any:
    """A function of the case's own units at a state and constants of an engine's units."""
    y = [x * k.velocity_unit**power for x, power in zip(y, powers, strict=True)]
    own = {name.removeprefix(KEPT): value for name, value in vars(k).items()}
    return function(t, y, SimpleNamespace(**own | {VELOCITY: 1.0, UNIT: 1.0}))


@lru_cache(maxsize=64)
def _has_level(model: type[Model], form: Structure, function: Callable[..., Any]) -> bool:
    """Whether the function of an event has other zeros in other units: one that is homogeneous
    stays in units that fit, where a motion may be too small for doubles."""
    # Any numbers serve that no formula makes 0 or equal.
    k = namespace(form, [1.1 + i / 7 for i in range(count(form))])
    other = SimpleNamespace(**_in_other_units(model, vars(k)))
    ratios = []
    with suppress(*MISTAKES), np.errstate(all="ignore"):  # `equations_mistake` names them
        for t, size in ((0.618, 1.0), (2.399, 1.7)):
            y = size + np.arange(len(model.state)) / 11
            again = function(t, [*rescaled(model, y, -VELOCITY_EXPONENT)], other)
            ratios.append(again / function(t, [*y], k))
        return not abs(ratios[0] - ratios[1]) <= 1e-9 * abs(ratios[0])
    return False


@cache
def with_levels(form: type[Model]) -> type[Model]:
    """A form of a user's own, the events of which may have levels."""
    if not form.degree or form.run_events is Model.run_events:
        return form
    attributes_of = {"__module__": form.__module__, "__doc__": form.__doc__, "given": form}
    return dataclass(frozen=True)(type(form.__name__, (WithLevels, form), attributes_of))
