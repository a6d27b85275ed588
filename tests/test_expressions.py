"""Formulas of a case file: what is read has the value that Python gives it, whatever passes for a
number; what is hostile is refused with its column, and nothing of it is ever run.

HODO_FUZZ sets the number of random texts (default 2000).
"""

import builtins
import math
import operator
import os
import random
import re
from collections.abc import Callable
from operator import add, mul, sub, truediv
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from conftest import Hodo, counted
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import hodo_cli as hodo_package
from hodo_cli import Case, HodoError, arithmetic, functions
from hodo_cli.arithmetic import evaluate
from hodo_cli.engines.series import Series
from hodo_cli.schema import expression, kinds

NAMES = ("p", "q", "r", "t")
COUNT = int(os.environ.get("HODO_FUZZ", "2000"))
NESTED = (
    "sin(exp(-0.3*p)*q) - sqrt(p**2+q**2+r**2)/(2-cos(0.1*t)) + (p*q)**-3 - +r**7/1.5e1"
    " + tanh(q - p)*log(t)"
)


def case_with(text: Any, **others: Any) -> dict[str, Any]:
    """A body under a torque by an expression."""
    body = {"model": "torques", "inertia": [2, 1.5, 1], "time": {"end": 10, "samples": 11}}
    start = {"p": 0.3, "q": 0.7, "r": -0.9}
    return {**body, "initial": start, "damping": 0.01, "expression": [text, 0, 0], **others}


def refusal(text: Any) -> str:
    """What a text is refused with, at the door."""
    with pytest.raises(HodoError) as refused:
        Case.of(case_with(text))
    (line,) = str(refused.value).splitlines()
    return line.removeprefix("expression.0: ")


def read(text: str) -> tuple[Any, str]:
    """The tree of a text, or None and what it is refused with."""
    try:
        return expression.parse_expression(text, NAMES), ""
    except kinds.Wrong as refused:
        return None, str(refused)


@pytest.mark.parametrize(
    ("text", "column", "said"),
    [
        ("", 1, "missing"),
        ("p +", 4, "missing"),
        ("(p", 1, "never closed"),
        (" p)", 3, "unmatched"),
        ("  p + 1/0", 7, "division by 0"),
        ("p^2", 2, "a power is **"),
        ("2p", 1, "a product is written with its *"),
        ("007", 1, "not a decimal number"),
        ("p + 1e999", 5, "too large"),
        ("9" * 400, 1, "too large"),
        ("1/(1-1)", 1, "division by 0"),
        ("p + sqrt(-1)", 5, "sqrt(-1) is not a finite number"),
        ("1e300*1e300", 1, "not a finite number"),
        ("pp", 1, "did you mean 'p'"),
        ("2*pi", 3, "unknown name 'pi'; write 3.141592653589793 (valid: p, q"),
        ("p + pz", 5, "unknown name 'pz' (valid: p, q"),
        ("p if q else r", 1, "expected a number"),
        ("ｐ", 1, "unexpected"),  # a full-width p, which Python's parser turns into p
        ("p*²", 3, "unexpected"),
        ("p.__class__", 2, "unexpected"),
        ("__import__('os').system('true')", 1, "unexpected"),
        ("p := 1", 3, "unexpected"),
        ("sin(p, q)", 6, "unexpected"),
        ("eval(p)", 1, "unknown function"),
        ("sin()", 1, "expected a number"),
        ("sin(*p)", 5, "expected a number"),
        ("9**9**9**9", 7, "from -16 to 16"),
        ("p**0.5", 4, "a root is sqrt(x)"),
        ("p**17", 4, "from -16 to 16"),
        ("(" * 220 + "p" + ")" * 220, 201, "too many nested"),
        ("-" * 30 + "p", 31, "nested more than"),
        ("+".join("p" * 101), 1, "201 numbers, names and operations"),
        ("p" + " " * 500, 501, "longer than 500"),
    ],
)
def test_what_is_no_formula_is_refused_with_its_column(text: str, column: int, said: str) -> None:
    message = refusal(text)
    assert said in message
    assert message.startswith(f"column {column} of the expression: ")


@pytest.mark.parametrize("value", [True, None, float("inf"), 10**400, ["p"], {"p": 1}])
def test_what_is_no_text_and_no_number_is_refused(value: Any) -> None:
    assert refusal(value).startswith("expected an expression in p, q, r, t and constants, got ")


def test_a_number_is_an_expression() -> None:
    for number, text in ((-2, "-2.0"), (1e-5, "1e-05"), (1e-100, "1e-100")):
        assert Case.of(case_with(number)).data["expression"][0] == text


def test_constants_are_folded_and_long_sums_are_not_nested() -> None:
    for text, tree in (
        ("-(1/4+sqrt(4)*2**-1)", -1.25),
        ("2*3*p", ("*", 6.0, "p")),
        ("-p**2", ("neg", ("**", "p", 2))),
        ("tanh(0)*p + abs(-2)*log(1)", ("+", ("*", 0.0, "p"), 0.0)),
        ("(" * 40 + "p" + ")" * 40, "p"),
    ):
        assert read(text) == (tree, "")
    assert evaluate(read("+".join("p" * 100))[0], {"p": 1.5}) == 150


FORMS = ["-{}", "+{}", "({})", "({})**2", "({})**3", "({})**-2", "({})**-(1)", "({})**0", "sin({})",
         "cos({})", "exp(-({})**2)", "sqrt(1+({})**2)", "log(1+({})**2)", "tanh({})", "abs({})",
         *("({}) " + sign + " {}" for sign in "+-*/+-*/")]  # fmt: skip


def formula(draw: random.Random, depth: int) -> str:
    """A random formula that is right by the grammar."""
    if depth == 0 or draw.random() < 0.2:
        return draw.choice([*NAMES, *NAMES, "2.0", "0.5", "1.25e0", ".75", "3."])
    form = draw.choice(FORMS)
    return form.format(*(formula(draw, depth - 1) for _ in range(form.count("{}"))))


@np.errstate(all="ignore")
def test_the_value_is_that_of_python() -> None:
    draw, tried = random.Random(1), 0
    values = {name: np.random.default_rng(i).normal(size=5) for i, name in enumerate(NAMES)}
    functions = {name: getattr(np, name) for name in expression.FUNCTIONS}
    for _ in range(300):
        text = formula(draw, 4)
        tree, message = read(text)
        if message:
            assert re.search("division by 0|finite|longer|and operations", message)
            continue
        tried += 1
        expected = eval(text, functions | {name: x.copy() for name, x in values.items()})
        # Powers by products instead of `pow`; a difference of near numbers shows it larger.
        close = np.isclose(evaluate(tree, values), expected, rtol=1e-9, atol=1e-9, equal_nan=True)
        assert close.all(), text
    assert tried > 200


WORDS = ["p", "q", "t", "sin", "sqrt(", "(", ")", "(", ")", "+", "-", "*", "/", "**", "2", "16",
         "0.5", "1e3", ".", "e", " ", "_", "0x", "j", ",", "if", "lambda", "'", "#", "=", ":",
         "\n", "ｐ", "\u200b", "9" * 60, "__class__", "True", "[", "~", "^", "%"]  # fmt: skip
TOKENS = ["p", "q", "2", "0.5", "(", ")", "+", "-", "*", "/", "**2", "sin(", "exp(", "tanh("]


def test_random_texts_are_taken_or_refused_and_never_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing but its own error, with little work; Python's `eval` and `exec` are not called, and
    what is taken is taken again with redundant parentheses."""
    draw, taken = random.Random(2), 0

    def never(*_: object) -> None:
        raise AssertionError("a text was run")

    with monkeypatch.context() as patched:
        for name in ("eval", "exec"):
            patched.setattr(builtins, name, never)
        for i in range(COUNT):
            words = (WORDS, TOKENS, [chr(draw.randrange(32, 127)) for _ in range(20)])[i % 3]
            text = "".join(draw.choices(words, k=draw.randrange(1, 14)))
            (tree, message), work = counted(read, text)
            assert work < 40 * (20 + len(text)), text  # twice what any of these takes
            taken += not message
            assert message.startswith("column " if message else "")
            assert message or read(f"({text.strip()})") == (tree, "")
    assert taken > COUNT / 50


# Whatever passes for a number.

POINT = {"p": 0.8, "q": -0.5, "r": 0.74, "t": 3.0}


FUNCTIONS = ("sin", "cos", "exp", "sqrt", "log", "tanh")


def exactly(**changed: Any) -> Any:
    """The value of `NESTED` at `POINT` in mpmath, by Python's own reading of the text."""
    text = NESTED
    for decimal in ("1.5e1", "0.3", "0.1"):
        text = text.replace(decimal, f"mpf({float(decimal)!r})")
    functions = {name: getattr(mpmath, name) for name in FUNCTIONS}
    values = {name: mpmath.mpf(value) for name, value in POINT.items()}
    return eval(text, functions | {"mpf": mpmath.mpf} | values | changed)


def test_numbers_arrays_and_long_doubles() -> None:
    tree = expression.parse_expression(NESTED, NAMES)
    # Those that a model of a user's own has are the same.
    assert all(getattr(functions, x) is getattr(arithmetic, x) for x in FUNCTIONS[:-1])
    with mpmath.workdps(40):
        exact = exactly()
        assert evaluate(tree, POINT) == pytest.approx(float(exact), rel=1e-14)
        arrays = {name: np.array([value, value]) for name, value in POINT.items()}
        assert evaluate(tree, arrays) == pytest.approx([float(exact)] * 2, rel=1e-14)
        long = evaluate(tree, {name: np.longdouble(value) for name, value in POINT.items()})
        digits = np.finfo(np.longdouble).eps
        assert type(long) is np.longdouble
        text = np.format_float_scientific(long, precision=25, unique=False)
        assert abs(mpmath.mpf(text) - exact) < 20 * digits * abs(exact)


@pytest.mark.parametrize("name", NAMES)
def test_a_complex_step_is_the_derivative(name: str) -> None:
    stepped = POINT | {name: np.array([POINT[name] + 1e-100j])}
    with mpmath.workdps(40):
        slope = mpmath.diff(lambda x: exactly(**{name: x}), POINT[name])
    value = evaluate(expression.parse_expression(NESTED, NAMES), stepped)
    assert value.imag[0] / 1e-100 == pytest.approx(float(slope), rel=1e-13)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_of_a_series_has_the_coefficients_of_the_books(name: str) -> None:
    """Of arrays, too: x = 0.7 - 1.3 s + 0.4 s^3 and one that does not change."""
    c = np.array([[0.7, 2.0], [-1.3, 0.0], [0.0, 0.0], [0.4, 0.0]])
    series = Series(lambda k: c[k] if k < 4 else np.zeros(2))
    found = getattr(arithmetic, name)(series)
    of = mpmath.ln if name == "log" else getattr(mpmath, name)
    with mpmath.workdps(60):
        exact = mpmath.taylor(
            lambda s: of(mpmath.mpf(0.7) - mpmath.mpf(1.3) * s + mpmath.mpf(0.4) * s**3), 0, 15
        )
    assert [found[k][0] for k in range(16)] == pytest.approx([*map(float, exact)], rel=1e-12)
    constant = [getattr(np, name)(2.0), *[0.0] * 15]
    assert [found[k][1] for k in range(16)] == pytest.approx(constant, abs=1e-16)


@pytest.mark.heyoka
def test_an_engines_symbols_and_their_series() -> None:
    hy = pytest.importorskip("heyoka")
    from hodo_cli.engines import taylor

    assert taylor
    symbols = dict(zip(NAMES, hy.make_vars(*NAMES), strict=True))
    tree = expression.parse_expression(NESTED, NAMES)
    of = hy.cfunc([evaluate(tree, symbols)], vars=list(symbols.values()))
    assert of(list(POINT.values()))[0] == pytest.approx(evaluate(tree, POINT), rel=1e-14)
    # As sweeps use it: a series whose coefficients are symbols.
    x = symbols["p"]
    for name in FUNCTIONS:
        function = getattr(arithmetic, name)
        series = function(Series(lambda k: x if k == 0 else 1.0 * (k == 1)))
        numbers = function(Series(lambda k: (0.8, 1.0)[k] if k < 2 else 0.0))
        compiled = hy.cfunc([1.0 * series[k] for k in range(6)], vars=[x])([0.8])
        assert compiled == pytest.approx([numbers[k] for k in range(6)], rel=1e-14)


def test_results_of_numbers_are_infinite_where_they_overflow() -> None:
    with np.errstate(all="ignore"):
        assert np.isnan(arithmetic.sqrt(np.float64(-1)))
        assert np.isinf(arithmetic.exp(np.float64(1000)))
        assert np.isneginf(arithmetic.log(np.float64(0)))
    # A motion that comes where a root has no value fails by itself, whatever its numbers are.
    assert np.isnan(arithmetic.sqrt(-1.0))
    # A switch, 1/(1 + exp((t0 - t)/rise)), has its limit there.
    assert arithmetic.exp(1000.0) == np.inf


def test_a_switch_that_is_far_off_at_the_start_is_met() -> None:
    """0.06/A3 = 0.1 from t = 20 to 30; its exponent is 1000 at first, beyond the largest double."""
    switch, body = "0.06/(1+exp((20-t)/0.02))", {"inertia": [1, 0.8, 0.6], "damping": 0}
    spin = {"initial": {"p": 0, "q": 0, "r": 1}, "time": {"end": 30, "samples": 31}}
    motion = hodo_package.run(case_with(0, **body, **spin) | {"expression": [0, 0, switch]})
    assert motion.attrs["status"] == "ok"
    assert motion.omega.values[-1] == pytest.approx([0, 0, 2], rel=1e-12)


# Columns pass for one number: same digits, same ways, and nothing that mixes members.

COLUMN = st.lists(st.floats(0.1, 1e3), min_size=9, max_size=9)


@given(x=COLUMN, y=COLUMN)
@pytest.mark.parametrize(
    "function",
    [add, sub, mul, truediv, operator.pow, arithmetic.hypot, arithmetic.power],
)
def test_columns_have_the_digits_of_numbers(function, x, y):
    x[0], y[0] = 0.3, 2.5  # so that no power is too large
    x, y = ([min(each, 30.0) for each in values] for values in (x, y))
    a, b = arithmetic.Column(np.array(x)), arithmetic.Column(np.array(y))
    assert function(a, b).values.tolist() == list(map(function, x, y))
    assert function(a, 3).values.tolist() == [function(each, 3) for each in x]
    assert function(0.7, b).values.tolist() == [function(0.7, each) for each in y]
    assert function(np.float64(0.7), b).values.tolist() == [function(0.7, each) for each in y]


@given(x=COLUMN)
def test_functions_of_columns_are_those_of_numbers(x: list[float]) -> None:
    a = arithmetic.Column(np.array(x))
    for name in ("sqrt", "sin", "cos"):
        of, same = getattr(functions, name), getattr(math, name)
        assert of(a).values.tolist() == list(map(same, x))
        assert of(x[0]) == same(x[0])
    assert (-a).values.tolist() == [-each for each in x]
    assert abs(-a).values.tolist() == x
    assert arithmetic.isfinite(a)
    assert not arithmetic.isfinite(math.inf)
    assert (np.float64(1) * a).values.tolist() == x


@pytest.mark.parametrize(
    ("way", "expected"),
    [
        (lambda x: x < 2, [True, False, False]),
        (lambda x: x >= 2, [False, True, True]),
        (lambda x: np.float64(2) > x, [True, False, False]),
        (lambda x: x == 3, [False, False, True]),
        (lambda x: max(x, 1.5), [False, True, True]),
        (lambda x: bool(x - 1), [False, True, True]),
        (lambda x: sorted((x, 2.5)), [False, False, True]),
    ],
)
def test_a_column_parts_where_its_members_go_two_ways(way, expected):
    with pytest.raises(arithmetic.BranchDivergence) as parted:
        way(arithmetic.Column(np.array([1.0, 2.0, 3.0])))
    assert parted.value.where.tolist() in (expected, [not each for each in expected])


WAYS = [lambda x: 1 / x, arithmetic.sqrt, lambda x: x**-1.5, lambda x: 10 ** (500 * x)]


@pytest.mark.parametrize("way", WAYS)
@np.errstate(all="ignore")
def test_a_column_parts_from_what_is_not_finite(way: Callable[[Any], Any]) -> None:
    with pytest.raises(arithmetic.BranchDivergence):
        way(arithmetic.Column(np.array([-1.0, 0.0, 1.0, 2.0])))
    with pytest.raises(TypeError, match="finite"):
        arithmetic.Column(np.array([1.0, 2.0])) * math.nan


@pytest.mark.parametrize(
    "way",
    [
        lambda x: np.array([1.0, 2.0, 3.0]) * x,
        lambda x: x * np.array([1.0, 2.0, 3.0]),
        lambda x: np.longdouble(2) * x,
        lambda x: [1] * x,
        lambda x: x + "1",
        lambda x: x < None,
        *(float, math.sin, np.sin, hash, len, list),
        lambda x: f"{x:g}",
        lambda x: np.isfinite(np.array([x, 1.0])),
        lambda x: np.linalg.norm([x, 1.0]),
        lambda x: np.array([x, 1.0], dtype=float),
    ],
)
def test_what_would_mix_members_is_refused(way: Callable[[Any], Any]) -> None:
    with pytest.raises(TypeError):
        way(arithmetic.Column(np.array([1.0, 2.0, 3.0])))


# Torques by expressions, against SciPy


def by_scipy(
    A: list[float], start: Any, times: np.ndarray, torque: Callable[..., Any]
) -> np.ndarray:
    """omega and attitude (n, 7) under a torque of t, omega and the rotation to space."""
    inertia = np.array(A)

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        w, (a, b, c, d) = y[:3], y[3:]
        p, q, r = w
        turn = [-b * p - c * q - d * r, a * p + c * r - d * q, a * q + d * p - b * r,
                a * r + b * q - c * p]  # fmt: skip
        to_space = Rotation.from_quat(y[3:], scalar_first=True).as_matrix()
        N = np.array(torque(t, w, to_space))
        return np.append((N - np.cross(w, inertia * w)) / inertia, np.array(turn) / 2)

    span, y0 = (times[0], times[-1]), [*start, 1, 0, 0, 0]
    return solve_ivp(rates, span, y0, "DOP853", times, rtol=3e-14, atol=1e-17).y.T


def test_constants_and_expressions_as_coefficients_are_the_torques_they_say() -> None:
    a, w, k, A = 0.02, 0.5, 0.01, [2.0, 1.5, 1.0]
    case = case_with("a*sin(w*t)") | {
        "constants": {"a": a, "w": w, "k": k},
        "damping": [0.003, "0.004*exp(-k*t)", "k"],
        "quadratic": "k*(1 + tanh(t - 5))",
        "torque": [0, "a*cos(w*t)", 0],
        "time": {"end": 20, "samples": 21},
    }
    motion = hodo_package.run(case)

    def torque(t: float, omega: np.ndarray, _: np.ndarray) -> np.ndarray:
        G, speed = np.array(A) * omega, np.linalg.norm(omega)
        of_damping = np.array([0.003, 0.004 * np.exp(-k * t), k]) * G
        of_drag = k * (1 + np.tanh(t - 5)) * speed * G
        return np.array([a * np.sin(w * t), a * np.cos(w * t), 0]) - of_damping - of_drag

    true = by_scipy(A, case["initial"].values(), motion.time.values, torque)[:, :3]
    assert motion.omega.values == pytest.approx(true, abs=1e-12)
    swept = hodo_package.sweep({**case, "sweep": {"constants.w": {"values": [0.4, 0.5]}}})
    assert swept.omega.values[1] == pytest.approx(true[-1], abs=1e-12)
    assert np.abs(np.diff(swept.omega.values, axis=0)).max() > 1e-3


def test_a_satellite_under_gravity_follows_the_axes_of_space() -> None:
    A, n = [3.0, 2.0, 1.5], 0.05
    e = [f"(cos(n*t)*y{i} + sin(n*t)*z{i})" for i in (1, 2, 3)]
    pairs = ((1, 2), (2, 0), (0, 1))
    gravity = [f"3*n**2*({A[j]} - {A[i]})*{e[i]}*{e[j]}" for i, j in pairs]
    start = {"p": 0.03, "q": -0.02, "r": 0.05}
    case = case_with(0, inertia=A, initial=start, damping=0, constants={"n": n}, attitude=True)
    case |= {"expression": gravity, "time": {"end": 250, "samples": 26}}
    motion = hodo_package.run(case)

    def torque(t: float, omega: np.ndarray, R: np.ndarray) -> np.ndarray:
        vertical = R.T @ [0, np.cos(n * t), np.sin(n * t)]
        return 3 * n**2 * np.cross(vertical, np.array(A) * vertical)

    true = by_scipy(A, start.values(), motion.time.values, torque)
    assert motion.omega.values == pytest.approx(true[:, :3], abs=1e-12)
    assert motion.attitude.values == pytest.approx(true[:, 3:], abs=1e-12)


def test_t_counts_from_the_epoch_and_a_span_may_run_backward() -> None:
    case = case_with("a*sin(w*t)") | {"constants": {"a": 0.02, "w": 0.5}}
    forward = hodo_package.run(case)
    span = {"start": 60310, "end": 60320, "samples": 11}
    late = hodo_package.run(case | {"time": {**span, "epoch": 60310}})
    assert late.omega.values.tolist() == forward.omega.values.tolist()
    assert late.time.values[0] == 60310
    unsaid = hodo_package.run(case | {"time": span})
    assert "t counts from 0, 6031 spans before start: write epoch: 60310" in unsaid.warnings
    end = dict(zip("pqr", forward.omega.values[-1].tolist(), strict=True))
    back = hodo_package.run(case | {"initial": end, "time": {"start": 10, "end": 0, "samples": 11}})
    assert back.time.values.tolist() == forward.time.values[::-1].tolist()
    assert back.omega.values[::-1] == pytest.approx(forward.omega.values, abs=1e-13)


def test_a_crossing_is_met_in_the_order_of_the_samples() -> None:
    case = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "damping": [0.005, 0.004, 0.003]}
    case |= {"initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 400, "samples": 401}}
    forward = hodo_package.run(case)
    end = dict(zip("pqr", forward.omega.values[-1].tolist(), strict=True))
    span = {"start": 400, "end": 0, "samples": 401}
    back = hodo_package.run(case | {"initial": end, "time": span})
    assert back.crossing_time.values == pytest.approx(forward.crossing_time.values, abs=1e-9)
    assert back.crossing_from.values == forward.crossing_to.values
    assert back.enclosed_axis.values[::-1].tolist() == forward.enclosed_axis.values.tolist()


def test_a_coefficient_that_turns_negative_is_told_with_its_time() -> None:
    motion = hodo_package.run(case_with("0") | {"damping": "0.1*cos(0.3*t)"})
    assert "damping is negative from t = 5.2" in motion.warnings


def test_a_formula_is_a_curve_of_its_own(hodo: Hodo, tmp_path: Path) -> None:
    """Drawn at the samples of each case, and in the CSV file as it is drawn."""
    (tmp_path / "a.yaml").write_text("""
cases: {a: {model: linear-diag, inertia: [1, 0.8, 0.6], damping: 0.1, initial: {p: 1, q: 0, r: 0},
            time: {end: 4, samples: 5}}}
figures: {f: {kind: series, cases: a, variables: [p, T], formula: {T: exp(-0.2*t)/2 + 0*p}}}
""")
    assert hodo("run", "a.yaml").returncode == 0
    done = hodo("plot", "a.yaml", "--format", "csv")
    assert done.returncode == 0, done.stderr
    lines = (tmp_path / "runs" / "figures" / "a" / "f.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines if "exp(-0.2*t)" in line]
    values = np.array([[float(row[-3]), float(row[-1])] for row in rows])
    np.testing.assert_allclose(values[:, 1], np.exp(-0.2 * values[:, 0]) / 2, rtol=1e-15)
    assert values[:, 0].tolist() == [0, 1, 2, 3, 4]
