"""Values that `--set` puts into the cases of a file."""

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

from .. import HodoError
from ..schema import kinds
from ..schema.document import Block, Items, Mistakes, Place, read
from ..schema.kinds import Kind, ListOf, Table
from .keys import keys_in


def apply_override(text: str, blocks: dict[str, Block], mistakes: Mistakes) -> None:
    """Apply one override to the blocks of the cases that it names."""
    place = Place(1, 1, text)
    target, equals, value = text.partition("=")
    parts = target.strip().split(".")
    if not equals or not 2 <= len(parts) <= 50:
        mistakes.add(place, "an override reads CASE.KEY=VALUE")
        return
    # Names of cases may contain points: the longest one that exists is meant.
    splits = ((".".join(parts[:n]), parts[n:]) for n in range(len(parts) - 1, 0, -1))
    named = ((names, path) for case, path in splits if (names := _matching(case, blocks)))
    names, path = next(named, ([], []))
    if not names:
        mistakes.add(place, kinds.unknown(f"case {parts[0]!r}", parts[0], blocks))
    try:
        new = read(value, mistakes, text)
    except HodoError:
        return
    for name in names:
        try:
            blocks[name] = _replaced(
                blocks[name], Table(keys_in(blocks[name])[1]), path, new, place
            )
        except ValueError as error:
            mistakes.add(place, str(error.args[0]), ("cases", name, *path))


def _matching(pattern: str, blocks: Mapping[str, Block]) -> list[str]:
    return (
        [pattern] if pattern in blocks else [name for name in blocks if fnmatchcase(name, pattern)]
    )


def _replaced(node: Any, kind: Kind | None, path: Sequence[str], new: Any, place: Place) -> Any:
    """A copy of a value with `new` at a path within it. Raises ValueError, with a sentence, if
    there is no such path.

    A number that stands for a vector of equal ones is written out where the path names one of them.
    """
    if not path:
        return new
    head, *tail = path
    if isinstance(node, int | float) and isinstance(kind, ListOf) and kind.takes(node):
        # `damping: 0.004` has no component 2 until it is written out.
        node = (node,) * (kind.length or 1)
    if kinds.is_list(node):
        if not head.isdecimal() or int(head) >= len(node):
            raise ValueError(
                f"there is no {head!r} in a list whose positions are 0 to {len(node) - 1}"
            )
        items, i = Items(node, getattr(node, "places", [place] * len(node))), int(head)
        items[i], items.places[i] = _replaced(node[i], None, tail, new, place), place
        return items
    if not isinstance(node, Block) and node not in (None, kinds.REQUIRED):
        raise ValueError(f"there is no {head!r} in {kinds.shown(node)}")
    block = Block(node) if isinstance(node, Block) else Block()
    key = kind.keys.get(head) if isinstance(kind, Table) else None
    old = block.get(head, key.default if key else None)
    value = _replaced(old, key.kind if key else None, tail, new, place)
    places = block.places[head] if tail and head in block else (place, place)
    block.put(head, value, *places)
    return block
