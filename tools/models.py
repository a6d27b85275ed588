"""Print docs/models.md's account of the models: each form's docstring, in Markdown."""

import inspect
import re
import sys
import textwrap
from collections.abc import Iterator

from hodo_cli import models
from hodo_cli.models.base import Model


def markdown(docstring: str) -> str:
    """A docstring's paragraphs; those without a full stop are equations and keep their lines."""
    paragraphs = []
    for paragraph in docstring.split("\n\n"):
        if "=" in paragraph and not paragraph.endswith((".", ":")):
            paragraphs.append(f"```text\n{paragraph}\n```")
        else:
            # Products, powers and inequalities are no markup, nor is a minus that begins a line.
            text = re.sub(r"([*_<>])(?=[^`]*(?:`[^`]*`[^`]*)*$)", r"\\\1", paragraph)
            lines = textwrap.wrap(text, 118, break_long_words=False, break_on_hyphens=False)
            paragraphs.append("\n".join(re.sub(r"^([-+#])", r"\\\1", line) for line in lines))
    return "\n\n".join(paragraphs)


def accounts(cls: type[Model]) -> Iterator[str]:
    """The docstring of a form, and those of other classes that it names as taking its place."""
    docstring = inspect.getdoc(cls) or ""
    yield markdown(docstring)
    for name in re.findall(r"`([A-Z]\w+)`", docstring):
        named = getattr(sys.modules[cls.__module__], name, None)
        if isinstance(named, type) and issubclass(named, Model) and named is not cls:
            yield f"`{name}`: " + markdown(inspect.getdoc(named) or "")


def sections() -> Iterator[str]:
    """One section a model, one part a form; the first form is the default."""
    for name, forms in models.catalogue().items():
        yield f"## `model: {name}`"
        for form, cls in forms.items():
            if len(forms) > 1:
                default = " (the default)" if form == next(iter(forms)) else ""
                yield f"### `form: {form}`{default}"
            yield from accounts(cls)


if __name__ == "__main__":
    print("\n\n".join(sections()))
