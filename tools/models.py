"""Print docs/models.md's account of the models: each form's docstring, in Markdown."""

import inspect
import re
from collections.abc import Iterator

from hodo_cli import models


def markdown(docstring: str) -> str:
    """A docstring's paragraphs; those without a full stop are equations and keep their lines."""
    paragraphs = []
    for paragraph in docstring.split("\n\n"):
        if "=" in paragraph and not paragraph.endswith((".", ":")):
            paragraphs.append(f"```text\n{paragraph}\n```")
        else:
            # Products and powers are no emphasis.
            paragraphs.append(re.sub(r"([*_<>])(?=[^`]*(?:`[^`]*`[^`]*)*$)", r"\\\1", paragraph))
    return "\n\n".join(paragraphs)


def sections() -> Iterator[str]:
    """One section a model, one part a form; the first form is the default."""
    for name, forms in models.catalogue().items():
        yield f"## `model: {name}`"
        for form, cls in forms.items():
            if len(forms) > 1:
                yield f"### `form: {form}`" + (
                    " (the default)" if form == next(iter(forms)) else ""
                )
            yield markdown(inspect.getdoc(cls) or "")


if __name__ == "__main__":
    print("\n\n".join(sections()))
