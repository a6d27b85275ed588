"""The closed form as an engine: cases of `linear-diag` with three equal dampings."""

import numpy as np

from ..cases.case import Case
from ..models.linear_diag import LinearDiag
from ..models.theory.closed_form import scaled_motion


def applies(case: Case) -> bool:
    """Whether the case has a closed form here: `linear-diag` with three equal dampings."""
    full = case.model == LinearDiag.name and case.form == LinearDiag.form
    return full and len(set(case.data["damping"])) == 1


def exact_scaled(case: Case, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The angular velocity at `times` (n,) of a case to which this `applies`, as a state (n, 3) of
    size about 1 and an exponent (n,); in the precision of `times`."""
    body = case.system
    assert isinstance(body, LinearDiag)
    A, omega0 = np.array(body.inertia), np.array(body.start)
    return scaled_motion(A, omega0, body.damping[0], times - case.time.start)
