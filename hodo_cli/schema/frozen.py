"""Plain data that cannot be changed."""

from collections.abc import Mapping
from typing import Any, Never


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
    if isinstance(value, Mapping):
        return FrozenDict({key: frozen(item) for key, item in value.items()})
    return tuple(map(frozen, value)) if isinstance(value, list | tuple) else value
