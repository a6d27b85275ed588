"""`hodo plot`: figures from result files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import HodoError
from ..figures import maps, plane, space
from ..figures.sheet import FORMATS, draw, save
from ..results.motion import Rendered, Results
from ..schema.kinds import nearest

KINDS_DRAWN_BY = (maps, plane, space)
"""The modules whose functions draw the kinds of figures; importing one enters its kinds into
`sheet.DRAW`."""


def render(
    results: Results, names: Sequence[str], formats: Sequence[str], out: Path
) -> list[Rendered]:
    """Draw the named figures of a result file (all, if none is named) into the folder `out`.

    A figure that cannot be drawn does not keep the others: its `problem` says why. Raises
    HodoError, before anything is drawn, for an unknown figure or format.
    """
    chosen = [(name, results.figure(name)) for name in names or results.figures]
    for wrong in (name for name in formats if name not in FORMATS):
        raise HodoError(
            f"unknown format {wrong!r}{nearest(wrong, FORMATS)} (valid: {', '.join(FORMATS)})"
        )
    out.mkdir(parents=True, exist_ok=True)
    return [
        _rendered(results, name, spec, [out / f"{name}.{suffix}" for suffix in formats])
        for name, spec in chosen
    ]


def _rendered(
    results: Results, name: str, spec: Mapping[str, Any], files: Sequence[Path]
) -> Rendered:
    try:
        sheet = draw(spec, results)
    except HodoError as error:
        return Rendered(name, problem=str(error))
    for path in files:
        save(sheet, path, about=spec["caption"])
    return Rendered(name, tuple(files))
