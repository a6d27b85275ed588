"""Cases: from the entries of a case file to frozen, checked records, and back.

The keys of a case are `model`, `form`, the keys of its model's form, and COMMON. The first of these
that gives a value counts: an override (`--set`), the case, the file's `defaults:`, the key's own
default.
"""

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Never

import numpy as np

from .. import HodoError, models
from ..models.attitude import check_attitude, keys_of_form, takes_attitude
from ..models.base import ATTITUDE_KEY, CONSTANTS_KEY, Equations, Model
from ..models.rigid_body import BodyFrame, is_rounded, range_mistake
from ..models.terms.time_laws import expressions_of, name_mistakes
from ..quantities import QUANTITIES, constants_of, derivable, missing, remedy_of
from ..schema.document import Source, read_mapping, write
from ..schema.expression import names_in, parse_expression
from ..schema.kinds import (
    KeyPath,
    Mistake,
    Wrong,
    WrongKey,
    as_finite,
    check,
    check_keys,
    expected,
    leaves,
    mistakes_where,
    unknown_names,
)
from ..schema.spelling import other_word, shown
from ..text import time_text
from .keys import (
    COMMON,
    FORMER_KEYS,
    MERGED_KEYS,
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
from .sweep_block import SWEEP, Axis, axes_of, check_axes, first_values, given, storable

# The name is safe as a group of HDF5 (no slash), as a file, and in a shell; a leading `_` is kept
# for groups that are no cases.
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
NAME_RULE = (
    "a name is up to 100 of the characters A-Z a-z 0-9 . _ - and begins with a letter or digit"
)


class FrozenDict(dict[str, Any]):
    """A dict that cannot be changed, so that an object that holds it can be a key of another
    dict."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))

    def __reduce__(self) -> Any:
        return FrozenDict, (dict(self),)  # or else pickle fills it entry by entry

    def _refuse(self, *_: Any, **__: Any) -> Never:
        raise TypeError("the data of a case do not change: make another with dataclasses.replace")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse


def frozen(value: Any) -> Any:
    """Plain data with every mapping frozen and every list a tuple."""
    if isinstance(value, FrozenDict):
        return value
    if isinstance(value, Mapping):
        return FrozenDict({key: frozen(item) for key, item in value.items()})
    return tuple(map(frozen, value)) if isinstance(value, list | tuple) else value


def as_plain(value: Any) -> Any:
    """Arrays of numpy, tuples and ranges as lists, and numpy's numbers as Python's."""
    if isinstance(value, Mapping):
        return {str(key): as_plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return (value.astype(float) if value.dtype.kind == "f" else value).tolist()
    return [as_plain(item) for item in value] if isinstance(value, list | tuple | range) else value


@dataclass(frozen=True, kw_only=True)
class Time:
    """The time span of a case, with its samples: evenly spaced, or listed in `values`."""

    start: float = 0.0
    end: float
    samples: int = 1001
    unit: str = "1"
    values: tuple[float, ...] | None = None
    epoch: float | None = None
    mirrored: bool = False

    def __post_init__(self) -> None:
        if self.start == self.end:
            object.__setattr__(self, "samples", 1)

    @property
    def entries(self) -> dict[str, Any]:
        """The span as keys of a case file."""
        span = ("values",) if self.values else ("end", "samples")
        epoch = () if self.epoch is None else ("epoch",)
        return {key: getattr(self, key) for key in ("start", *span, *epoch, "unit")}

    def text(self, time: float, digits: int = 6) -> str:
        """A time of the motion as text, with `digits` digits of the time since the start."""
        sign = -1 if self.mirrored else 1  # a mirrored span counts -t
        return time_text(sign * time, sign * self.start, digits)

    @property
    def runs_backward(self) -> bool:
        """Whether the end is before the start."""
        return self.end < self.start

    @property
    def rising(self) -> "Time":
        """The span in the time -t, mirrored: it rises where this one falls."""
        values = self.values and tuple(-time for time in self.values)
        return replace(self, start=-self.start, end=-self.end, values=values, mirrored=True)

    def listed(self, times: np.ndarray) -> "Time":
        """The same span with samples at exactly these times (n,)."""
        values = tuple(times.tolist())
        return replace(self, end=values[-1], samples=len(values), values=values)

    def resampled(self, samples: int) -> "Time":
        """The same span with `samples` evenly spaced samples."""
        return replace(self, samples=samples, values=None)


@dataclass(frozen=True)
class Case:
    """One experiment, complete: `data` holds the keys of its model's form, every default filled in.

    A case can be a key of a dictionary. Any mapping may be given as `data`; it is frozen.
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
        """Refuse a single mapping, which a notebook may try. Raises HodoError."""
        if positional and isinstance(positional[0], Mapping):
            raise HodoError("Case.of makes a case of a mapping")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for name in ("data", "sweep", "store", "assumes"):
            # This is how a frozen dataclass sets its fields.
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "system"}

    @classmethod
    def of(cls, entries: Mapping[str, Any], name: str = "case") -> "Case":
        """The case that these keys of a case file describe, with every default filled in.

        Raises HodoError with one line for each mistake: the key, and what is right.
        """
        try:
            if not isinstance(entries, Mapping):
                raise expected({"title": "a Case or a mapping of its keys to values"}, entries)
            return checked_case(name, as_plain(entries))
        except Wrong as error:
            raise HodoError(str(error)) from None

    @cached_property
    def system(self) -> Model:
        """The model's object for the numbers of this case. Raises HodoError if no such model is
        loaded."""
        form = models.find(self.model, self.form)
        return form.of(self.data, self.time.epoch, self.time.mirrored)

    def rests_on(self, variable: str) -> bool:
        """Whether the case stores a variable of its model, or a quantity that may need it."""
        stores_quantities = not self.system.equations.variables.keys() >= {*self.store}
        return not self.store or variable in self.store or stores_quantities

    def leaves_out(self, lacks: Iterable[str]) -> bool:
        """Whether variables are missing because `store:` does not name them."""
        return bool(self.store) and self.system.equations.variables.keys() >= {*lacks}

    @property
    def entries(self) -> dict[str, Any]:
        """The keys of a case file that describe the case, without its name."""
        common = {name: getattr(self, name) for name in COMMON} | {"time": self.time.entries}
        present = {k: value for k, value in common.items() if value != {}}  # an empty `assumes`
        return dict(given({"model": self.model, "form": self.form, **self.data, **present}))

    @cached_property
    def lines(self) -> Mapping[str, str]:
        """The lines of the case as YAML, by key. Lines of remarks do not enter its digest."""
        return {
            key: f"{key}: {write(value)}\n"
            for key, value in {"name": self.name, **self.entries}.items()
        }


def dump(case: Case, remarks: bool = True) -> str:
    """The case as YAML, one key a line; `parse_case` returns an equal case.

    Without `remarks` only the keys that determine its numbers are written.
    """
    return "".join(line for key, line in case.lines.items() if remarks or key not in REMARKS)


def parse_case(text: str) -> Case:
    """The case in a text that `dump` has written. Raises HodoError, one line for each mistake."""
    source = Source("case")
    entries = dict(read_mapping(text, source))
    source.raise_any()
    try:
        return checked_case(entries.pop("name", None), entries)
    except Wrong as error:
        note_all(error.mistakes, source)
        raise source.error() from None


def parse_axes(text: str) -> list[Axis]:
    """The axes of the sweep in a text that `dump` has written, empty for a single case; its model
    need not be loaded."""
    sweep = read_mapping(text, Source("case")).get("sweep")
    return axes_of(check(SWEEP, sweep) if sweep else {})


def note_all(faults: Iterable[Mistake], source: Source) -> None:
    """Note the faults at their places in a document. A fault in an inherited value is named by its
    path in `defaults`."""
    for path, sentence in faults:
        if override := _override_of(path, source):
            source.note(override, sentence, path)
            continue
        is_inside = path[:1] == ("cases",) and len(path) > 2
        if is_inside and _is_inherited(source.document, *path[1:]):
            path = ("defaults", *path[2:])
        source.note(source.locate(path), sentence, path)


def _override_of(path: KeyPath, source: Source) -> str:
    """The override that has set the wrong value at a path; an empty string if none has."""
    parts, set_by = tuple(map(str, path)), source.overridden
    texts = [set_by[parts[:n]] for n in range(len(parts), 2, -1) if parts[:n] in set_by]
    if path and isinstance(path[-1], WrongKey):
        # An override of KEY.PART makes a KEY that was not there.
        texts += [text for at, text in set_by.items() if at[: len(parts)] == parts]
    return next(iter(texts), "")


def _is_inherited(document: Any, case: Any, *path: Any) -> bool:
    """Whether a case takes the value at a path of its entries from `defaults`."""
    own, common = document["cases"].get(case), document.get("defaults")
    # Only a merged key is inherited in parts, which are one level deep.
    for key in path[: 1 + (path[0] in MERGED_KEYS)]:
        if not isinstance(own, Mapping) or not isinstance(common, Mapping) or key not in common:
            return False
        if key not in own:
            return True
        own, common = own[key], common[key]
    return False


def checked_case(name: Any, block: Mapping[str, Any], inherited: Collection[str] = ()) -> Case:
    """The case that merged entries describe. An inherited entry that its model does not take is
    ignored. Raises Wrong with all mistakes."""
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise Wrong(((), f"{NAME_RULE}, not {shown(name)}"))
    model, keys = keys_in(block)
    entries, foreign = _entries_of(model, keys, block, inherited)
    values, mistakes = check_keys(keys, entries)
    mistakes += foreign
    own = {key: x for key, x in entries.items() if key in keys and key not in LIMITS}
    # Numbers other than 0 whose size is out of range.
    sizes = [
        (path, words)
        for path, value in leaves(own)
        if (size := abs(as_finite(value) or 0.0))
        for words in range_mistake(size, SMALLEST_SIZE)
    ]
    if model is None:
        raise Wrong(*mistakes, *sizes)
    # A case without an attitude is the same whether it says so or not.
    without = set() if values.get(ATTITUDE_KEY) else {ATTITUDE_KEY}
    data = {key: values[key] for key in keys_of_form(model) if key in values.keys() - without}
    data |= first_values(values.get("sweep") or {}, model, data)
    of_data = [*_data_mistakes(model, data, None if mistakes or sizes else values["time"])]
    if data.get(CONSTANTS_KEY):
        data[CONSTANTS_KEY], unused = _constants_named(model, data, inherited)
        # An expression with a mistake may name the constants that seem unused.
        mistakes += () if mistakes or sizes or of_data else unused
    # A model's own range for a number is the narrower one.
    judged = {path for path, _ in of_data}
    mistakes += [mistake for mistake in sizes if mistake[0] not in judged]
    # A mistake without a path may be a missing key that is there under a misspelt name.
    mistakes += [mistake for mistake in of_data if mistake[0] or not mistakes]
    epoch = values["time"]["epoch"] if "time" in values else None
    system: Model | None = None if mistakes else model.of(data, epoch)
    if system and (of_equations := models.mistake_in(system)):
        mistakes, system = [(("model",), of_equations)], None
    mistakes += _store_mistakes(model, system, values)
    mistakes += _method_mistakes(system, values) if system else ()
    if values.get("sweep") and system and not mistakes:
        mistakes += check_axes(values["sweep"], system.equations, {**values, **data})
    if mistakes or system is None:
        raise Wrong(*mistakes)
    common = {key: values[key] for key in COMMON} | {"time": _sampled_time(system, values)}
    return Case(name=name, model=model.name, form=model.form, data=data, **common)


def _entries_of(
    model: type[Model] | None,
    keys: Collection[str],
    block: Mapping[str, Any],
    inherited: Collection[str],
) -> tuple[dict[str, Any], list[Mistake]]:
    """The entries of a case that are to be checked, unknown keys included, and a mistake for each
    key of another model or of an earlier version. Inherited keys that the model does not take are
    left out."""
    entries, foreign = {}, list[Mistake]()
    others: Collection[str] = ()
    if model is None:
        # An unknown model has keys of its own; without a model every key may be right.
        others = block if "model" in block else all_keys()
    for key, value in block.items():
        is_strange = key not in keys and key not in inherited and key not in others
        if is_strange and key in FORMER_KEYS:
            foreign.append(((WrongKey(key),), FORMER_KEYS[key]))
        elif is_strange and model and (takers := _takers(model, key)):
            # The nearest key would be misleading: store for torque.
            word = other_word(key, keys)
            hint = f"; did you mean {word!r}?" if word else ""
            foreign.append(((WrongKey(key),), f"is a key of {takers}{hint}"))
        elif key in keys or is_strange:
            entries[key] = value
    return entries, foreign


SMALLEST_SIZE = 1e-154
"""The smallest absolute value of a number of a case that is not 0; its inverse is the largest.
Their squares are doubles, and numbers in units near the motion's own need no wider range."""

LIMITS = {"tol", "max_seconds", "max_steps"}
"""The keys whose numbers are no data of the body or its torques, and may have any size."""


def _sampled_time(system: Model, values: Mapping[str, Any]) -> Time:
    """The time of a case, with the number of samples filled in."""
    time, start, end = values["time"], values["time"]["start"], values["time"]["end"]
    if time["samples"] is not None:
        return Time(**time)
    number = FEWEST_SAMPLES if values["sweep"] else smooth_samples(system, abs(end - start))
    return Time(**time | {"samples": min(number, most_samples(start, end))})


FEWEST_SAMPLES, MOST_SAMPLES = 1001, 50_001
SAMPLE_TURN, TURN_IN_SPACE = math.radians(12), math.radians(6)
"""The angles by which a hodograph, and curves in space, may turn from one sample to the next."""


def smooth_samples(system: Model, span: float) -> int:
    """The number of samples that draws a smooth hodograph of a body that turns as fast as at the
    start, and smooth curves in space if it has an attitude.

    The hodograph turns no faster than about the axis of the largest moment at the speed that the
    whole energy gives about the axis of the smallest moment.
    """
    if system.no_axis_reason or not isinstance(system, BodyFrame) or system.is_quadrature:
        return FEWEST_SAMPLES
    A1, A2, A3 = sorted(system.moments.tolist(), reverse=True)
    # Ratios, because moments may be of any size.
    fastest = max((A1 - A2) / A2 * (A1 - A3) / A3, (A1 - A3) / A1 * (A2 - A3) / A2)
    omega = system.start[:3]
    speed = math.hypot(
        *(math.sqrt(A / A3) * w for A, w in zip(system.moments.tolist(), omega, strict=True))
    )
    rotor: tuple[float, ...] = getattr(system, "rotor", None) or (0.0,)
    rate: float = speed * math.sqrt(fastest) + math.hypot(*rotor) / A3
    turns = max(rate / SAMPLE_TURN, speed / TURN_IN_SPACE if system.attitude else 0)
    # min() first, because an infinite number has no integer.
    return max(FEWEST_SAMPLES, math.ceil(min(span * turns, MOST_SAMPLES - 1)) + 1)


def merged(common: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of `defaults` or of another case (`common`), replaced by a case's own entries;
    an own entry without a value removes the common one."""
    entries = {k: v for k, v in {**common, **own}.items() if v is not None or k not in common}
    for key in MERGED_KEYS:
        own_part, common_part = own.get(key), common.get(key)
        if isinstance(own_part, Mapping) and isinstance(common_part, Mapping):
            entries[key] = merged(common_part, own_part)
            if key == "time":
                drop_replaced_times(entries[key], own_part)
    return entries


def inherited_keys(common: Mapping[str, Any], own: Mapping[str, Any]) -> set[str]:
    """The keys, and the names of constants, that a case does not give itself."""
    own_names, common_names = (
        {f"{CONSTANTS_KEY}.{path[0]}" for path, _ in leaves(entries.get(CONSTANTS_KEY)) if path}
        for entries in (own, common)
    )
    return {*(common.keys() - own), *(common_names - own_names)}


def variation(case: Case, changes: Mapping[str, Any]) -> Case:
    """A case with other values at some keys, under its own name. Raises Wrong."""
    entries = case.entries
    return checked_case(case.name, merged(entries, changes), inherited_keys(entries, changes))


def _expressions(model: type[Model], data: Mapping[str, Any]) -> Iterable[tuple[KeyPath, str]]:
    """The expressions of a case whose model takes constants, each with its path."""
    # Texts of the attitude and words of a choice are no expressions.
    others = {ATTITUDE_KEY, *(key for key, rule in model.keys.items() if "enum" in rule)}
    return expressions_of({k: value for k, value in data.items() if k not in others})


def _constants_named(
    model: type[Model], data: Mapping[str, Any], inherited: Collection[str]
) -> tuple[dict[str, float] | None, list[Mistake]]:
    """The constants that expressions of a case name, and a mistake for each unused constant that is
    not inherited."""
    constants, texts = data[CONSTANTS_KEY], (text for _, text in _expressions(model, data))
    named = set[str]().union(*(names_in(parse_expression(text)) for text in texts))
    unused = [name for name in constants if name not in named]
    mistakes: list[Mistake] = [
        ((CONSTANTS_KEY, WrongKey(name)), "no expression of the case names it")
        for name in unused
        if f"{CONSTANTS_KEY}.{name}" not in inherited
    ]
    return {name: x for name, x in constants.items() if name in named} or None, mistakes


def _data_mistakes(
    model: type[Model], data: Mapping[str, Any], time: Mapping[str, Any] | None
) -> Iterator[Mistake]:
    """The mistakes that only several keys of the data show together and, if a time span is given,
    those that the data make within it."""
    model_data = {key: value for key, value in data.items() if key != ATTITUDE_KEY}
    of_model = model.check(model_data)
    if is_rounded(data):
        # A single case is integrated with moments that rounding has made impossible; members of
        # sweeps with such moments are invalid.
        of_model = (mistake for mistake in of_model if mistake[0][:1] != ("inertia",))
    mistakes = [*of_model, *check_attitude(model, data)]
    if CONSTANTS_KEY in data:
        named, has_attitude = data[CONSTANTS_KEY] or {}, bool(data.get(ATTITUDE_KEY))
        mistakes += name_mistakes(_expressions(model, data), named, has_attitude)
    yield from mistakes
    if time and not mistakes:
        epoch, is_backward = time["epoch"] or 0.0, time["end"] < time["start"]
        yield from model.check_span(model_data, time["start"] - epoch, time["end"] - epoch)
        has_brake = data.get("brake") is not None
        if is_backward and (has_brake or "averaged" in model.form):
            what = "a brake" if has_brake else f"form {model.form}"
            yield ("time", "end"), f"a motion of {what} runs forward: take an end after the start"


def _method_mistakes(system: Model, values: Mapping[str, Any]) -> Iterator[Mistake]:
    """Why a case cannot be integrated, as far as its keys and its equations show."""
    is_exact, of_events = values["method"] == "exact", finds_no_stop(values["method"], system)
    of_precision = wrong_precision(values["method"], values["precision"])
    return mistakes_where(
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
            and (values["method"] not in ("auto", "quadrature") or values["precision"] != "double"),
            ("form",),
            NO_RATES,
        ),
        (
            values["sweep"] and values["time"]["end"] < values["time"]["start"],
            ("time", "end"),
            "a sweep runs forward: take an end after the start",
        ),
    )


def _store_mistakes(
    model: type[Model], system: Model | None, values: Mapping[str, Any]
) -> Iterator[Mistake]:
    """The mistakes in `store:`: variables that the case does not have; quantities that need
    variables that it does not have; and, in a sweep, all quantities that are no variables, because
    they are derived later. Without a system, because the case has other mistakes, neither the
    attitude nor what a quantity needs is checked."""
    form, is_swept = system.equations if system else Equations(model), bool(values.get("sweep"))
    valid = storable(form) if is_swept else list(form.variables)
    sources = {*form.variables, *(constants_of(system, values) if system else ())}
    for i, name in enumerate(values.get("store", ())):
        lacks = missing(name, sources) if name in QUANTITIES and system else []
        if name in valid or (name == ATTITUDE_KEY and system is None):
            continue
        if name == ATTITUDE_KEY and takes_attitude(model):
            yield ("store", i), f"this case has no attitude{remedy_of([ATTITUDE_KEY])}"
        elif name not in QUANTITIES:
            names = valid if is_swept else [*valid, *derivable(sources)]
            yield from unknown_names("variable", {("store", i): name}, names)
        elif is_swept or lacks:
            needed = (
                "figures and averages derive it"
                if is_swept
                else f"it needs {' and '.join(lacks)}{remedy_of(lacks)}"
            )
            yield ("store", i), f"{name} is not stored: {needed}"


def _takers(model: type[Model], key: str) -> str:
    """In words, the forms of a model that take a key or, if none does, the models that do."""
    takers = {
        name: [form for form, form_class in forms.items() if key in keys_of_form(form_class)]
        for name, forms in models.catalogue().items()
    }
    if forms := takers[model.name]:
        return f"form {' or '.join(forms)}, and this is form {model.form}"
    names = [name for name, forms in takers.items() if forms]
    return f"model {' or '.join(names)}, and this is model {model.name}" if names else ""
