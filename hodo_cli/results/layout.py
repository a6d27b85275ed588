"""The layout of a case in a result file: the variables and attributes that any model's case may
have, and their units.

A case is a group. The model names what the integration stores (its `variables`). Labels, crossings,
events, the columns of a sweep and the attributes are named below. Their writers name the others:
the quantiles of a sweep's errors (`sweeps.summary`), verdicts (`commands.claims`), checksums and
the attributes of the file (`storage`).
"""

import math
import re
import warnings
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .. import models
from ..cases.case import Case, dump
from ..engines.protocol import Status
from ..integration import Crossing, Occurrence
from ..models.attitude import CONVENTION
from ..models.base import ATTITUDE_VARIABLE, Label
from ..models.rigid_body import LABELS
from ..quantities import BODY_AXES, MOMENTUM, PARTS, SPACE_AXES
from ..storage import Attribute, Variable

# Units: products of powers of the units that a case gives

INERTIA, TIME_WORD = "moment of inertia", "time"
"""The words that models, keys and stored names use for the units of a case."""

FACTOR = re.compile(r"([^\W\d_]+|°|%)(?:\^?(-?\d+))?")
"""A unit with its power: s, m^2, m2."""


def units_of_case(stated: str, case: Case) -> str:
    """Units in words, such as "moment of inertia / time^2", in the units of a case, such as "kg
    m^2/s^2"; other units stay as they are."""
    case_units = {"inertia": case.inertia_unit, TIME_WORD: case.time.unit}
    powers = factors(stated.replace(INERTIA, "inertia"))
    if not powers.keys() & case_units.keys():
        return stated
    if len(powers) == 1 and 1 in powers.values():
        return case_units[next(iter(powers))]  # as it is spelled
    total: Counter[str] = Counter()
    for word, power in powers.items():
        for unit, of_unit in factors(case_units.get(word, word)).items():
            total[unit] += power * of_unit
    return product_text(total)


STATED_UNITS = re.compile(rf" \[((?:{INERTIA}|{TIME_WORD})[^\]]*)\]")
"""Units in words after a number in a sentence: "turns in 12.5 [time]"."""


def sentence_of_case(sentence: str, case: Case) -> str:
    """A sentence of a model, with the words for units replaced by the units of a case."""

    def unit(match: re.Match[str]) -> str:
        units = units_of_case(match[1], case)
        return "" if units == "1" else f" {units}"

    return STATED_UNITS.sub(unit, sentence)


def factors(text: str) -> dict[str, int]:
    """The powers of the units in a product such as "kg m^2/s"; none in "1". Text that is no product
    counts as one unit."""
    powers: Counter[str] = Counter()
    for position, product in enumerate(text.split("/")):
        for word in re.split(r"[\s*·.]+", product.strip()):
            if word == "1":
                continue
            if not (factor := FACTOR.fullmatch(word)):
                return {f"({text})": 1}
            powers[factor[1]] += (-1 if position else 1) * int(factor[2] or 1)
    return powers


def product_text(powers: dict[str, int]) -> str:
    """A product of units as UDUNITS reads it, with at most one divisor: "kg m^2/s"."""
    above = [power_text(unit, power) for unit, power in powers.items() if power > 0]
    below = [(unit, -power) for unit, power in powers.items() if power < 0]
    if len(below) == 1:
        return f"{' '.join(above) or '1'}/{power_text(*below[0])}"
    return " ".join([*above, *(power_text(unit, -power) for unit, power in below)]) or "1"


def power_text(unit: str, power: int) -> str:
    """A unit with its power."""
    return unit if power == 1 else f"{unit}^{power}"


# Attributes

ATTRIBUTES = {
    "model": str,
    "form": str,
    "case": str,
    "hash": str,
    "method": str,
    "method_reason": str,
    "tol": float,
    "steps": int,
    "run_time": float,
    "error": float,
    "error_kind": str,
    "status": str,
    "message": str,
    "warnings": str,
}
"""The attributes of every stored case; `case` is its text, `run_time` in seconds."""


MODEL_SOURCE = "model_source"
"""The attribute with the source of a model of the user's own."""


def typed_as(*names: str) -> dict[str, type]:
    """Some of the attributes with their types."""
    return {name: ATTRIBUTES[name] for name in names}


SUMMARY = typed_as(
    "model", "form", "method", "steps", "run_time", "error", "status", "message", "warnings"
)
"""The attributes that a case's line in a table shows."""

RECORDED = typed_as("case", "method", "tol", "error")
"""The attributes on which the classification of a stored case depends."""

SHOWN_ATTRIBUTES = SUMMARY | typed_as("case", "error_kind")
"""The attributes on which figures and their page depend."""


def case_attributes(case: Case, digest: str, **others: Any) -> dict[str, Attribute]:
    """The attributes of a stored case: `digest` is its hash, `others` are the rest by name. The
    source of a model of the user's own is added.

    Raises KeyError if one of `ATTRIBUTES` is missing.
    """
    if source := models.added_source(case.model):
        others[MODEL_SOURCE] = source
    attributes = {
        "model": case.model,
        "form": case.form,
        "case": dump(case),
        "hash": digest,
    } | others
    return {name: attributes[name] for name in [*ATTRIBUTES, *others]}


# Variables


class Stored(NamedTuple):
    """How a variable is stored: its meaning, type, dimensions and units in words."""

    long_name: str
    dims: tuple[str, ...] = ()
    dtype: str = "f8"
    units: str = "1"
    flags: Mapping[str, Attribute] = {}

    def holding(self, data: Any, **more: Attribute) -> Variable:
        """The values, labelled; texts are kept as they are, numbers get the declared type."""
        values = np.asarray(data, dtype=object if self.dtype == "O" else self.dtype)
        return Variable(self.dims, values, self.attrs | more)

    @property
    def attrs(self) -> dict[str, Attribute]:
        """The attributes of the variable; a text has no units."""
        units: dict[str, Attribute] = {} if self.dtype == "O" else {"units": self.units}
        return {"long_name": self.long_name, **units, **self.flags}


def flags(meanings: Mapping[int, str]) -> dict[str, Attribute]:
    """The attributes by which CF explains the integers of a variable."""
    return {
        "flag_values": np.array(list(meanings), dtype=np.int8),
        "flag_meanings": " ".join(meanings.values()),
    }


AXIS_FLAGS = flags(LABELS)

INNER_COORDINATES = {
    "axis": (Stored("principal axis of inertia", ("axis",), "O"), [*BODY_AXES]),
    "quaternion": (Stored("part of a quaternion", ("quaternion",), "O"), [*PARTS["quaternion"]]),
    "principal": (Stored("principal axis of inertia", ("principal",), "O"), [*BODY_AXES]),
    "space": (Stored("axis of space", ("space",), "O"), [*SPACE_AXES]),
}
"""The coordinates of variables with several numbers at a time, and their values."""

TIME = Stored("time", ("time",), units="time")


ENCLOSED_AXIS = Stored("axis that the hodograph of G encloses", ("time",), "i1", flags=AXIS_FLAGS)

CROSSING_COLUMNS = {
    "crossing_time": (
        "time",
        Stored("time of passage through the separatrix", ("crossing",), units="time"),
    ),
    "crossing_error": (
        "error",
        Stored("measured error of crossing_time", ("crossing",), units="time"),
    ),
    "crossing_from": (
        "start",
        Stored("axis enclosed before", ("crossing",), "i1", flags=AXIS_FLAGS),
    ),
    "crossing_to": ("end", Stored("axis enclosed after", ("crossing",), "i1", flags=AXIS_FLAGS)),
    "crossing_G": ("momentum", Stored("|G| at the passage", ("crossing",), units=MOMENTUM)),
}
"""The columns of crossings: which field of `Crossing` each holds, and how it is stored."""

EVENT_COLUMNS = {
    "event_time": ("time", Stored("time of the event", ("event",), units="time")),
    "event_error": ("error", Stored("measured error of event_time", ("event",), units="time")),
    "event_kind": ("kind", Stored("kind of the event", ("event",), "O")),
}
"""The columns of events: which field of `Occurrence` each holds, and how it is stored."""

EVENT_DETAILS = {
    "from": Stored("axis enclosed before the event", ("event",)),
    "G1": Stored("G/|G| along x1 as the body stops", ("event",)),
    "G2": Stored("G/|G| along x2 as the body stops", ("event",)),
    "G3": Stored("G/|G| along x3 as the body stops", ("event",)),
    "G_error": Stored("measured error of the direction of event_G1 to event_G3", ("event",)),
}
"""Further columns of events, `event_NAME` by the names in `Occurrence.details`; nan where an event
lacks the detail."""

MEMBER_CLASSIFIED = {
    "crossing_time": Stored("time of the first passage through the separatrix", units="time"),
    "crossing_error": Stored("error that crossing_time may have", units="time"),
    "crossing_from": Stored("axis enclosed before the crossing", (), "i1", flags=AXIS_FLAGS),
    "crossing_to": Stored("axis enclosed after the crossing", (), "i1", flags=AXIS_FLAGS),
    "crossing_G": Stored("|G| at the crossing", units=MOMENTUM),
    "crossings": Stored("number of passages", (), "i4"),
    "start_axis": Stored(
        "axis that the hodograph encloses at the start", (), "i1", flags=AXIS_FLAGS
    ),
    "end_axis": Stored("axis that the hodograph encloses at the end", (), "i1", flags=AXIS_FLAGS),
    "share": Stored("part of the span in which the hodograph encloses an axis", ("axis",)),
    "separation": Stored("smaller |D| of start and end, as a part of the sum of its terms"),
}
"""The columns of a sweep's members in models where a hodograph encloses an axis."""

MEMBER = {
    "steps": Stored("steps of the integration", (), "i4"),
    "status": Stored("how the member ended", (), "i1", flags=flags(dict(enumerate(Status)))),
}
"""The columns of every sweep."""

MEMBER_EVENT = {"event_time": Stored("time of the last event of the motion", units="time")}

MEMBER_STOPPED = {
    "event_time": Stored("time at which a brake stopped the body", units="time"),
    "event_from": Stored(
        "axis that the hodograph enclosed as the body stopped", (), "i1", flags=AXIS_FLAGS
    ),
    "event_release": Stored("time at which the body would move again", units="time"),
}
"""The columns of a sweep's members that may come to rest."""

ON_REQUEST = ("share", "separation", "steps", "event_release")
"""The columns of a sweep that are stored only where `store:` names them."""


AXIS_LABELS = ("crossing_from", "crossing_to", "start_axis", "end_axis", "event_from")
"""The variables of cases and sweeps that hold labels of axes, besides `enclosed_axis`."""

OLD_LABELS = (4, 5)
"""The labels of files of 0.2 for motions with a rotor: about both outer axes, and without a
separatrix."""


def without_old_labels(variables: Mapping[str, Variable]) -> Mapping[str, Variable]:
    """Stored variables with the labels of version 0.2 for motions with a rotor replaced by -1, with
    a warning if there are any."""
    labelled = {"enclosed_axis", *AXIS_LABELS} & variables.keys()
    old = {x for x in labelled if np.isin(variables[x].data, OLD_LABELS).any()}
    if old:
        remark = "the labels 4 and 5, of motions with a rotor, are read as -1 (undetermined)"
        warnings.warn(remark, stacklevel=3)
    replaced = {
        x: np.where(np.isin(variables[x].data, OLD_LABELS), -1, variables[x].data) for x in old
    }
    return {**variables, **{x: replace(variables[x], data=data) for x, data in replaced.items()}}


# Groups


def case_variables(
    labels: Mapping[str, Label],
    time: np.ndarray,
    values: Mapping[str, np.ndarray],
    events: Sequence[Occurrence],
    errors: Mapping[str, float],
) -> dict[str, Variable]:
    """The variables of a motion: the `values` of its model's variables over the times (n,), and
    the events.

    `labels` describe the model's variables; a label of `time` replaces the usual one. `errors` are
    the measured errors of some variables.
    """
    stored = {}
    for name, data in {"time": time, **values}.items():
        label = labels.get(name, TIME)
        error = {"error": errors[name]} if name in errors else {}
        # The values keep their own type, so that a working precision that netCDF lacks is refused.
        meanings = AXIS_FLAGS if name == "enclosed_axis" else {}
        if label == ATTITUDE_VARIABLE.get(name):
            meanings = {"convention": CONVENTION, "error_units": "rad"}
        attributes = {"long_name": label.long_name, "units": label.units, **error, **meanings}
        stored[name] = Variable(label.dims, data, attributes)
    stored |= inner_coordinates(stored.values())
    if events:
        stored |= columns_of(EVENT_COLUMNS, events)
    return stored | {
        f"event_{name}": detail.holding([event.details.get(name, math.nan) for event in events])
        for name, detail in EVENT_DETAILS.items()
        if any(name in event.details for event in events)
    }


def inner_coordinates(variables: Iterable[Variable]) -> dict[str, Variable]:
    """The coordinates `axis` and `quaternion`, if one of the variables has such a dimension."""
    dims = {dim for variable in variables for dim in variable.dims}
    return {
        name: stored.holding(words)
        for name, (stored, words) in INNER_COORDINATES.items()
        if name in dims
    }


def columns_of(
    table: Mapping[str, tuple[str, Stored]], items: Sequence[Crossing] | Sequence[Occurrence]
) -> dict[str, Variable]:
    """Crossings or events as variables, one for each field of the table."""
    return {
        name: stored.holding([getattr(item, field) for item in items])
        for name, (field, stored) in table.items()
    }


def label_variables(labels: np.ndarray, crossings: Sequence[Crossing]) -> dict[str, Variable]:
    """Labels (n,) and crossings of a motion."""
    return {"enclosed_axis": ENCLOSED_AXIS.holding(labels)} | columns_of(
        CROSSING_COLUMNS, crossings
    )


def with_units(variables: Mapping[str, Variable], case: Case) -> dict[str, Variable]:
    """Variables in the units of a case. For an averaged form, the long names of its own variables,
    of crossings and of a sweep's columns say that they are averaged."""
    own = {*case.system.equations.variables, *CROSSING_COLUMNS, *MEMBER_CLASSIFIED}

    def of_case(name: str, attrs: dict[str, Attribute]) -> dict[str, Attribute]:
        units = {"units": units_of_case(str(attrs["units"]), case)} if "units" in attrs else {}
        if case.system.is_quadrature and name in own:
            return {**attrs, **units, "long_name": f"{attrs['long_name']}, averaged to first order"}
        return {**attrs, **units}

    return {name: replace(x, attrs=of_case(name, x.attrs)) for name, x in variables.items()}
