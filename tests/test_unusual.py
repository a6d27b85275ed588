"""Figures of unusual data: motions that have died down, single samples, constants."""

import warnings
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import FIG4
from matplotlib.figure import Figure

import hodo_cli as hodo
from hodo_cli import HodoError

BODY = FIG4 | {"damping": 1, "time": {"end": 900, "samples": 901}}


@pytest.fixture(scope="module")
def dying() -> xr.Dataset:
    """A body whose omega ends below the smallest double, while its direction is known."""
    return hodo.run(BODY)


def drawn(*args: Any, **keys: Any) -> Figure:
    """A figure that is drawn without a warning but for those about samples."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*not known between its samples")
        figure = hodo.plot(*args, **keys)
        figure.draw_without_rendering()
    return figure


def test_a_direction_keeps_its_digits_until_omega_has_none(dying: xr.Dataset) -> None:
    """The squares of omega lose theirs from 1e-154 on, twice as early."""
    omega, A = np.array([0.8, 0.5, 0.74]), np.array([1, 0.8, 0.6])
    G2, energy = np.sum((A * omega) ** 2), np.sum(A * omega**2) / 2
    names = ("J", "D_per_2T", "separatrix_distance", "tilt", "x1_direction")
    values = hodo.derive(dying, *(name.replace("_per_", "/") for name in names))
    is_normal = np.abs(dying.omega).max("axis").values > 2.3e-308
    assert 700 < is_normal.sum() < 720
    J = G2 / (2 * energy)
    # Constants of the free motion.
    for name, constant in (("J", J), ("D_per_2T", J - 0.8), ("separatrix_distance", 1 - 0.8 / J)):
        np.testing.assert_allclose(values[name][is_normal], constant, rtol=1e-12)
    # The stretched time, and with it the direction, stands still from 50 on.
    for name in ("tilt", "x1_direction"):
        there = values[name].values
        np.testing.assert_allclose(there[50:700], there[50], rtol=1e-12)
    for name in names:
        assert np.isnan(values[name][720:]).all()


def test_a_direction_of_a_huge_motion_has_its_digits() -> None:
    scale = {key: 1e100 * value for key, value in BODY["initial"].items()}
    fast = hodo.run({**BODY, "damping": 0, "initial": scale, "time": {"end": 1e-99, "samples": 9}})
    np.testing.assert_allclose(hodo.derive(fast, "D/2T").D_per_2T, 0.0533032107893475, rtol=1e-12)


def test_a_sphere_shows_no_direction_of_lost_digits(dying: xr.Dataset) -> None:
    figure = drawn(dying, "sphere")
    (end,) = (x for x in figure.axes[0].lines if x.get_marker() == "s")
    moving = hodo.run({**BODY, "time": {"values": [100]}})
    (mark,) = (x for x in drawn(moving, "sphere").axes[0].lines if x.get_marker() == "s")
    np.testing.assert_allclose(end.get_xydata(), mark.get_xydata(), atol=1e-9)


def test_huge_and_tiny_constants_are_said_to_be_constant() -> None:
    for size in (1e85, 1e-85):
        start = {key: size * value for key, value in BODY["initial"].items()}
        time = {"end": 100 / size, "samples": 101}
        free = hodo.run({**BODY, "damping": 0, "initial": start, "time": time})
        figure = drawn(free, "series", variables=["T"])
        assert [text.get_text()[:8] for text in figure.axes[0].texts] == ["constant"]


def test_a_single_sample_is_marked() -> None:
    one = hodo.run({**BODY, "damping": 0, "time": {"end": 10, "samples": 1}})
    for figure in (drawn(one, "invariants"), drawn(one, "series", variables=["G", "T", "D"])):
        assert [axes.lines[0].get_marker() for axes in figure.axes] == ["o"] * 3


@pytest.mark.parametrize(
    ("inertia", "sides"), [([1, 1, 0.6], ["about $x_3$"]), ([1, 0.8, 0.8], ["about $x_1$"])]
)
def test_a_side_that_a_body_lacks_is_not_named(inertia: list[float], sides: list[str]) -> None:
    body = hodo.run({**BODY, "inertia": inertia, "time": {"end": 1}})
    texts = drawn(body, "invariants").axes[2].texts
    assert [text.get_text() for text in texts] == sides


@pytest.mark.parametrize("values", ["x", 1j])
def test_what_is_no_number_is_no_variable(dying: xr.Dataset, values: Any) -> None:
    named = dying.assign(mine=("time", np.full(dying.sizes["time"], values)))
    with pytest.raises(HodoError, match="unknown variable 'mine'"):
        hodo.plot(named, "series", variables=["mine"])


def test_two_constant_components_have_equal_scales(caplog: pytest.LogCaptureFixture) -> None:
    steady = hodo.run({**BODY, "damping": 0, "initial": {"p": 0, "q": 0, "r": 1}})
    drawn(steady, "phase", x="p", y="r")
    assert not caplog.records  # matplotlib tells of ends that it cannot keep


def test_a_map_of_the_status_shows_every_status() -> None:
    """Members of another status than ok have no values but this one."""
    moments = {"inertia.0": {"values": [1, 2.5]}, "inertia.2": {"values": [0.6, 0.7]}}
    swept = hodo.sweep({**FIG4, "time": {"end": 300}, "sweep": moments})
    assert swept.status.values.tolist() == [[0, 0], [3, 3]]
    figure = drawn(swept, "map", variable="status", x="inertia.0", y="inertia.2")
    words = [text.get_text().rpartition(": ")[2] for text in figure.legends[0].texts]
    assert words == ["ok", "invalid"]
