"""The text of a model that is not hodo's, and of what it imports from its own folder."""

import ast
import hashlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import NamedTuple


class AddedModule(NamedTuple):
    """A module with models that are not hodo's: where it comes from, the module, and the text of
    its file and of the files that it imports from its own folder, by their paths from there."""

    origin: str
    module: ModuleType
    texts: dict[str, bytes]

    @property
    def digest(self) -> str:
        """The digest of all the texts."""
        return hashlib.sha256(repr(sorted(self.texts.items())).encode()).hexdigest()

    @property
    def source(self) -> str:
        """The texts for a reader, each below its file's path."""
        return "\n".join(
            f"# {path}\n{text.decode(errors='replace')}" for path, text in self.texts.items()
        )


def texts_of(path: Path, text: bytes, module: str = "") -> dict[str, bytes]:
    """The text of a file, and those of the files that it imports from its own folder, and these in
    turn; by their paths from that folder.

    `module` is the dotted name of a module of an installed package: what it imports from this
    package counts, and not what other packages have beside it.
    """
    depth = module.count(".") + (bool(module) and path.name == "__init__.py")
    folder, package = path.resolve().parents[depth], module.partition(".")[0]
    texts: dict[str, bytes] = {}
    waiting = [(path.resolve(), text)]
    while waiting:
        file, text = waiting.pop()
        name = file.relative_to(folder).as_posix()
        if name in texts:
            continue
        texts[name] = text
        for imported in _imports(text, file.relative_to(folder).parent.parts):
            if imported[0] == package if package else imported[0] != "hodo_cli":
                waiting += [(source, source.read_bytes()) for source in _files(folder, imported)]
    return texts


def _imports(text: bytes, package: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """The parts of the names of all modules that a text may import, in functions too; `package` is
    that of the text's own module."""
    tree = ast.Module([], [])
    with suppress(SyntaxError):  # of a file that is not imported after all
        tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (tuple(alias.name.split(".")) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            named = tuple(filter(None, (node.module or "").split(".")))
            # What is imported from a package may be a module of it.
            yield from ((*base, *named, alias.name) for alias in node.names)


def _files(folder: Path, name: tuple[str, ...]) -> Iterator[Path]:
    """The files in a folder that importing a module runs: its own, and those of its packages."""
    for i in range(1, len(name) + 1):
        module = folder.joinpath(*name[:i])
        for file in (module.with_suffix(".py"), module / "__init__.py"):
            if file.is_file():
                yield file
