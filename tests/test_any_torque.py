"""The averaged form of a model that states only its full equations: beside the forms that know
theirs, and beside full motions."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import Hodo
from scipy.special import ellipj, ellipk
from test_averaged import CLOSE, case, cavity, chance
from test_averaged import full as full_case
from test_docs import snippets

from hodo_cli import Case
from hodo_cli.engines import have_taylor
from hodo_cli.integration import Trajectory, integrate
from hodo_cli.models.averaging import any_torque

EXAMPLE = next(text for text in snippets("docs/models.md", "python") if "class " in text)


@pytest.mark.parametrize("m", [0, 1e-3, 0.5, 0.99, 1 - 1e-8])
def test_the_functions_of_jacobi_at_the_nodes(m: float) -> None:
    seen = np.array(any_torque.whole_turn(1 - m, 64))
    known = np.array(ellipj(np.arange(64) * ellipk(m) / 16, m))[:3].T
    assert seen == pytest.approx(known, abs=2e-14)


def by_quadrature(known: Case, nodes: int = 128) -> Trajectory:
    """The motion of an averaged case by the equations of its full form alone."""
    full = type(full_case(known).system)
    own = {key: value for key, value in known.data.items() if key in full.keys}
    branch = known.data.get("at_separatrix", "stop")
    form = any_torque.averaged_form(full)  # type: ignore[arg-type]
    of = form(**own, mean_start=known.data["mean_start"], at_separatrix=branch, nodes=nodes)
    copy = replace(known, error=False, method="auto" if have_taylor() else "DOP853")
    object.__setattr__(copy, "system", of)
    return integrate(copy)


EVEN = {"inertia": [0.6, 1, 0.8], "initial": {"p": 0.74, "q": -0.8, "r": 0.5}}
ODD = {"inertia": [0.8, 1, 0.6], "initial": {"p": 0.5, "q": 0.8, "r": 0.74}}
"""Fig 4's body with its axes in an even and in an odd order, and starts about the largest."""


@pytest.mark.heyoka
@pytest.mark.parametrize(
    "known",
    [
        case(),
        case(mean_start="no"),
        case(damping=[3e-3, 5e-3, 4e-3], **EVEN),
        case(damping=[6e-3, 9e-3, 3e-3], **ODD),
        case(inertia=[0.8, 0.8, 0.6], time={"end": 300, "samples": 11}),
        case(model="tensor", resistance={"diagonal": 3e-3, "off_diagonal": 1e-3},
              mean_start="no"),
        cavity(kappa=1e-3, time={"end": 2000, "samples": 11}),
    ],
)  # fmt: skip
def test_it_is_that_of_the_forms_that_know_their_means(known: Case) -> None:
    ours, theirs = by_quadrature(known), integrate(replace(known, error=False))
    for passage, own in zip(theirs.events, ours.events, strict=True):
        assert own.time == pytest.approx(passage.time, rel=CLOSE)
        assert passage.details.keys() == own.details.keys()
        assert own.details == pytest.approx(passage.details, rel=1e-8, nan_ok=True)
    # Late, the two forms differ in when a motion turns too slowly to have a periodic part.
    seen = theirs.time <= (1000 if known.data["mean_start"] == "no" else 300)
    for name, values in theirs.variables.items():
        assert ours.variables[name][seen] == pytest.approx(values[seen], rel=3e-12)


@pytest.mark.heyoka
@pytest.mark.parametrize("branch", ["stop", "other-axis", "reversed"])
def test_a_capture_by_chance_is_found_by_trying(branch: str) -> None:
    known = chance(torque=[-1e-3, 3e-4, -5e-4], kappa=3e-4, at_separatrix=branch)
    ours, theirs = by_quadrature(known), integrate(replace(known, error=False))
    assert ours.time == pytest.approx(theirs.time, rel=1e-12)
    assert ours.events[0].details == pytest.approx(theirs.events[0].details, rel=1e-8)
    for name in ("J", "momentum", "enclosed_axis"):
        assert ours.variables[name] == pytest.approx(theirs.variables[name], rel=1e-12)


@pytest.mark.heyoka
@pytest.mark.process
def test_the_example_of_the_documents_is_near_its_full_motion(hodo: Hodo, tmp_path: Path) -> None:
    """Its torque has the mirror symmetry of the second order; from the start itself it is right to
    the first."""
    (tmp_path / "drag.py").write_text(EXAMPLE, encoding="utf-8")
    text = next(text for text in snippets("docs/models.md", "yaml") if "quadratic-drag" in text)
    drags = {"a": 1e-2, "b": 1e-3}
    for name, drag in drags.items():
        given = text.replace("drag: 0.001", f"drag: {drag}").replace(
            "end: 2000", f"end: {2 / drag}, samples: 1001"
        )
        assert given.count(str(drag)) == 1
        (tmp_path / f"{name}.yaml").write_text(given, encoding="utf-8")
    # In one process the equations are compiled once.
    done = hodo(
        "--models", "drag.py", "run", *(f"{name}.yaml" for name in drags), "-j", "1", "--quiet"
    )
    assert done.returncode == 0, done.stderr
    small = {drag: errors_of(tmp_path / "runs" / f"{name}.h5") for name, drag in drags.items()}
    for name, expected in (("averaged", 2), ("first-order", 1)):
        errors = [of_drag[name] for of_drag in small.values()]
        slope = np.polyfit(np.log([*small]), np.log(errors), 1)[0]
        assert slope == pytest.approx(expected, abs=0.15), errors


def errors_of(path: Path) -> dict[str, float]:
    """The largest relative distance of G^2 and T of each averaged case from the case `full`."""
    found = {}
    with h5py.File(path) as file:
        A, w = np.array([1, 0.8, 0.6]), file["full/omega"][()]
        square, energy = (A * A * w * w).sum(axis=1), (A * w * w).sum(axis=1) / 2
        for name in file.keys() - {"full"}:
            assert file[name].attrs["error"] < 1e-12
            far = [file[name]["momentum"][()] ** 2 / square, file[name]["kinetic_energy"] / energy]
            found[name] = float(np.abs(np.array(far) - 1).max())
    return found


@pytest.mark.process
def test_wrong_values_are_named(hodo: Hodo, tmp_path: Path) -> None:
    (tmp_path / "drag.py").write_text(EXAMPLE, encoding="utf-8")
    lines = "cases:\n  a: {model: quadratic-drag, form: averaged, drag: 0.1, time: {end: 1},\n"
    lines += "      inertia: [1, 0.8, 0.6], initial: {p: 1, q: 0, r: 1}, nodes: 100}\n"
    (tmp_path / "a.yaml").write_text(lines, encoding="utf-8")
    done = hodo("--models", "drag.py", "run", "a.yaml")
    assert done.returncode == 2
    assert "nodes: expected a power of two, got 100" in done.stderr
