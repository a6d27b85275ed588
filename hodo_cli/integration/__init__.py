"""One motion, without files: driven through an engine, its error measured, its crossings found.
Imports engines and what lies below."""

from .choice import AUTOMATIC, MIN_STIFF_STEPS, best, choose, taylor_steps
from .classify import (
    UNDECIDED,
    Classification,
    body_of,
    classify,
    cross,
    own_crossings,
)
from .crossings import (
    CERTAIN_ERRORS,
    Crossing,
    label_at_start,
    time_to_zero,
)
from .driver import Occurrence, at_rest
from .error import (
    error_of_variable,
    error_over_span,
    errors_against,
    references,
    thinned,
    time_error,
    with_measured_error,
)
from .integrate import (
    ERROR_LIMIT_ASKED,
    excess_remark,
    integrate,
    motion_remarks,
    solved,
)
from .solve import Trajectory, distinct, sample_times, solve

__all__ = [
    "AUTOMATIC",
    "CERTAIN_ERRORS",
    "ERROR_LIMIT_ASKED",
    "MIN_STIFF_STEPS",
    "UNDECIDED",
    "Classification",
    "Crossing",
    "Occurrence",
    "Trajectory",
    "at_rest",
    "best",
    "body_of",
    "choose",
    "classify",
    "cross",
    "distinct",
    "error_of_variable",
    "error_over_span",
    "errors_against",
    "excess_remark",
    "integrate",
    "label_at_start",
    "motion_remarks",
    "own_crossings",
    "references",
    "sample_times",
    "solve",
    "solved",
    "taylor_steps",
    "thinned",
    "time_error",
    "time_to_zero",
    "with_measured_error",
]
