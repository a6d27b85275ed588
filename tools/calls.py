"""Have the functions of a package note that they are called, in the processes and threads that
tests start too; `mutants.py` has each process load this module."""

import ast
import builtins
import os
from contextlib import suppress
from importlib.machinery import SourceFileLoader
from typing import Any

seen: set[str] = set()
"""The functions that this process has noted."""


def begin(package: str, notes: str) -> None:
    """From now on modules of the package (a folder) are loaded with a note at the head of each
    function, which adds the function's place to the notes (a file).

    A profiler hears of every call of every library; this costs a test next to nothing.
    """

    def __note_call__(place: str) -> None:
        if place in seen:
            return
        seen.add(place)
        # At once, and in one call: the process may be killed, and others write too. A test may have
        # limited the files of a process.
        with suppress(OSError):
            file = os.open(notes, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
            os.write(file, f"{place}\n".encode())
            os.close(file)

    plain = SourceFileLoader.source_to_code

    def with_notes(self: SourceFileLoader, data: Any, path: Any, **options: Any) -> Any:
        if not os.fspath(path).startswith(package):
            return plain(self, data, path, **options)
        tree = ast.parse(data)
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                line = ast.parse(f"{__note_call__.__name__}({f'{path}:{first_line(node)}'!r})").body
                behind = ast.get_docstring(node) is not None
                node.body[behind:behind] = line
        return plain(self, ast.fix_missing_locations(tree), path, **options)

    vars(builtins)[__note_call__.__name__] = __note_call__
    SourceFileLoader.source_to_code = with_notes  # type: ignore[method-assign]


def first_line(function: ast.FunctionDef) -> int:
    """As the interpreter counts: from the first decorator."""
    return min([function.lineno, *(item.lineno for item in function.decorator_list)])
