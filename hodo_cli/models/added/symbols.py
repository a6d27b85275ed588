"""Symbols that show which operations equations use, without an engine."""

from types import SimpleNamespace
from typing import Any

from ...arithmetic import SYMBOLS


class Symbol:
    """What stands in equations for a number and for all that engines put there: it knows what they
    all know, and no more."""

    __array_ufunc__ = None
    __hash__ = None  # type: ignore[assignment]

    def _result(self, *_: Any) -> "Symbol":
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = _result
    __truediv__ = __rtruediv__ = __pow__ = __rpow__ = __neg__ = _result

    def _undecided(self, *_: Any) -> Any:
        raise TypeError("which of two branches is taken must not depend on t, y or k")

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _undecided


SYMBOLS[Symbol] = SimpleNamespace(
    **dict.fromkeys(("sin", "cos", "exp", "log", "sqrt"), lambda x: x)
)
