"""Whether earlier work is still right: a stored case, a config, and the digests on which the
findings of a command depend."""

import os
import warnings
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from shlex import quote

from .. import HodoError, models
from ..batch import CASE_SOURCES, PACKAGE, SWEEP_SOURCES, code_digest, digest, library_digest
from ..cases.case import Case, dump
from ..cases.config import Config, is_bare, load, parse, text_of
from ..machine import relative_path
from ..schema.document import YAML_SUFFIXES
from ..storage import CONTENT, FinishedCase, ResultFile, folder_of, result_of, root_attributes
from ..text import few

FORCED = "--force"

CONFIG_PATH = "config_path"
"""The attribute of a result that identifies its config among others of the same name."""

OVERRIDES = "overrides"
"""The attribute of a result with the changes that `--set` made to its config, a line each."""

# The order matters: another version of hodo may write the same case in other words.
RERUN_REASONS = (
    "the code that computes it has changed",
    "heyoka, numpy or scipy is another version",
    "its case has changed",
)


def case_digest(case: Case) -> str:
    """The three digests on which the result of a case depends: of the code of models, engines and
    integration (and of sweeps for a sweep), of the libraries, and of the case without its remarks.

    The method that `auto` takes follows from the three, so no integration is needed to know it.
    """
    code = code_digest(SWEEP_SOURCES if case.sweep else CASE_SOURCES, case.model)
    return "-".join((code, library_digest(), _bare_digest(case)))


def _bare_digest(case: Case) -> str:
    """The digest of a case without its remarks."""
    return digest(dump(case, remarks=False))


def rerun_reason(case: Case, done: FinishedCase | None, force: bool) -> str:
    """Why a case is to be run; an empty string if its stored result is still right."""
    if done is None:
        return "it has no result yet"
    status = str(done.attributes.get("status"))
    parts, stored_parts = case_digest(case).split("-"), str(done.attributes.get("hash")).split("-")
    # By slices, because a stored hash may have fewer parts.
    changed = [stored_parts[i : i + 1] != [part] for i, part in enumerate(parts)]
    reasons = (
        (force, FORCED),
        # A timeout may be due to another program's work, so failed cases are tried again.
        (status != "ok", f"its status is {status}"),
        *zip(changed, RERUN_REASONS, strict=True),
    )
    return next((reason for holds, reason in reasons if holds), "")


def result_named(name: Path) -> tuple[Path, Config | None]:
    """The result that a name means and, if it is the name of a config, that config.

    A config's result is in the folder `runs`. A bare name means a config, as in `load`. Raises
    HodoError if the config cannot be read, or has no result.
    """
    if not (is_bare(name) or name.suffix in YAML_SUFFIXES):
        return name, None
    config = load(name)
    path = result_of(config.path)
    # A run that was stopped may have left nothing but the folder of the result's parts.
    if not os.path.lexists(path) and not folder_of(path).exists():
        how = f"hodo run {quote(str(config.path))}"
        raise HodoError(f"{config.path} has no result {path}: {how} makes it")
    return path, config


def results_named(names: Iterable[Path]) -> Iterable[tuple[Path, Config | None]]:
    """The results that names mean, each once, with the config if one was named. Raises HodoError as
    `result_named` does."""
    results: dict[str, tuple[Path, Config | None]] = {}
    for path, config in map(result_named, names):
        place = os.path.realpath(path)
        if config or place not in results:
            results[place] = path, config
    return results.values()


def stored_config(run: ResultFile) -> Config:
    """The config that a result holds, with its overrides. Raises HodoError if it cannot be read, or
    there is none."""
    if not run.text:
        raise HodoError(f"{run.path} holds no case file")
    return parse(run.text, str(run.path), _overrides_of(run), stored=True)


def _overrides_of(run: ResultFile) -> list[str]:
    """The overrides with which a result was made."""
    return str(run.attributes.get(OVERRIDES, "")).splitlines()


def path_from(config: Config, path: Path) -> str:
    """The path of a config relative to the folder of its result: it stays right when a project is
    moved."""
    return relative_path(os.path.realpath(config.path), os.path.realpath(path.parent))


def place_of_config(run: ResultFile) -> str:
    """The path of a result's config, as the result states it."""
    # `realpath` resolves links first: `..` in a linked folder is the folder above its target.
    return os.path.realpath(run.path.parent / str(run.attributes.get(CONFIG_PATH, "")))


def attributes_by(command: str, config: Config) -> dict[str, str]:
    """The root attributes, with the config's overrides, of the result that a command makes of a
    config. The command is given with its arguments."""
    # One line for each override. To YAML a line break inside a value is the same as a space.
    overrides = "\n".join(" ".join(text.splitlines()) for text in config.overrides)
    more = {OVERRIDES: overrides}
    return root_attributes(f"hodo {command}", config.title, config.references, config.text, more)


def check_origin(config: Config, run: ResultFile, remedy: str = "") -> None:
    """Raise HodoError if a result was made from a config of the same name in another folder.

    A config with the same text is accepted: it may be a copy, or moved, and no content would be
    lost. A result of an early version, which does not state a folder, is accepted too.
    """
    origin = str(run.attributes.get(CONFIG_PATH, ""))
    if origin and origin != path_from(config, run.path) and run.text != config.text:
        made_from = relative_path(place_of_config(run), os.curdir)
        raise HodoError(
            f"{run.path} holds the results of {made_from}, not of {config.path}{remedy}"
        )


def warn_of_changes(run: ResultFile, config: Config | None, command: str = "") -> None:
    """Warn of what has changed since a result was made: the user's own files of models, the cases
    of its config and, where a `command` uses them, its figures or claims.

    Raises HodoError as `check_origin` and `check_cases` do.
    """
    check_cases(run)
    if config:
        check_origin(config, run)
    section = "" if config else {"plot": "figures", "claims": "claims"}.get(command, "")
    config = config or _config_of(run)
    if config is None:
        return
    quoted = quote(str(config.path))
    if section and getattr(stored_config(run), section) != getattr(config, section):
        message = f"the {section} of {config.path} have changed since its run"
        warnings.warn(f"{run.path}: {message}: hodo {command} {quoted} takes them", stacklevel=2)
    changed = [
        name
        for name in run.cases()
        if name in config.cases
        and _bare_digest(config.cases[name]) not in str(run.summary(name, ("hash",)).get("hash"))
    ]
    if changed:
        options = "".join(f" --set {quote(text)}" for text in config.overrides)
        has, them = ("has", "it") if len(changed) == 1 else ("have", "them")
        message = f"{few(changed)} {has} changed in {config.path} since the run"
        again = f"`hodo run {quoted}{options}` runs {them} again"
        warnings.warn(f"{run.path}: {message}; {again}", stacklevel=2)


def check_cases(run: ResultFile) -> None:
    """Raise HodoError if a file holds no cases."""
    if not run.cases():
        content = run.attributes.get(CONTENT)
        raise HodoError(f"{run.path} holds no cases{f', but {content}' if content else ''}")


def _config_of(run: ResultFile) -> Config | None:
    """The config of a result at its stated place, if it has changed and can be read."""
    path = place_of_config(run)
    # A result never needs its config, and the result of a stranger may name any file as its config.
    with suppress(OSError, HodoError):
        if os.path.isfile(path) and text_of(Path(path), path) != run.text:
            return load(relative_path(path, os.curdir), _overrides_of(run))
    return None


@cache
def package_digest() -> str:
    """The digest of all sources of hodo with its pages and lists, of the user's models, and of the
    libraries that compute."""
    files = [file for file in sorted(PACKAGE.rglob("*.*")) if file.suffix in SOURCE_SUFFIXES]
    texts = [digest(file.read_text("utf-8")) for file in files]
    return digest("".join([library_digest(), models.added_models_digest(), *texts]))


SOURCE_SUFFIXES = (".py", ".html", ".mplstyle", ".yaml")


def content_digest(checksums: Iterable[str], text: str = "") -> str:
    """The digest of stored groups by their checksums, of a text, and of the code that computes from
    them; empty if a group has no checksum."""
    of_groups = [*checksums]
    return digest(repr([package_digest(), text, *of_groups])) if all(of_groups) else ""
