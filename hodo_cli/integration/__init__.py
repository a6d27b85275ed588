"""One motion, without files: driven through an engine, its error measured, its crossings found.
Imports engines and what lies below."""

from .choice import AUTOMATIC, best, choose, taylor_steps
from .classify import Classification, body_of, classify, cross, principal_omega
from .crossings import CERTAIN, Crossing, time_to_zero
from .error import errors_against, measured_error, references, thinned, time_error
from .integrate import ASKED, integrate, motion_remarks, solved
from .solve import refined, sample_times, solve
from .trajectory import Occurrence, Trajectory

__all__ = [
    "ASKED",
    "AUTOMATIC",
    "CERTAIN",
    "Classification",
    "Crossing",
    "Occurrence",
    "Trajectory",
    "best",
    "body_of",
    "choose",
    "classify",
    "cross",
    "errors_against",
    "integrate",
    "measured_error",
    "motion_remarks",
    "principal_omega",
    "references",
    "refined",
    "sample_times",
    "solve",
    "solved",
    "taylor_steps",
    "thinned",
    "time_error",
    "time_to_zero",
]
