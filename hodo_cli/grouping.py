"""What belongs together, in the order in which it came."""

from collections.abc import Hashable, Iterable
from typing import TypeVar

Kind = TypeVar("Kind", bound=Hashable)
Item = TypeVar("Item")


def grouped(pairs: Iterable[tuple[Kind, Item]]) -> dict[Kind, list[Item]]:
    """The items of each kind, from pairs of a kind and an item."""
    groups: dict[Kind, list[Item]] = {}
    for kind, item in pairs:
        groups.setdefault(kind, []).append(item)
    return groups
