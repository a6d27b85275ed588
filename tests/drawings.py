"""Results and the figures of their case files, as tests draw them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr
from click.testing import CliRunner

from hodo_cli import figures, open
from hodo_cli.cases.config import parse
from hodo_cli.cli import main


@dataclass
class Drawings:
    """The cases of a result, and the case file that it was made from."""

    cases: Mapping[str, xr.Dataset]
    config: Any

    @classmethod
    def of(cls, path: Path) -> "Drawings":
        cases = open(path)
        return cls(cases, parse(cases.attrs["config"], str(path)))

    @property
    def figures(self) -> dict[str, dict[str, Any]]:
        return self.config.figures

    def draw(self, figure: str | Mapping[str, Any], **changes: Any) -> Any:
        """A figure by its name or its keys, some of them changed."""
        spec = self.figures[figure] if isinstance(figure, str) else figure
        return figures.draw({**spec, **changes}, self.cases, self.figures)

    def render(self, name: str, formats: tuple[str, ...], out: Path) -> Any:
        return figures.render(self.cases, self.figures, name, formats, out)


def drawings_of(text: str, folder: Path, name: str = "test") -> Drawings:
    """The cases of a case file with this text, run and classified in a folder."""
    config, result = folder / f"{name}.yaml", folder / f"{name}.h5"
    config.write_text(text, encoding="utf-8")
    for arguments in (
        ["run", str(config), "--quiet", "--out", str(folder)],
        ["classify", str(result)],
    ):
        done = CliRunner().invoke(main, arguments)
        assert done.exit_code == 0, done.output
    return Drawings.of(result)
