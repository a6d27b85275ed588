"""Case files: from YAML to frozen cases, checked, and back.

The keys of a case are `model`, `form`, those of its model's form, and COMMON. A value is taken from
the first of: an override (`--set`), the case, the file's `defaults:`, the key's own default. A
mistake is reported with its file, line, column, key and nearest spelling; all mistakes of a file
are raised together, as one HodoError with a line for each.
"""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Never, TypeVar

import numpy as np

from .. import HodoError, models
from ..models.attitude import ATTITUDE_KEY, check_attitude, keys_of_form, system_of, takes_attitude
from ..models.base import Model
from ..models.rigid_body import BodyFrame, range_mistake
from ..schema.document import Block, Mistakes, Place, locate, read, write
from ..schema.kinds import (
    Key,
    KeyPath,
    Mistake,
    Wrong,
    WrongKey,
    as_finite,
    check_keys,
    expected,
    is_list,
    mistakes_where,
)
from ..schema.spelling import other_word, shown, unknown
from ..text import time_text
from .derived import DERIVED, LeftOut, constants_of, derivable, missing, remedy_of
from .keys import (
    COMMON,
    FORMER_KEYS,
    NO_CLOSED_FORM,
    NO_RATES,
    REMARKS,
    all_keys,
    drop_replaced_times,
    finds_no_stop,
    keys_in,
    most_samples,
    wrong_precision,
)
from .sweep_block import SWEEP, Axis, axes_of, check_axes, first_values, storable

# Safe as a group of HDF5 (no slash), as a file, and in a shell; `_` in front is kept for groups
# that are no cases.
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
NAME_RULE = (
    "a name is up to 100 of the characters A-Z a-z 0-9 . _ - and begins with a letter or digit"
)


class FrozenDict(dict[str, Any]):
    """A dict that cannot be changed, so that it has a hash: what holds it can be a key itself.

    It is a dict, and not some other mapping, so that it equals one and is written as one.
    """

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[type["FrozenDict"], tuple[dict[str, Any]]]:
        return FrozenDict, (dict(self),)  # or else pickle fills it entry by entry

    def _refuse(self, *_: Any, **__: Any) -> Never:
        raise TypeError("the data of a case do not change: make another with dataclasses.replace")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse


def frozen(value: Any) -> Any:
    """Plain data with every mapping in them frozen, and every list a tuple."""
    if isinstance(value, FrozenDict):
        return value
    if isinstance(value, Mapping):
        return FrozenDict({key: frozen(item) for key, item in value.items()})
    return tuple(map(frozen, value)) if isinstance(value, list | tuple) else value


@dataclass(frozen=True, kw_only=True)
class Time:
    """Span and number of samples of a case; a single sample is taken at the end, and there is no
    other where the motion ends at its start. `values` are the times of the samples where they are
    not evenly spaced; with `steps` the method's own steps are the samples, and their number is not
    known here."""

    start: float = 0.0
    end: float
    samples: int = 1001
    unit: str = "1"
    values: tuple[float, ...] | None = None
    steps: bool = False

    def __post_init__(self) -> None:
        if self.start == self.end:
            object.__setattr__(self, "samples", 1)

    @property
    def entries(self) -> dict[str, Any]:
        """The keys of a case file that state it."""
        sampled = "steps" if self.steps else "samples"
        span = ("values",) if self.values else ("end", sampled)
        return {key: getattr(self, key) for key in ("start", *span, "unit")}

    def text(self, time: float, digits: int = 6) -> str:
        """A time of the motion, to so many digits of what has passed since the start."""
        return time_text(time, self.start, digits)

    def listed(self, times: np.ndarray) -> "Time":
        """The same span with samples at just these times (n,)."""
        values = tuple(times.tolist())
        return replace(self, end=values[-1], samples=len(values), values=values, steps=False)

    def resampled(self, samples: int) -> "Time":
        """The same span with so many samples, evenly spaced."""
        return replace(self, samples=samples, values=None)


def plain(value: Any) -> Any:
    """Arrays of numpy, tuples and ranges as lists, its numbers as Python's, those of extended
    precision rounded to doubles as the numbers of a file are: what a YAML file can say."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return (value.astype(float) if value.dtype.kind == "f" else value).tolist()
    return [plain(item) for item in value] if isinstance(value, list | tuple | range) else value


@dataclass(frozen=True)
class Case:
    """One experiment, complete: `data` holds the keys of its model's form, every default filled in.

    A case can be a key of a dictionary. Any mapping may be given as `data`; it is kept frozen.
    """

    name: str
    model: str
    form: str
    data: Mapping[str, Any]
    time: Time
    inertia_unit: str = "1"
    method: str = "auto"
    tol: float | None = None
    precision: str = "double"
    error: bool = True
    store: tuple[str, ...] = ()
    max_seconds: float | None = None
    max_steps: int | None = None
    note: str = ""
    assumes: Mapping[str, str] = field(default_factory=dict)
    sweep: Mapping[str, Any] | None = None

    def __new__(cls, *positional: Any, **_: Any) -> "Case":
        """Raises HodoError for a mapping, which a notebook may try."""
        if positional and isinstance(positional[0], Mapping):
            raise HodoError("Case.of makes a case of a mapping")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for name in ("data", "sweep", "store", "assumes"):
            # The way into a frozen dataclass.
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __getstate__(self) -> dict[str, Any]:
        # Another process makes its own: some classes of models exist only where a case is.
        return {name: value for name, value in vars(self).items() if name != "system"}

    @classmethod
    def of(cls, entries: Mapping[str, Any], name: str = "case") -> "Case":
        """The case that these keys of a case file describe, with every default filled in.

        Raises HodoError, one line for each mistake: the key, and what is right.
        """
        try:
            if not isinstance(entries, Mapping):
                raise expected("a Case or a mapping of its keys to values", entries)
            return checked_case(name, Block(plain(entries)))
        except Wrong as error:
            raise HodoError(str(error)) from None

    @cached_property
    def system(self) -> Model:
        """The equations of its model with the numbers of this case.

        Raises HodoError if there is no such model.
        """
        return system_of(models.find(self.model, self.form), self.data)

    def rests_on(self, variable: str) -> bool:
        """Whether a variable of its model is stored, or quantities are that may follow from it."""
        stored = self.store or (variable,)
        return variable in stored or not self.system.variables.keys() >= {*stored}

    def leaves_out(self, lacks: Iterable[str]) -> bool:
        """Whether its `store:` is why it lacks some variables."""
        return bool(self.store) and self.system.variables.keys() >= {*lacks}

    @property
    def entries(self) -> dict[str, Any]:
        """The keys of a case file that describe it, complete, but for its name."""
        common = {name: key.kind.written(getattr(self, name)) for name, key in COMMON.items()}
        common["time"] = self.time.entries
        present = {k: value for k, value in common.items() if value != {}}
        entries = {"model": self.model, "form": self.form, **self.data, **present}
        return {key: _written(value) for key, value in entries.items() if value is not None}

    @cached_property
    def lines(self) -> Mapping[str, str]:
        """The case as YAML, complete: its lines by their keys. They are its text and, but for the
        remarks, its digest."""
        entries = {"name": self.name, **self.entries}
        return {key: f"{key}: {write(value)}\n" for key, value in entries.items()}


def dump(case: Case, remarks: bool = True) -> str:
    """The case as YAML, complete, one key a line; `parse_case` returns an equal case.

    Without `remarks` only the keys that decide its numbers are written.
    """
    return "".join(line for key, line in case.lines.items() if remarks or key not in REMARKS)


def parse_case(text: str) -> Case:
    """The case in a text written by `dump`. Raises HodoError, one line for each mistake."""
    return _read_as(text, lambda block: checked_case(block.pop("name", None), block))


def parse_axes(text: str) -> list[Axis]:
    """The axes of the case in such a text, none without a sweep; its model need not be there.
    Raises HodoError as `parse_case` does."""
    return _read_as(text, lambda block: axes_of(SWEEP.check(block.get("sweep", {}))))


_Taken = TypeVar("_Taken")


def _read_as(text: str, taken: Callable[[Block], _Taken]) -> _Taken:
    """What is taken of the mapping that a text holds. Raises HodoError as `parse_case` does."""
    mistakes = Mistakes("case")
    block = read_mapping(text, mistakes)
    mistakes.raise_any()
    try:
        return taken(block)
    except Wrong as error:
        add_mistakes(error.mistakes, block, mistakes)
        raise mistakes.error() from None


def read_mapping(text: str, mistakes: Mistakes) -> Block:
    """The mapping that a text holds. Raises HodoError if it holds anything else."""
    document = read(text, mistakes)
    if isinstance(document, Block):
        return document
    mistakes.fail(Place(1, 1), f"expected a mapping of keys to values, got {shown(document)}")


def _written(data: Any) -> Any:
    """Data as a case file says them: without the optional keys that are left out, and with the
    words yes and no."""
    if isinstance(data, bool):
        return "yes" if data else "no"
    if not isinstance(data, dict):
        return data
    return {key: _written(value) for key, value in data.items() if value is not None}


def add_mistakes(faults: Iterable[Mistake], document: Block, mistakes: Mistakes) -> None:
    """Add the faults within a document, with their places. What a case has inherited is called by
    its path in `defaults`."""
    for path, sentence in faults:
        place, inherited = locate(document, path)
        if isinstance(sentence, LeftOut):
            place, _ = locate(document, ("cases", sentence.case, "store"))
        mistakes.add(place, sentence, ("defaults", *path[2:]) if inherited else path)


def checked_case(name: Any, block: Block) -> Case:
    """The case that a merged block describes. Raises Wrong with all that is wrong with it."""
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise Wrong(((), f"{NAME_RULE}, not {shown(name)}"))
    model, keys = keys_in(block)
    values, mistakes = _values_of(block, model, keys)
    if model is None:
        raise Wrong(*mistakes)
    data = _data_of(model, values)
    system = _sound_system(model, data, values, mistakes)
    common = {key: values[key] for key in COMMON} | {"time": _sampled_time(system, values)}
    return Case(name=name, model=model.name, form=model.form, data=data, **common)


def _data_of(model: type[Model], values: Mapping[str, Any]) -> dict[str, Any]:
    """The data of a case of a model, among its values; those of the first member of a sweep."""
    # A case without an attitude is the same whether it says so or not.
    without = set() if values.get(ATTITUDE_KEY) else {ATTITUDE_KEY}
    data = {key: values[key] for key in keys_of_form(model) if key in values.keys() - without}
    return data | first_values(values.get("sweep") or {}, model, data)


def _sound_system(
    model: type[Model], data: Mapping[str, Any], values: Mapping[str, Any], known: Sequence[Mistake]
) -> Model:
    """The model with the data of a case. Raises Wrong with the mistakes that are known, and all
    that is wrong with the case as a whole."""
    mistakes = [*known]
    # What the case as a whole seems to lack may stand under a key that is misspelt or wrong.
    of_data = [*_data_mistakes(model, data, None if mistakes else values["time"])]
    mistakes += [mistake for mistake in of_data if mistake[0] or not mistakes]
    system = None if mistakes else system_of(model, data)
    mistakes += _store_mistakes(model, system, values)
    if system:
        mistakes += _method_mistakes(system, values)
    if system and values["sweep"] and not mistakes:
        mistakes += check_axes(values["sweep"], type(system), {**values, **data})
    if mistakes or system is None:
        raise Wrong(*mistakes)
    return system


def _sampled_time(system: Model, values: Mapping[str, Any]) -> Time:
    """The time of a case, with the number of samples that it does not name."""
    time, start, end = values["time"], values["time"]["start"], values["time"]["end"]
    if time["samples"] is not None:
        return Time(**time)
    number = FEWEST_SAMPLES if values["sweep"] else smooth_samples(system, end - start)
    return Time(**time | {"samples": min(number, most_samples(start, end))})


FEWEST_SAMPLES, MOST_SAMPLES = 1001, 50_001
"""The samples of a case that does not name their number."""

SAMPLE_TURN = math.radians(12)
"""The angle by which a hodograph may turn from one sample to the next; figures warn above 15
degrees."""

TURN_IN_SPACE = math.radians(6)
"""The same of what a body with an attitude carries along: a herpolhode fills its figure with few
turns, where corners of twice as many degrees are seen."""


def smooth_samples(system: Model, span: float) -> int:
    """The number of samples of a span that makes the hodograph of a body which turns as at the
    start a smooth line, and its curves in space where it has an attitude.

    The hodograph turns no faster than about the axis of the largest moment at the speed that all of
    the energy has about the axis of the smallest.
    """
    if system.no_axis_reason or not isinstance(system, BodyFrame) or system.is_quadrature:
        return FEWEST_SAMPLES
    A1, A2, A3 = sorted(system.moments.tolist(), reverse=True)
    # By ratios, since moments may be of any size.
    fastest = max((A1 - A2) / A2 * (A1 - A3) / A3, (A1 - A3) / A1 * (A2 - A3) / A2)
    omega = system.to_principal(np.array(system.start[:3])).tolist()
    parts = (math.sqrt(A / A3) * w for A, w in zip(system.moments.tolist(), omega, strict=True))
    speed = math.hypot(*parts)
    rotor: tuple[float, ...] = getattr(system, "rotor", None) or (0.0,)
    rate: float = speed * math.sqrt(fastest) + math.hypot(*rotor) / A3
    turns = max(
        rate / SAMPLE_TURN, speed / TURN_IN_SPACE if ATTITUDE_KEY in system.variables else 0
    )
    # First the least of the two: no integer is infinite.
    return max(FEWEST_SAMPLES, math.ceil(min(span * turns, MOST_SAMPLES - 1)) + 1)


MERGED_KEYS = ("time", "assumes")
"""The keys of which a case changes single entries, and takes the others over."""


def merged(common: Mapping[str, Any], own: Mapping[str, Any]) -> Block:
    """A case's own entries over those of `defaults` or of another case, which are marked as
    inherited."""
    block = Block(own).over(common)
    for key in MERGED_KEYS:
        ours, theirs = own.get(key), common.get(key)
        if isinstance(ours, Mapping) and isinstance(theirs, Mapping):
            block[key] = Block(ours).over(theirs)
            if key == "time":
                drop_replaced_times(block[key], ours)
    return block


def variation(case: Case, changes: Mapping[str, Any]) -> Case:
    """A case with other values at some keys, under its own name. Raises Wrong with all that is
    wrong with these."""
    return checked_case(case.name, merged(case.entries, changes))


def _data_mistakes(
    model: type[Model], data: Mapping[str, Any], time: Mapping[str, Any] | None
) -> Iterator[Mistake]:
    """The mistakes of data that are each right by themselves, and over a span, if one is given."""
    model_data = {key: value for key, value in data.items() if key != ATTITUDE_KEY}
    mistakes = [*model.check(model_data), *check_attitude(model, data)]
    yield from mistakes
    if time and not mistakes:
        yield from model.check_span(model_data, time["start"], time["end"])


def _method_mistakes(system: Model, values: Mapping[str, Any]) -> Iterator[Mistake]:
    """Why a case cannot be integrated, as far as its keys and its equations tell."""
    is_exact, takes_steps = values["method"] == "exact", values["time"]["steps"]
    of_equations = models.mistake_in(system)
    of_precision = wrong_precision(values["method"], values["precision"])
    # Equations with a mistake may have it in their events.
    of_events = "" if of_equations else finds_no_stop(values["method"], system)
    return mistakes_where(
        (of_equations, ("model",), of_equations),
        (of_precision, ("precision",), of_precision),
        (of_events, ("method",), of_events),
        (is_exact and not system.has_closed_form, ("method",), NO_CLOSED_FORM),
        (
            values["method"] == "quadrature" and not system.is_quadrature,
            ("method",),
            "method quadrature is that of bodies averaged over their turns",
        ),
        (
            system.is_quadrature
            and (
                takes_steps
                or values["method"] not in ("auto", "quadrature")
                or values["precision"] != "double"
            ),
            ("form",),
            NO_RATES,
        ),
        (
            is_exact and takes_steps,
            ("time", "steps"),
            "the closed form takes no steps: name samples, or a method",
        ),
        (
            values["sweep"] and takes_steps,
            ("time", "steps"),
            "the members of a sweep have one list of times",
        ),
    )


def _store_mistakes(
    model: type[Model], system: Model | None, values: Mapping[str, Any]
) -> Iterator[Mistake]:
    """The mistakes in `store:`: variables that the case does not have, and quantities that do not
    follow from them. Without a system it is not known which do."""
    # The class that stands in for a form with these data has other variables than the form.
    form, is_swept = type(system) if system else model, bool(values.get("sweep"))
    valid = storable(form) if is_swept else list(form.variables)
    sources = {*form.variables, *(constants_of(system, values) if system else ())}
    for i, name in enumerate(values.get("store", ())):
        # A mistaken attitude makes no system, and would be stored if it were right.
        if name in valid or (name == ATTITUDE_KEY and system is None):
            continue
        if name == ATTITUDE_KEY and takes_attitude(form):
            yield ("store", i), f"this case has no attitude{remedy_of([ATTITUDE_KEY])}"
        elif name not in DERIVED:
            derived = [] if is_swept else derivable(sources)
            yield ("store", i), unknown(f"variable {name!r}", name, [*valid, *derived])
        elif is_swept:
            yield ("store", i), f"figures and averages derive {name} of what a sweep stores"
        elif system and (lacks := missing(name, sources)):
            needed = f"{' and '.join(lacks)}, which this case does not have"
            yield ("store", i), f"{name} needs {needed}{remedy_of(lacks)}"


def _values_of(
    block: Block, model: type[Model] | None, keys: Mapping[str, Key]
) -> tuple[dict[str, Any], list[Mistake]]:
    """The values of a case by its keys, and the mistakes in them; a key of another form is one.

    Left out besides are defaults that its model does not take; the keys of every model where none
    is named; and all keys of a model that is not known, which may be its own.
    """
    entries: dict[str, Any] = {}
    mistakes: list[Mistake] = []
    for key, value in block.items():
        if key in keys:
            entries[key] = value
        elif key in FORMER_KEYS:
            mistakes.append(((WrongKey(key),), FORMER_KEYS[key]))
        elif key in block.inherited or (model is None and ("model" in block or key in all_keys())):
            continue
        elif model and (takers := _takers(model, key)):
            # Likeness alone would take one model's key for another's: torque for store.
            word = other_word(key, keys)
            hint = f"; did you mean {word!r}?" if word else ""
            mistakes.append(((WrongKey(key),), f"is a key of {takers}{hint}"))
        else:
            entries[key] = value  # a key of no model, which is refused as unknown
    values, more = check_keys(keys, entries)
    data = {key: value for key, value in entries.items() if key in keys.keys() - LIMITS}
    return values, [*mistakes, *more, *_size_mistakes(data)]


SMALLEST_SIZE = 1e-154
"""The smallest size of a number of a case, if it is not 0, and the inverse of the largest one: the
squares of both are doubles. Units near a motion's own need nothing beyond."""

LIMITS = {"tol", "max_seconds", "max_steps"}
"""The keys whose numbers are no data."""


def _size_mistakes(value: Any, path: KeyPath = ()) -> Iterator[Mistake]:
    """The mistake of each number within data whose size is out of range; what stands within an
    expression is not looked at."""
    parts: Iterable[tuple[Any, Any]] = ()
    if isinstance(value, Mapping):
        parts = value.items()
    elif is_list(value):
        parts = enumerate(value)
    elif size := abs(as_finite(value) or 0.0):
        yield from ((path, words) for words in range_mistake(size, SMALLEST_SIZE))
    for key, part in parts:
        yield from _size_mistakes(part, (*path, key))


def _takers(model: type[Model], key: str) -> str:
    """The forms of a model that take a key or, if there is none, the models."""
    takers = {
        name: [form for form, form_class in forms.items() if key in keys_of_form(form_class)]
        for name, forms in models.catalogue().items()
    }
    if forms := takers[model.name]:
        return f"form {' or '.join(forms)}, and this is form {model.form}"
    names = [name for name, forms in takers.items() if forms]
    return f"model {' or '.join(names)}, and this is model {model.name}" if names else ""
