"""Methods of integration with one protocol, one heavy library each. Imports cases and models;
knows neither files nor the purpose of a motion.

Each engine is imported at its first use, so that a command without heyoka does not load it.
"""

from importlib.util import find_spec

import numpy as np

from .. import HodoError
from ..models.base import Model, of_engine_time
from .protocol import Engine


def extended(values: np.ndarray) -> np.ndarray:
    """Values (...) of any precision as long doubles (...)."""
    if values.dtype.type in (np.float64, np.longdouble):
        return values.astype(np.longdouble, copy=False)
    from . import taylor

    return taylor.longdouble(values)


def have_taylor() -> bool:
    """Whether heyoka is installed."""
    return find_spec("heyoka") is not None


def have_quadruple() -> bool:
    """Whether heyoka is installed and was built with quadruple precision."""
    if not have_taylor():
        return False
    from . import taylor

    return "quadruple" in taylor.DTYPES


def check_heyoka(precision: str) -> None:
    """Raise HodoError unless heyoka is installed and has a precision."""
    # Only heyoka computes in quadruple precision, so no other method can replace it.
    is_quadruple = precision == "quadruple"
    if not have_taylor():
        needs = "precision quadruple" if is_quadruple else "method taylor"
        instead = "precision: extended" if is_quadruple else "method: auto"
        raise HodoError(
            f"{needs} needs heyoka, which is not installed: pip install heyoka, or {instead}"
        )
    if is_quadruple and not have_quadruple():
        raise HodoError(
            "precision quadruple needs heyoka with real128, which the installed one was built "
            "without: pip install 'heyoka>=7.13' on Linux, or precision: extended"
        )


def engine_for(
    method: str,
    system: Model,
    tol: float | None,
    precision: str,
    is_timed: bool = False,
) -> Engine:
    """The engine of a method, bound to the equations of a model. With `is_timed` the equations are
    functions of the engine's time. A Taylor engine is compiled here, once per process for all
    systems of one structure.

    The method must work in this precision. Raises HodoError if it needs a package that is not
    installed.
    """
    model = system.equations
    if is_timed:
        # The engine's time is 0 at the start of each stretch, and its unit fits the motion.
        model = of_engine_time(model)
    if method == "taylor":
        check_heyoka(precision)
        from . import taylor

        return taylor.compiled(model, tol, precision)
    if method == "collocation":
        from .collocation import Collocation

        return Collocation(model, tol, precision)
    from .scipy_ivp import Ivp

    return Ivp(method, model, tol)
