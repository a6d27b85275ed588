"""Whether a stored case is still right, or has to run again, and why."""

from ..batch.mark import code, digest, libraries
from ..cases.case import Case, dump
from ..results.writer import Finished

FORCED = "--force"

# In this order, because another version of hodo may write the same case in other words.
REASONS = (
    "the code that computes it has changed",
    "heyoka, numpy or scipy is another version",
    "its case has changed",
)


def fingerprint(case: Case) -> str:
    """What a result depends on, as three hashes: the code of models, engines and integration (of
    sweeps too, where the case is one), the libraries, and the case without its remarks.

    Nothing is integrated for it: the method that `auto` takes follows from the three.
    """
    return "-".join((code(bool(case.sweep)), libraries(), digest(dump(case, remarks=False))))


def why(case: Case, done: Finished | None, force: bool) -> str:
    """Why a case is to be run, given what is stored of it; an empty string if it need not be."""
    if done is None:
        return "it has no result yet"
    if done.damage:
        return f"its stored result is damaged ({done.damage})"
    if force:
        return FORCED
    # A timeout may be due to another program's work, so what did not end well is tried again.
    if (status := str(done.attributes.get("status"))) != "ok":
        return f"its status is {status}"
    ours, theirs = fingerprint(case).split("-"), str(done.attributes.get("hash")).split("-")
    for i, reason in enumerate(REASONS):
        if theirs[i : i + 1] != ours[i : i + 1]:
            return reason
    return ""
