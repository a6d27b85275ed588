"""Case files: from YAML to frozen cases, checked, and back.

The keys of a case are `model`, `form`, those of its model's form, and COMMON. A value is taken from
the first of: an override (`--set`), the case, the file's `defaults:`, the key's own default. A
mistake is reported with its file, line, column, key and nearest spelling; all mistakes of a file
are raised together, as one HodoError with a line for each.
"""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Never

from .. import models
from ..models.base import Model
from ..schema import kinds
from ..schema.document import Block, locate, read
from ..schema.kinds import Key, Misnamed, Path, Report
from ..schema.mistakes import Mistakes, Place
from ..schema.write import write
from .keys import COMMON, REMARKS, all_keys, keys_in
from .sweep_block import check_axes, storable

# Safe as a group of HDF5 (no slash), as a file, and in a shell; `_` in front is kept for groups
# that are no cases.
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
NAME_RULE = (
    "a name is up to 100 of the characters A-Z a-z 0-9 . _ - and begins with a letter or digit"
)


@dataclass(frozen=True, kw_only=True)
class Time:
    """Span and number of samples of a case; a single sample is that at the end."""

    start: float = 0.0
    end: float
    samples: int = 1001
    unit: str = "1"


class FrozenDict(dict[str, Any]):
    """A dict that cannot be changed, so that it has a hash: what holds it can be a key itself."""

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
    if isinstance(value, Mapping):
        return FrozenDict({key: frozen(item) for key, item in value.items()})
    return tuple(map(frozen, value)) if isinstance(value, list | tuple) else value


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
    method: str = "auto"
    tol: float | None = None
    precision: str = "double"
    error: str = "on"
    store: tuple[str, ...] = ()
    max_seconds: float | None = None
    max_steps: int | None = None
    note: str = ""
    assumes: Mapping[str, str] = field(default_factory=dict)
    sweep: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        for name in ("data", "sweep", "store", "assumes"):
            # The way into a frozen dataclass.
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @cached_property
    def system(self) -> Model:
        """The equations of its model with the numbers of this case.

        Raises HodoError if there is no such model.
        """
        return models.find(self.model, self.form).of(self.data)


def dump(case: Case, remarks: bool = True) -> str:
    """The case as YAML, complete, one key a line; `parse_case` returns an equal case.

    Without `remarks`, what is left is what decides its numbers.
    """
    entries = {"name": case.name, "model": case.model, "form": case.form} | _without_none(case.data)
    common = {key: getattr(case, key) for key in COMMON if remarks or key not in REMARKS}
    common["time"] = asdict(case.time)
    entries |= {key: value for key, value in common.items() if value is not None and value != {}}
    return "".join(f"{key}: {write(value)}\n" for key, value in entries.items())


def parse_case(text: str) -> Case:
    """The case in a text written by `dump`. Raises HodoError, one line for each mistake."""
    mistakes = Mistakes("case")
    block = read_mapping(text, mistakes)
    name = block.pop("name", None)
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise mistakes.fatal(Place(1, 1), f"{NAME_RULE}, not {kinds.shown(name)}")
    case = checked_case(name, block, reporter(block, (), Place(1, 1), mistakes))
    mistakes.raise_any()
    assert case is not None
    return case


def read_mapping(text: str, mistakes: Mistakes) -> Block:
    """The mapping that a text holds. Raises HodoError if it holds anything else."""
    document = read(text, mistakes)
    if isinstance(document, Block):
        return document
    raise mistakes.fatal(
        Place(1, 1), f"wants a mapping of keys to values, not {kinds.shown(document)}"
    )


def _without_none(data: Any) -> Any:
    """Model data without the optional keys that are not given."""
    if not isinstance(data, dict):
        return data
    return {key: _without_none(value) for key, value in data.items() if value is not None}


def reporter(root: Block, label: Path, place: Place, mistakes: Mistakes) -> Report:
    """A report for paths within `root`, which stands at `place` and is called `label`."""

    def report(at: Path, message: str) -> None:
        found, inherited = locate(root, at, place)
        mistakes.add(found, ("defaults", *at) if inherited else (*label, *at), message)

    return report


def checked_case(name: str, block: Block, report: Report) -> Case | None:
    """The case that a merged block describes, or None after reporting what is wrong with it."""
    wrong = False

    def note(at: Path, message: str) -> None:
        nonlocal wrong
        wrong = True
        report(at, message)

    found, taken = keys_in(block)
    values = kinds.resolve(taken, _own(block, found, taken, note), (), note)
    data = {key: values[key] for key in found.keys if key in values} if found else {}
    if found:
        _cross_check(found, data, note)
        sweep = values.get("sweep")
        if sweep and not wrong:
            check_axes(sweep, found.keys, data, not found.unclassifiable, note)
        known = (
            storable(found.variables, not found.unclassifiable) if sweep else list(found.variables)
        )
        for i, kept in enumerate(values.get("store", ())):
            if kept not in known:
                note(("store", i), kinds.unknown(f"variable {kept!r}", kept, known))
    if "time" in values and not 0 <= values["time"]["end"] - values["time"]["start"] < float("inf"):
        note(
            ("time", "end"),
            f"the span from {values['time']['start']:g} to {values['time']['end']:g} is not possible",
        )
    if wrong or not found:
        return None
    common = {key: values[key] for key in COMMON} | {"time": Time(**values["time"])}
    return Case(name=name, model=found.name, form=found.form, data=data, **common)


def check_sweep(case: Case, sweep: Mapping[str, Any], report: Report) -> None:
    """Report what keeps a case from making a sweep that is not its own."""
    model = type(case.system)
    check_axes(sweep, model.keys, case.data, not model.unclassifiable, report)


def _cross_check(found: type[Model], data: Mapping[str, Any], report: Report) -> None:
    """A model's own check, which ends where it needs a value that has a mistake of its own."""
    try:
        for at, sentence in found.check(data):
            report(at, sentence)
    except KeyError:
        # With all keys there, a KeyError is a mistake of the model's, not of the case's.
        if data.keys() >= found.keys.keys():
            raise


def _own(
    block: Block, found: type[Model] | None, taken: Mapping[str, Key], report: Report
) -> dict[str, Any]:
    """The entries of a case that are to be resolved.

    Left out are defaults that its model does not take; keys of another form of the model, which are
    reported; and, where the model is not known, the keys of every model.
    """
    own = {}
    for key, value in block.items():
        forms = models.catalogue()[found.name].items() if found and key not in taken else ()
        others = [form for form, other in forms if key in other.keys]
        if key in taken:
            own[key] = value
        elif key in block.inherited or (found is None and key in all_keys()):
            continue
        elif found and others:
            report(
                (Misnamed(key),),
                f"is a key of form {' or '.join(others)}, and this is form {found.form}",
            )
        else:
            own[key] = value
    return own
