"""The closed form as an engine: cases whose model has one."""

import numpy as np

from ..cases.case import Case


def applies(case: Case) -> bool:
    """Whether the case has a closed form here: torques along G, such as three equal dampings."""
    return case.system.has_closed_form


def exact_scaled(case: Case, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The states (n, m) of size about 1 at `times` (n,) of a case to which this `applies`, and the
    exponents (n,) of their units; in the precision of `times`."""
    return case.system.exact_states(times - case.time.start)
