"""Bodies averaged over the turns of their hodograph, to first order."""

import json
import math
from itertools import permutations, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import FIG4, Hodo

import hodo_cli

ROUNDING = 2e-14
"""The error that a quadrature in doubles may have: it adds some 100 parts."""

FLUID = {
    "model": "cavity+constant", "inertia": [1, 0.8, 0.6], "kappa": 0.01,
    "initial": {"p": 0.5, "q": 0.25, "r": 1.4}, "time": {"end": 200},
}  # fmt: skip
FIG12 = {
    "model": "tensor", "inertia": [1, 0.8, 0.6], "initial": {"p": 0.5, "q": 0.25, "G": 1},
    "resistance": {"diagonal": 0.005, "off_diagonal": 0.005}, "time": {"end": 1000},
}  # fmt: skip


def averaged(body: dict[str, Any], **changes: Any) -> Any:
    """The averaged motion of a body with some of its keys changed."""
    return hodo_cli.run({**body, "form": "averaged", **changes})


MOTIONS = [
    ([1, 0.8, 0.6], [0.8, 0.5, 0.74], (5, 4, 3), 1, 102.23764610726505,
     (0.6410781018908321, 0.24684057319297759, 0.8324829411302881, 0.7205563472970352)),
    ([1, 0.8, 0.6], [0.5, 0.25, 1.4], (4, 6, 3), 3, 85.62862777914204,
     (0.7247897293353571, 0.399016709495037, 0.6582683622633531, 0.17050912420423064)),
    ([0.95, 0.9, 0.3], [0.3, 1.1, 0.2], (5, 4, 3), 3, 7.363155197649705,
     (0.9996654232630456, 0.5570229117459445, 0.8970285937928117, 0.9392309243494507)),
    ([1, 0.999999999, 0.7], [0.001, 0.4, 0.8], (4, 6, 3), 3, 1027.4453117159337,
     (0.025784409259432883, 0.00047369970573205147, 0.7017481252500428, 1.9537459827594492e-11)),
    ([1, 0.600000001, 0.6], [0.8, 0.4, 0.001], (5, 4, 3), 1, 2893.878791816894,
     (9.590406211400611e-06, 7.658888573841029e-11, 0.6004519481704925, 2.210143040809934e-06)),
    ([1, 0.8, 0.6], [3e-05, 0.9, 0.0001], (4, 6, 3), 3, 1.6248902518838365e-05,
     (0.7199999356214096, 0.3239999428242711, 0.7999999981111112, 0.9999999811111114)),
    ([1, 0.8, 0.6], [0.5, 0.25, 1.4], 0, 3, 45.65139705752412,
     (0.9977975746613137, 0.6943787275597314, 0.7168998418909348, 0.41292750478047674)),
    ([0.95, 0.9, 0.3], [0.3, 1.1, 0.2], 0, 3, 0.9786663226242787,
     (1.031952033769012, 0.592590333672697, 0.8985338938959018, 0.969139269841776)),
    ([1, 0.999999999, 0.7], [0.001, 0.4, 0.8], 0, 3, 2024.8040354490347,
     (0.6881867476782737, 0.23685404489340453, 0.9997739322820997, 4.420119888373445e-06)),
    ([1, 0.600000001, 0.6], [0.8, 0.4, 0.001], 0, 1, 168.0074825274943,
     (0.8352247363386696, 0.3490724681687485, 0.9992199669192564, 4.8847322608405735e-12)),
    ([1, 0.8, 0.6], [0.8, 0.5, 0.74], (3, 4, 5), 1, 47.5358810166372,
     (0.8420625284930792, 0.4106755508606767, 0.8632962205883937, 0.5192014496300456)),
    ([1, 0.8, 0.6], [0.5, 0.25, 1.4], (6, 3, 4.7), 3, 2135.314277467598,
     (7.128125678350334e-05, 3.7148423166503825e-09, 0.6838806516580789, 0.2653448835006195)),
    ([1, 0.8, 0.6], [0.8, 0.5, 0.74], (5, 4, 5), 1, 555.409592448814,
     (0.07861503029794012, 0.003711981761665185, 0.8324829411302881, 0.7205563472970352)),
    ([0.95, 0.9, 0.3], [0.3, 1.1, 0.2], (-1, 2, 4), 3, 6.2816861931580625,
     (1.0249777302270173, 0.5846075226534756, 0.8985338938959018, 0.969139269841776)),
]  # fmt: skip
"""Moments of inertia, omega and damping in thousandths, 0 for a fluid; the axis, a time, and the
momentum, kinetic energy, J and k2 then, by Legendre's integrals E and K in 30 digits."""


@pytest.mark.parametrize(("A", "w", "lam", "axis", "end", "expected"), MOTIONS)
def test_motions_are_those_of_an_integral_in_30_digits(A, w, lam, axis, end, expected):
    body = FIG4 | {"damping": [1e-3 * x for x in lam]} if lam else FLUID
    initial, time = dict(zip("pqr", w, strict=True)), {"values": [0, end]}
    found = averaged(body, inertia=A, initial=initial, time=time)
    for name, value in zip(("momentum", "kinetic_energy", "J", "k2"), expected, strict=True):
        # X and Y are exponentials: an ulp of a large logarithm is as much of them.
        bound = ROUNDING + 2.0**-52 * abs(math.log(value**2))
        assert found[name][-1].item() == pytest.approx(value, rel=bound, abs=0), name
    assert found["enclosed_axis"].values.tolist() == [axis] * 2
    assert found.attrs["method"] == "quadrature"
    assert found.attrs["error"] < ROUNDING


@pytest.mark.parametrize(
    ("body", "changes", "time"),
    [
        (FIG4, {}, 304.02105312940001904),
        (FIG4, {"damping": [0.005, 0.004, 0.002]}, 211.43974886762460678),
        (FIG4, {"damping": [0.004, 0.004, 0.002]}, 348.19859997256125456),
        (FIG4, {"damping": [0.009, 0.004, 0.007]}, 209.22504589909074026),
        (FIG4, {"damping": [5e-9, 4e-9, 3e-9], "time": {"end": 1e9}}, 304021053.12940001418),
        (FIG12, {}, 385.0746032483191),
        (FLUID, {}, 133.454550741943),
    ],
)
def test_the_separatrix_is_crossed_at_the_time_of_an_integral_in_30_digits(body, changes, time):
    found = averaged(body, **changes)
    bound = 1e-14 if body is FLUID else 1e-15
    assert found.crossing_time.values == pytest.approx([time], rel=bound)
    assert 0 < found.crossing_error.values[0] < ROUNDING * time
    # Fig 4 behind its crossing.
    if not changes and body is FIG4:
        assert float(found.momentum[-1]) == pytest.approx(0.0194584549198895514, rel=4e-15, abs=0)
        assert float(found.J[-1]) == pytest.approx(0.670441293835646170, rel=2e-15, abs=0)


@pytest.mark.parametrize(
    ("lam", "fixed"), [((7, 6, 7.5), 0.602349061340403), ((3, 6, 2), 0.767070424888046)]
)
def test_a_fixed_point_draws_motions_to_it_or_is_a_threshold(lam: Any, fixed: float) -> None:
    """m* of C/Delta = rho or 1/rho, rho = (l1 - l2)/(l3 - l2)."""
    lam = [x / 1024 for x in lam]  # no number of it is rounded
    rho = (lam[0] - lam[1]) / (lam[2] - lam[1])
    assert rho in (2 / 3, 3 / 4)
    for k2 in (fixed - 1e-3, fixed + 1e-3):
        start = {"p": 1.0, "q": 0.0, "r": (k2 / 0.6) ** 0.5}
        found = averaged(FIG4, damping=lam, initial=start, time={"end": 1e6, "samples": 101})
        if lam[1] < lam[0]:
            assert found.k2[-1].item() == pytest.approx(fixed, abs=1e-14)
        else:
            assert len(found.crossing_time) == int(k2 > fixed)


@pytest.mark.parametrize(
    ("off", "time"),
    [(1e-3, 2.340332302642129), (1e-8, 5.0209713217106016e-05), (1e-13, 7.675894866590342e-10)],
)
def test_a_start_beside_the_separatrix_keeps_its_digits(off: float, time: float) -> None:
    p = 0.9 * 0.6**0.5 * (1 + off)
    found = averaged(FIG4, initial={"p": p, "q": 0.3, "r": 0.9}, time={"end": 1000, "samples": 5})
    assert found.crossing_time.item() == pytest.approx(time, rel=ROUNDING, abs=0)
    assert found.enclosed_axis.values.tolist() == [1, 3, 3, 3, 3]


@pytest.mark.parametrize("body", [FIG4, FIG12, FLUID], ids=["linear-diag", "tensor", "cavity"])
def test_the_order_of_the_axes_changes_no_bit(body: Any) -> None:
    known = averaged(body)
    for order in permutations(range(3)):
        changes = {"inertia": [0] * 3, "initial": {}}
        damping, w = [0.0] * 3, [0.5, 0.25, 1.1]
        for i, axis in enumerate(order):
            changes["inertia"][axis] = body["inertia"][i]
            changes["initial"]["pqr"[axis]] = w[i]
            damping[axis] = FIG4["damping"][i]
        base = averaged(body, initial=dict(zip("pqr", w, strict=False)))
        found = averaged(body, **changes, **({"damping": damping} if body is FIG4 else {}))
        for name in ("kinetic_energy", "momentum", "J", "k2", "crossing_time", "crossing_G"):
            assert np.array_equal(found[name], base[name]), (order, name)
        axes = [order[i - 1] + 1 for i in base.enclosed_axis.values]
        assert axes == found.enclosed_axis.values.tolist()
    assert known.attrs["status"] == "ok"


def test_the_full_motion_is_that_of_averaging_to_first_order() -> None:
    apart = []
    for e in (0.1, 0.01):
        changes = {"damping": [e * x for x in FIG4["damping"]]}
        changes["time"] = {"end": 250 / e, "samples": 501}
        full, mean = hodo_cli.run({**FIG4, **changes}), averaged(FIG4, **changes)
        apart.append(float(np.abs(hodo_cli.derive(full, "J")["J"] - mean.J).max()))
    assert apart[1] == pytest.approx(apart[0] / 10, rel=0.3)


@pytest.mark.parametrize(
    ("body", "changes", "sentence"),
    [
        (FIG4, {"mean_start": False}, "averaged motions begin at the start itself"),
        (FIG4, {"initial": {"p": 0, "q": 1, "r": 0}}, "has no turn to average"),
        (FIG4, {"inertia": [1, 1, 1]}, "has no turn to average"),
        (FIG4, {"method": "taylor"}, "form averaged is a quadrature: leave out"),
        (FIG4, {"precision": "extended"}, "form averaged is a quadrature: leave out"),
        (FIG4, {"form": "full", "method": "quadrature"}, "is that of bodies averaged over"),
        (FIG4, {"attitude": "yes"}, "attitude: is a key of form full"),
        (FLUID, {"torque": [0, 0, 1]}, "of a body with three different moments takes no torque"),
        (FLUID, {"inertia": [1, 0.6, 0.6]}, "form averaged needs A1 = A2"),
        (FLUID | {"model": "torques"}, {"brake": 0.1}, "expected full, got 'averaged'"),
    ],
)  # fmt: skip
def test_what_it_does_not_do_is_refused(body: Any, changes: Any, sentence: str) -> None:
    with pytest.raises(hodo_cli.HodoError, match=sentence):
        averaged(body, **changes)


def test_large_resistance_is_said() -> None:
    assert "needs weak resistance" in averaged(FIG4, damping=[0.5, 0.4, 0.3]).attrs["warnings"]
    assert averaged(FIG4).attrs["warnings"] == ""


def test_members_of_a_sweep_are_single_motions() -> None:
    axes = {"damping.2": {"values": [0.003, 0.006]}, "d": {"sphere": {"count": 6, "seed": 1}}}
    body = {**FIG4, "form": "averaged", "initial": {"p": 0, "q": 0, "G": 1}, "sweep": axes}
    store = ["momentum", "k2", "crossing_time", "end_axis", "share"]
    found = hodo_cli.sweep({**body, "store": store})
    assert found.attrs["method"] == "quadrature"
    assert found.crossing_time.attrs["long_name"].endswith("averaged to first order")
    assert np.isfinite(found.crossing_time).any()
    for i, j in product(range(2), range(6)):
        member = found.isel({"damping.2": i, "d": j})
        w = (member.d_vector.values / FIG4["inertia"]).tolist()
        damping = [0.005, 0.004, (0.003, 0.006)[i]]
        one = averaged(FIG4, damping=damping, initial=dict(zip("pqr", w, strict=True)))
        assert float(member.momentum) == pytest.approx(float(one.momentum[-1]), rel=1e-13, abs=0)
        assert member.end_axis.item() == one.enclosed_axis[-1].item()
        times = [*one.crossing_time.values, np.nan]
        assert np.allclose(member.crossing_time, times[0], rtol=1e-12, equal_nan=True)


def test_a_file_is_labelled_told_and_drawn(hodo: Hodo, tmp_path: Path) -> None:
    case = {**FIG4, "form": "averaged", "time": {"end": 1000, "unit": "s"}}
    (tmp_path / "a.yaml").write_text(json.dumps({"cases": {"mean": case}}), encoding="utf-8")
    assert hodo("run", "a.yaml").returncode == 0
    for _ in range(2):  # by what is stored, before and after it is written anew
        (row,) = json.loads(hodo("classify", "runs/a.h5", "--json").stdout)
        assert [row["start"], row["end"]] == ["x1", "x3"]
        (crossing,) = row["crossings"]
        assert crossing["time"] == pytest.approx(304.02105312940001904, rel=4e-16, abs=0)
        assert 0 < crossing["error"] < 1e-12
    said = " ".join(hodo("show", "runs/a.h5", "--methods").stdout.split())
    assert "to first order, by quadrature" in said
    assert "without the error of averaging itself, which is of first order" in said
    stored = hodo_cli.open(tmp_path / "runs/a.h5")["mean"]
    for name in ("momentum", "kinetic_energy", "J", "k2", "enclosed_axis", "crossing_time"):
        assert stored[name].attrs["long_name"].count("averaged to first order") == 1
    names = ["G", "T", "J", "D/2T", "k2"]
    panels = hodo_cli.plot(stored, "series", variables=names).axes
    assert [axes.lines[0].get_ydata()[0] for axes in panels[:2]] == pytest.approx(
        [float(stored.momentum[0]), float(stored.kinetic_energy[0])]
    )
