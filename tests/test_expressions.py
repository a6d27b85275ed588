"""Formulas of a case file: what is read has the value that Python gives it, whatever passes for a
number; what is hostile is refused with its column, and nothing of it is ever run.

HODO_FUZZ sets the number of random texts (default 2000).
"""

import builtins
import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from conftest import Hodo, counted

import hodo_cli
from hodo_cli import HodoError, arithmetic
from hodo_cli.arithmetic import evaluate
from hodo_cli.engines import series as power_series
from hodo_cli.engines.series import Series
from hodo_cli.schema import expression, kinds

NAMES = ("p", "q", "r", "t")
COUNT = int(os.environ.get("HODO_FUZZ", "2000"))
NESTED = "sin(exp(-0.3*p)*q) - sqrt(p**2+q**2+r**2)/(2-cos(0.1*t)) + (p*q)**-3 - +r**7/1.5e1"


def refusal(text: Any, names: tuple[str, ...] = NAMES) -> str:
    """What a text is refused with."""
    with pytest.raises(kinds.Wrong) as refused:
        expression.Expression(names).check(text)
    return str(refused.value)


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
        ("   ", 4, "missing"),
        ("p +", 4, "missing"),
        ("p q", 3, "missing"),
        ("(p", 1, "never closed"),
        (" p)", 3, "unmatched"),
        ("  p + 1/0", 7, "division by 0"),
        ("p^2", 2, "a power is **"),
        ("2p", 1, "a product is written with its *"),
        ("p + 0x1F", 5, "not a decimal number"),
        ("0b1", 1, "not a decimal number"),
        ("1_0", 1, "not a decimal number"),
        ("1j", 1, "not a decimal number"),
        ("007", 1, "not a decimal number"),
        ("1or p", 1, "not a decimal number"),
        ("p + 1e999", 5, "too large"),
        ("9" * 400, 1, "too large"),
        ("1/(1-1)", 1, "division by 0"),
        ("q + p/0.0", 5, "division by 0"),
        ("p + sqrt(-1)", 5, "sqrt(-1) is not a finite number"),
        ("exp(999)", 1, "not a finite number"),
        ("1e300*1e300", 1, "not a finite number"),
        ("0**-1", 1, "not a finite number"),
        ("True", 1, "unknown name"),
        ("None", 1, "unknown name"),
        ("pp", 1, "did you mean 'p'"),
        ("2*pi", 3, "unknown name 'pi'; write 3.141592653589793 (valid: p, q"),
        ("p + pz", 5, "unknown name 'pz' (valid: p, q"),
        ("p if q else r", 3, "unknown name"),
        ("lambda: 0", 1, "unknown name"),
        ("p # comment", 3, "unexpected '#'"),
        ("p\n", 2, "unexpected"),
        ("p\0", 2, "unexpected"),
        ("ｐ", 1, "unexpected"),  # a full-width p, which Python's parser turns into p
        ("p*²", 3, "unexpected"),
        ("١", 1, "unexpected"),  # an Arabic digit one
        ("p.real", 1, "unknown name"),
        ("p.__class__", 2, "unexpected"),
        ("__import__('os').system('true')", 1, "unexpected"),
        ("[p]", 1, "unexpected"),
        ("{p}", 1, "unexpected"),
        ("p, q", 2, "unexpected"),
        ("p; q", 2, "unexpected"),
        ("p := 1", 3, "unexpected"),
        ("p == q", 3, "unexpected"),
        ("p @ q", 3, "unexpected"),
        ("~p", 1, "unexpected"),
        ("'p'", 1, "unexpected"),
        ("sin(p, q)", 6, "unexpected"),
        ("eval(p)", 1, "unknown name"),
        ("abs(p)", 1, "unknown name"),
        ("p // q", 1, "expected a number"),
        ("sin", 1, "expected a number"),
        ("q*sin", 3, "expected a number"),
        ("sin()", 1, "expected a number"),
        ("sin(*p)", 5, "expected a number"),
        ("sin(**p)", 1, "expected a number"),
        ("p(q)", 1, "expected a number"),
        ("2(p)", 1, "expected a number"),
        ("(p)(q)", 1, "expected a number"),
        ("()", 1, "expected a number"),
        ("9**9**9**9", 4, "from -16 to 16"),
        ("p**17", 4, "from -16 to 16"),
        ("p**2.0", 4, "from -16 to 16"),
        ("p**(1+1)", 5, "from -16 to 16"),
        ("p**q", 4, "from -16 to 16"),
        ("p**--2", 4, "from -16 to 16"),
        ("p**1e1", 4, "from -16 to 16"),
        ("(" * 220 + "p" + ")" * 220, 201, "too many nested"),
        ("-" * 30 + "p", 31, "nested more than"),
        ("+".join("p" * 101), 1, "201 numbers, names and operations"),
        ("p" + " " * 500, 501, "longer than 500"),
    ],
)
def test_what_is_no_formula_is_refused_with_its_column(text: str, column: int, said: str) -> None:
    message = refusal(text)
    assert message.startswith(f"column {column} of the expression: ")
    assert said in message


@pytest.mark.parametrize("value", [True, None, float("inf"), 10**400, ["p"], {"p": 1}])
def test_what_is_no_text_and_no_number_is_refused(value: Any) -> None:
    assert refusal(value).startswith("expected an expression in p, q, r, t, got ")


def test_a_number_is_an_expression_and_the_names_are_the_callers() -> None:
    assert expression.Expression(NAMES).check(-2) == "-2.0"
    assert expression.Expression(NAMES).check(1e-5) == "1e-05"
    assert expression.parse_expression("1e-05", NAMES) == 1e-5
    assert expression.Expression(("u1", "G_z")).check("u1 - G_z/2") == "u1 - G_z/2"
    assert "valid: u1, G_z, sqrt" in refusal("p", ("u1", "G_z"))


def test_constants_are_folded_and_long_sums_are_not_nested() -> None:
    assert expression.parse_expression("-(1/4+sqrt(4)*2**-1)", NAMES) == -1.25
    assert expression.parse_expression("2*3*p", NAMES) == ("*", 6.0, "p")
    assert expression.parse_expression("-p**2", NAMES) == ("neg", ("**", "p", 2))
    assert evaluate(expression.parse_expression("+".join("p" * 100), NAMES), {"p": 1.5}) == 150
    assert expression.parse_expression("(" * 40 + "p" + ")" * 40, NAMES) == "p"


def formula(draw: random.Random, depth: int) -> str:
    """A random formula that is right by the grammar."""
    if depth == 0 or draw.random() < 0.2:
        return draw.choice([*NAMES, *NAMES, "2", "0.5", "1.25e0", ".75", "3."])
    x = formula(draw, depth - 1)
    match draw.randrange(8):
        case 0:
            return f"{draw.choice('-+')} {x}"
        case 1:
            return f"({x}) **{draw.choice(['2', '3', '-2', '-(1)', '0', '+4'])}"
        case 2:
            return f"{draw.choice(['sin', 'cos'])}({x})"
        case 3:
            return f"exp(-({x})**2)"
        case 4:
            return f"sqrt(1+({x})**2)"
    return f"({x}) {draw.choice('+-*/')} {formula(draw, depth - 1)}"


@np.errstate(all="ignore")
def test_the_value_is_that_of_python() -> None:
    draw, tried = random.Random(1), 0
    values = {name: np.random.default_rng(i).normal(size=5) for i, name in enumerate(NAMES)}
    functions = {name: getattr(np, name) for name in ("sin", "cos", "exp", "sqrt")}
    for _ in range(600):
        text = formula(draw, 4)
        tree, message = read(text)
        if message:
            assert any(
                x in message for x in ("division by 0", "finite", "longer", "and operations")
            )
            continue
        tried += 1
        expected = eval(text, functions | {name: x.copy() for name, x in values.items()})
        # Powers by products instead of `pow`; a difference of near numbers shows it larger.
        close = np.isclose(evaluate(tree, values), expected, rtol=1e-9, atol=1e-9, equal_nan=True)
        assert close.all(), text
    assert tried > 400


WORDS = ["p", "q", "t", "sin", "sqrt(", "(", ")", "(", ")", "+", "-", "*", "/", "**", "2", "16",
         "0.5", "1e3", ".", "e", " ", "_", "0x", "j", ",", "if", "lambda", "'", "#", "=", ":",
         "\n", "ｐ", "\u200b", "9" * 60, "__class__", "True", "[", "~", "^", "%"]  # fmt: skip
TOKENS = ["p", "q", "2", "0.5", "(", ")", "+", "-", "*", "/", "**2", "sin(", "exp("]


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


def exactly(text: str, values: dict[str, Any]) -> Any:
    """The value in mpmath, by Python's own reading of the text."""
    functions = {name: getattr(mpmath, name) for name in ("sin", "cos", "exp", "sqrt")}
    constants = {"1.5e1": "mpf(15)", "0.3": f"mpf({0.3!r})", "0.1": f"mpf({0.1!r})"}
    for decimal, double in constants.items():
        text = text.replace(decimal, double)
    return eval(text, functions | {"mpf": mpmath.mpf} | values)


def precise(**changed: Any) -> dict[str, Any]:
    return {name: mpmath.mpf(value) for name, value in POINT.items()} | changed


def test_numbers_arrays_and_long_doubles() -> None:
    tree = expression.parse_expression(NESTED, NAMES)
    with mpmath.workdps(40):
        exact = exactly(NESTED, precise())
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
        slope = mpmath.diff(lambda x: exactly(NESTED, precise(**{name: x})), POINT[name])
    value = evaluate(expression.parse_expression(NESTED, NAMES), stepped)
    assert value.imag[0] / 1e-100 == pytest.approx(float(slope), rel=1e-13)


def test_a_series_has_the_coefficients_of_the_composed_function() -> None:
    """p, q, r polynomials of the time t = 3 + s, one of them without a constant."""
    polynomials: dict[str, list[float]] = {
        "p": [0.8, 0.3, -0.2], "q": [-0.5, 1.0], "r": [0.0, 0.7, 0.1], "t": [3.0, 1.0],
    }  # fmt: skip
    values = {name: Series(rule(c)) for name, c in polynomials.items()}
    found = evaluate(expression.parse_expression(NESTED, NAMES), values)
    with mpmath.workdps(60):

        def composed(s: Any) -> Any:
            at = {
                name: sum(mpmath.mpf(x) * s**i for i, x in enumerate(c))
                for name, c in polynomials.items()
            }
            return exactly(NESTED, at)

        expected = [float(c) for c in mpmath.taylor(composed, 0, 12)]
    assert [found[k] for k in range(13)] == pytest.approx(expected, rel=1e-11)


def rule(c: list[Any]) -> Callable[[int], Any]:
    return lambda k: c[k] if k < len(c) else 0.0


@pytest.mark.parametrize("name", ["exp", "log", "sin", "cos", "sqrt"])
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


def test_a_motion_with_functions_is_its_series() -> None:
    """y' = -sin(y) from pi/2: tan(y/2) = exp(-t); z' = exp(-z): z = log(1 + t)."""
    _, (y, z) = power_series.motion(
        lambda t, y, k: (-arithmetic.sin(y[0]), arithmetic.exp(-y[1])), 0.0, [np.pi / 2, 0.0], None
    )
    with mpmath.workdps(40):
        angle = mpmath.taylor(lambda t: 2 * mpmath.atan(mpmath.exp(-t)), 0, 15)
    assert [y[k] for k in range(16)] == pytest.approx([*map(float, angle)], abs=1e-15)
    assert [z[k] for k in range(1, 16)] == pytest.approx(
        [(-1) ** (k + 1) / k for k in range(1, 16)]
    )


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
    for name in ("exp", "log", "sin", "cos", "sqrt"):
        series = getattr(arithmetic, name)(
            Series(lambda k: x if k == 0 else 1.0 if k == 1 else 0.0)
        )
        numbers = getattr(arithmetic, name)(Series(rule([0.8, 1.0])))
        compiled = hy.cfunc([1.0 * series[k] for k in range(6)], vars=[x])([0.8])
        assert compiled == pytest.approx([numbers[k] for k in range(6)], rel=1e-14)


def test_the_size_of_a_number_is_given_and_a_corner_is_refused() -> None:
    x = np.array([-2.0, 3.0])
    assert arithmetic.abs(-2) == 2
    assert arithmetic.abs(x).tolist() == [2, 3]
    step = arithmetic.abs(x + 1e-100j)
    assert (step.real.tolist(), (step.imag * 1e100).tolist()) == ([2, 3], [-1, 1])
    assert arithmetic.abs(arithmetic.Column(x)).values.tolist() == [2, 3]
    with pytest.raises(HodoError, match="corner"):
        arithmetic.abs(Series(rule([1.0])))


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
    motion = hodo_cli.run(
        {
            "model": "torques",
            "inertia": [1, 0.8, 0.6],
            "expression": [0, 0, "0.06/(1+exp((20-t)/0.02))"],
            "initial": {"p": 0, "q": 0, "r": 1},
            "time": {"end": 30, "samples": 31},
        }
    )
    assert motion.attrs["status"] == "ok"
    assert motion.omega.values[-1] == pytest.approx([0, 0, 2], rel=1e-12)


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
