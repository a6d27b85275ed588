"""Bodies averaged over the turns of their hodograph, to first order: against integrals in 30
digits, against the full motions, in all orders of the axes, and what is refused."""

import json
import math
from functools import partial
from itertools import permutations, product
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest
from conftest import Hodo

import hodo_cli

mp.mp.dps = 30
ROUNDING = 2e-14
"""The error that a quadrature in doubles may have: its time has been added up from some 100 parts,
and the logarithms from as many, each right to an ulp of the sum."""

FIG4 = {
    "model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.005, 0.004, 0.003],
    "initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 1000},
}  # fmt: skip
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


class Slow:
    """The averaged motion in 30 digits, by Legendre's integrals: sides, u = |ln ratio| and the
    logarithms of X_e and X_o, from an omega along axes of falling inertia."""

    def __init__(self, A: Any, w: Any) -> None:
        self.A = a, b, c = [mp.mpf(float(x)) for x in A]
        p, q, r = (mp.mpf(float(x)) ** 2 for x in w)
        X, Y = a * (a - c) * p + b * (b - c) * q, b * (a - b) * q + c * (a - c) * r
        u = mp.log((a - b) * X / ((b - c) * Y))
        self.side, self.u = (1 if u > 0 else -1), abs(u)
        self.logs = [mp.log(X), mp.log(Y)][:: self.side]
        self.G2 = (a * X + c * Y) / (a - c)

    def damped(self, lam: Any, u: Any, side: int) -> tuple[Any, ...]:
        """u', (ln X_e)' and (ln X_o)' under linear resistance, by E/K as the literature has it."""
        e, b, o = [mp.mpf(float(x)) for x in lam][::side]
        m = mp.exp(-max(u, mp.mpf("1e-27")))
        K, E = mp.ellipk(m), mp.ellipe(m)
        dn, cn = E / K, (E - (1 - m) * K) / (m * K)
        logs = -2 * (b + (e - b) * dn), -2 * (b + (o - b) * cn)
        return logs[0] - logs[1], *logs

    def in_fluid(self, kappa: Any, u: Any, side: int) -> tuple[Any, ...]:
        """The same in a fluid, from the loss of energy by <p^2 r^2>, <p^2 q^2> and <q^2 r^2>."""
        a, b, c = self.A
        m = mp.exp(-max(u, mp.mpf("1e-27")))
        S = (1 - mp.ellipe(m) / mp.ellipk(m)) / m
        S4 = (2 * (1 + m) * S - 1) / (3 * m)
        sn_cn, sn_dn, cn_dn = S - S4, S - m * S4, 1 - S - m * (S - S4)
        e, o = (a, c)[::side]
        ratio = m * abs(e - b) / abs(b - o)  # X_o/X_e
        X_e = self.G2 * (a - c) / (e + o * ratio)
        X, Y = (X_e, X_e * ratio)[::side]
        q2 = Y / (b * (a - b)) if side > 0 else X / (b * (b - c))
        p2, r2 = X / (a * (a - c)), Y / (c * (a - c))
        pq, qr = (sn_dn, sn_cn)[::side]
        loss = (a - c) ** 2 * (a + c - b) * p2 * r2 * cn_dn + (b - c) ** 2 * (
            b + c - a
        ) * q2 * r2 * qr
        loss = 2 * mp.mpf(kappa) / (a * b * c) * (loss + (a - b) ** 2 * (a + b - c) * p2 * q2 * pq)
        logs = (c * loss / X, -a * loss / Y)[::side]
        return logs[0] - logs[1], *logs

    def at(self, rates: Any, u: Any) -> list[Any]:
        """Time, ln X_e and ln X_o where u is so far on the side of the start."""
        steps = [self.u + (u - self.u) * i / 4 for i in range(5)]
        f = partial(rates, side=self.side)
        growth = [mp.quad(lambda x, j=j: (1, *f(x)[1:])[j] / f(x)[0], steps) for j in range(3)]
        return [growth[0], self.logs[0] + growth[1], self.logs[1] + growth[2]]


STARTS = [
    ([1, 0.8, 0.6], [0.8, 0.5, 0.74]), ([1, 0.8, 0.6], [0.5, 0.25, 1.4]),
    ([0.95, 0.9, 0.3], [0.3, 1.1, 0.2]), ([1, 1 - 1e-9, 0.7], [1e-3, 0.4, 0.8]),
    ([1, 0.6 + 1e-9, 0.6], [0.8, 0.4, 1e-3]), ([1, 0.8, 0.6], [3e-5, 0.9, 1e-4]),
]  # fmt: skip
"""Moments of inertia and omega: about both axes, nearly symmetric, and about the middle axis."""


@pytest.mark.parametrize(
    ("A", "w", "lam"),
    [
        *((*start, lam) for start in STARTS for lam in ((5, 4, 3), (4, 6, 3), 0)),
        *((*STARTS[i], lam) for i in (0, 1) for lam in ((3, 4, 5), (6, 3, 4.7), (5, 4, 5))),
        (*STARTS[2], (-1, 2, 4)),
    ],
)
def test_motions_are_those_of_an_integral_in_30_digits(A: Any, w: Any, lam: Any) -> None:
    slow = Slow(A, w)
    if lam:
        lam = [1e-3 * x for x in lam]
        body, rates = FIG4 | {"damping": lam}, lambda u, side: slow.damped(lam, u, side)
    else:
        body, rates = FLUID, lambda u, side: slow.in_fluid(0.01, u, side)
    falls = rates(slow.u, slow.side)[0] < 0
    # Not behind a fixed point, which no motion reaches.
    u = slow.u * (mp.mpf("0.6") if falls else mp.mpf("1.2"))
    while (rates(u, slow.side)[0] < 0) != falls:
        u = (u + slow.u) / 2
    t, *logs = slow.at(rates, u)
    end = mp.mpf(float(t))
    f, *growth = rates(u, slow.side)
    u, logs = (
        u + f * (end - t),
        [x + rate * (end - t) for x, rate in zip(logs, growth, strict=False)],
    )
    X, Y = (mp.exp(x) for x in logs[:: slow.side])
    a, _, c = slow.A
    found = averaged(
        body, inertia=A, initial=dict(zip("pqr", w, strict=False)), time={"values": [0, float(end)]}
    )
    expected = {
        "momentum": mp.sqrt((a * X + c * Y) / (a - c)),
        "kinetic_energy": (X + Y) / (a - c) / 2,
        "J": (a * X + c * Y) / (X + Y),
        "k2": mp.exp(-u),
    }
    for name, value in expected.items():
        # X and Y are exponentials: an ulp of a large logarithm is as much of them.
        bound = ROUNDING + 2.0**-52 * abs(math.log(abs(float(value)) ** 2))
        assert found[name][-1].item() == pytest.approx(float(value), rel=bound, abs=0), name
    assert found["enclosed_axis"].values.tolist() == [2 - slow.side] * 2
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
def test_the_separatrix_is_crossed_at_the_time_of_an_integral_in_30_digits(
    body: Any, changes: Any, time: float
) -> None:
    found = averaged(body, **changes)
    assert found.crossing_time.values == pytest.approx(
        [time], rel=1e-14 if body is FLUID else 1e-15
    )
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


def test_on_the_fixed_point_about_an_axis_and_of_a_symmetric_body_the_shape_stays() -> None:
    for changes in (
        {"initial": {"p": 1, "q": 0, "r": 0}},
        {"damping": 0.005},
        {"inertia": [1, 1, 0.6]},
        {"inertia": [1, 0.6, 0.6]},
    ):
        found = averaged(FIG4, **changes)
        assert np.ptp(found.k2.values) < 1e-15
        assert len(found.crossing_time) == 0
    equal = averaged(FIG4, damping=0.005)
    np.testing.assert_allclose(
        equal.momentum, equal.momentum[0] * np.exp(-0.005 * equal.time), rtol=1e-14
    )
    # It comes nearer to the separatrix for ever and stays on its side.
    near = averaged(FIG4, damping=[0.005, 0.004, 0.005], time={"end": 1e6})
    assert (near.enclosed_axis == 1).all()


@pytest.mark.parametrize("off", [1e-3, 1e-8, 1e-13])
def test_a_start_beside_the_separatrix_keeps_its_digits(off: float) -> None:
    p = 0.9 * 0.6**0.5 * (1 + off)
    slow = Slow([1, 0.8, 0.6], [p, 0.3, 0.9])
    time = mp.quad(lambda u: -1 / slow.damped(FIG4["damping"], u, 1)[0], [0, slow.u / 1e6, slow.u])
    found = averaged(FIG4, initial={"p": p, "q": 0.3, "r": 0.9}, time={"end": 1000, "samples": 5})
    assert found.crossing_time.item() == pytest.approx(float(time), rel=ROUNDING, abs=0)
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
        assert [
            order[i - 1] + 1 for i in base.enclosed_axis.values
        ] == found.enclosed_axis.values.tolist()
    assert known.attrs["status"] == "ok"


def test_the_full_motion_is_that_of_averaging_to_first_order() -> None:
    apart = []
    for e in (0.1, 0.01):
        changes = {
            "damping": [e * x for x in (0.005, 0.004, 0.003)],
            "time": {"end": 250 / e, "samples": 501},
        }
        full, mean = hodo_cli.run({**FIG4, **changes}), averaged(FIG4, **changes)
        apart.append(float(np.abs(hodo_cli.derive(full, "J")["J"] - mean.J).max()))
    assert apart[1] == pytest.approx(apart[0] / 10, rel=0.3)


@pytest.mark.parametrize(
    ("body", "changes", "sentence"),
    [
        (FIG4, {"mean_start": False}, "averaged motions begin at the start itself"),
        (FIG4, {"initial": {"p": 0, "q": 1, "r": 0}}, "it has no turn to average"),
        (FIG4, {"inertia": [1, 1, 1]}, "it has no turn to average"),
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
    found = hodo_cli.sweep(
        {**body, "store": ["momentum", "k2", "crossing_time", "end_axis", "share"]}
    )
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
