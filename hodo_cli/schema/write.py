"""Plain data as YAML text that reads back as the same data."""

import json
import re
from typing import Any

from .document import resolve_scalar
from .kinds import shown


def write(value: Any) -> str:
    """A plain value as YAML in one line (flow style); numbers keep every bit. Tuples are written as
    lists."""
    match value:
        case dict():
            return (
                "{"
                + ", ".join(f"{write(str(key))}: {write(item)}" for key, item in value.items())
                + "}"
            )
        case list() | tuple():
            return "[" + ", ".join(map(write, value)) + "]"
        case None | bool() | int():
            return json.dumps(value)
        case float():
            return repr(value)
        case str():
            return (
                value
                if _PLAIN.fullmatch(value) and isinstance(resolve_scalar(value), str)
                else _quoted(value)
            )
    raise TypeError(f"no plain value: {shown(value)}")


# Only words that no reader, of YAML 1.1 or 1.2, could take for a number, a date or a comment.
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_.+-]*")
# Beside what is unprintable: line breaks of YAML 1.1 (85, 2028, 2029) and byte order marks.
_ESCAPED = re.compile(
    "[^\x20-\x7e\xa1-\u2027\u202a-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]"
)


def _quoted(text: str) -> str:
    text = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return '"' + _ESCAPED.sub(lambda match: f"\\u{ord(match[0]):04x}", text) + '"'
