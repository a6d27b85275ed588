"""A body that moves: in print, in a page that plays it, in a notebook and as a film."""

import base64
import html
import json
import math
import re
import shutil
from itertools import combinations
from pathlib import Path
from typing import Any

import matplotlib.style
import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from conftest import call
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

import hodo_cli as hodo
from hodo_cli.figures.kinds.body import (
    draw_moment,
    film_panel,
    pictures,
)
from hodo_cli.figures.sheet import SHEET_STYLE
from hodo_cli.figures.words import place_words

pytest_plugins = ("browser",)

CONFIG = """
title: Bodies
defaults: {model: linear-diag, inertia: [1, 0.8, 0.6], attitude: {align: G}}
cases:
  flip: {initial: {p: 1.0e-4, q: 1, r: 1.0e-4}, time: {end: 60, samples: 601, unit: s}}
  long:
    initial: {p: 0.8, q: 0.5, r: 0.74}
    damping: 0.001
    time: {end: 100, samples: 20001, unit: s}
  blind: {initial: {p: 0.8, q: 0.5, r: 0.74}, attitude: no, time: {end: 10}}
figures:
  flip: {kind: body, cases: flip, moments: [0, 24, 60], caption: "a </script> turn", seconds: 1.5}
  part: {kind: body, cases: long, span: [10, 90], seconds: 1.5}
  plane: {kind: phase, cases: flip, x: p, y: q}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bodies")
    (folder / "c.yaml").write_text(CONFIG, encoding="utf-8")
    assert call(folder, "run", "c.yaml", "--quiet").returncode == 0
    assert call(folder, "classify", "c.yaml").returncode == 0
    formats = [word for name in ("png", "csv", "html", "gif") for word in ("--format", name)]
    done = call(folder, "plot", "c.yaml", *formats)
    assert done.returncode == 0, done.stderr
    return folder


def film_in(folder: Path, name: str) -> dict[str, Any]:
    """What the page of a film knows, its numbers by parts."""
    text = (folder / "runs" / "figures" / "c" / f"{name}.html").read_text(encoding="utf-8")
    (line,) = re.findall("^const data = (.*);$", text, re.MULTILINE)
    film = json.loads(line)

    def numbers(text: str, width: int) -> np.ndarray:
        return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, width)

    film |= {"time": numbers(film["time"], 1)[:, 0], "attitude": numbers(film["attitude"], 4)}
    for part in film["parts"]:
        part["points"] = numbers(part["points"], 3)
    return dict(film)


def test_a_film_shows_the_stored_motion(folder: Path) -> None:
    film, data = film_in(folder, "flip"), hodo.open(folder / "runs" / "c.h5")["flip"]
    np.testing.assert_allclose(film["time"], data.time, atol=1e-5)
    np.testing.assert_allclose(film["attitude"], data.attitude, atol=1e-6)
    parts = {part["name"]: part for part in film["parts"] if part["name"]}
    A, omega = np.array([1, 0.8, 0.6]), data.omega.values
    G = A * omega
    # Without a torque G stays in space, here along z; it is 1 in the picture.
    np.testing.assert_allclose(parts["G"]["points"], np.tile([0, 0, 1], (601, 1)), atol=1e-6)
    trails = {part["of_body"]: part["points"] for part in film["parts"] if part["role"] == "trail"}
    np.testing.assert_allclose(trails[True], G / np.linalg.norm(G, axis=1).max(), atol=1e-6)
    # omega in space lies in the plane across G.
    assert np.ptp(trails[False][:, 2]) < 1e-6
    np.testing.assert_array_equal(trails[False], parts["ω"]["points"])
    # Behind a turn about the middle axis the body stands on its head.
    a, b, c, d = film["attitude"].T
    upright = 2 * (c * d + a * b)  # the z of x2
    assert upright[0] > 0.99
    assert upright.min() < -0.99


def test_the_box_has_the_moments_of_the_body(folder: Path) -> None:
    faces = [part["points"] for part in film_in(folder, "flip")["parts"] if part["role"] == "face"]
    assert len(faces) == 6
    a, b, c = np.concatenate(faces).max(axis=0) ** 2
    moments = np.array([b + c, a + c, a + b])
    np.testing.assert_allclose(moments / moments[0], [1, 0.8, 0.6], rtol=1e-6)


def test_the_box_of_a_full_tensor_is_turned_with_it() -> None:
    """The same body in axes that are turned by 30 degrees about x3."""
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    omega = turn @ [0.8, 0.5, 0.74]
    J = turn @ np.diag([1, 0.8, 0.6]) @ turn.T
    motion = hodo.run(
        {
            "model": "torques",
            "inertia": ((J + J.T) / 2).tolist(),
            "kappa": 0.01,
            "attitude": "yes",
            "initial": dict(zip("pqr", omega.tolist(), strict=True)),
            "time": {"end": 10, "samples": 201},
        }
    )
    figure = hodo.plot(motion, kind="body")
    parts = figure.film.parts
    corners = np.concatenate([part.points for part in parts if part.role == "face"]) @ turn
    a, b, c = corners.max(axis=0) ** 2
    moments = np.array([b + c, a + c, a + b])
    np.testing.assert_allclose(moments / moments[0], [1, 0.8, 0.6], rtol=1e-6)
    # What body and fluid keep together is the same vector in any axes.
    names = [f"total_space.{axis}" for axis in "xyz"]
    panels = hodo.plot(motion, kind="series", variables=names).axes
    total = np.stack([panel.lines[0].get_ydata() for panel in panels], axis=-1)
    assert np.linalg.norm(total - total[0], axis=1).max() < 1e-4


def test_a_page_of_a_film_is_small_and_asks_no_network(folder: Path) -> None:
    for name in ("flip", "part"):
        text = (folder / "runs" / "figures" / "c" / f"{name}.html").read_text(encoding="utf-8")
        assert len(text) < 300_000
        assert "http" not in text
        assert text.count("</script>") == 1
    film = film_in(folder, "part")
    assert film["start"] == 10
    assert film["time"][-1] == pytest.approx(80, abs=1e-3)  # where the span ends
    assert 2000 < len(film["time"]) <= 3003  # with the moments that are printed


def test_films_are_written_by_the_ends_of_their_names(folder: Path, tmp_path: Path) -> None:
    with Image.open(folder / "runs" / "figures" / "c" / "flip.gif") as film:
        assert film.n_frames == 30
        assert film.info["duration"] == 50
        # The arrow of G is thin, and keeps its red among the areas.
        for i in (1, 15, 28):
            film.seek(i)
            pixels = np.asarray(film.convert("RGB"), dtype=int)
            assert (np.abs(pixels - (213, 94, 0)).max(axis=-1) < 30).sum() > 5
    # A kind that does not move has no film among all figures; asked for by name it is a mistake.
    assert not (folder / "runs" / "figures" / "c" / "plane.gif").exists()
    done = call(folder, "plot", "c.yaml", "plane", "--format", "gif")
    assert done.returncode == 2
    assert "plane does not move" in done.stderr
    figure = hodo.plot(hodo.open(folder / "runs" / "c.h5")["flip"], kind="body", seconds=0.2)
    figure.savefig(tmp_path / "mine.gif")
    with Image.open(tmp_path / "mine.gif") as film:
        assert film.n_frames == 4
    figure.savefig(tmp_path / "mine.png")
    assert Image.open(tmp_path / "mine.png").format == "PNG"


def test_a_picture_of_a_film_is_that_of_all_that_is_drawn(folder: Path) -> None:
    """What lasts is drawn once for all pictures, and what moves is on none but its own."""
    film = hodo.plot(hodo.open(folder / "runs" / "c.h5")["flip"], kind="body").film
    with matplotlib.style.context(["default", SHEET_STYLE]):
        quick = [np.asarray(picture) for picture in pictures(film, 3)]
        for sample, picture in zip((0, 300, 600), quick, strict=True):
            figure, axes = film_panel()
            draw_moment(axes, film, sample)
            place_words(figure, hiding=True)
            canvas: Any = FigureCanvasAgg(figure)
            canvas.draw()
            whole = np.asarray(canvas.buffer_rgba())[..., :3].astype(int)
            assert (np.abs(whole - picture).max(axis=-1) > 8).mean() < 1e-3


def test_names_of_arrows_that_meet_stand_apart() -> None:
    """In print, where panels are narrow, too: of a body that turns about G three arrows meet."""
    body = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "attitude": {"align": "G"}}
    data = hodo.run(body | {"initial": {"p": 0, "q": 1e-3, "r": 1}, "time": {"end": 3}})
    figure = hodo.plot(data, kind="body", moments=[0, 1, 2, 3])
    figure.draw_without_rendering()
    for axes in figure.axes:
        names = {text.get_text(): text.get_window_extent() for text in axes.texts}
        names.pop("")  # arrows are texts, too
        assert {"$G$", "$ω$", "$x_3$", "$z$"} <= {*names}
        assert not any(a.overlaps(b) for a, b in combinations(names.values(), 2))


def test_without_ffmpeg_a_line_says_so(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    done = call(folder, "plot", "c.yaml", "flip", "--format", "mp4")
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "flip: MP4 needs ffmpeg, which is not installed; GIF needs no other program"
    ]


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_ffmpeg_writes_a_film(folder: Path) -> None:
    assert call(folder, "plot", "c.yaml", "flip", "--format", "mp4").returncode == 0
    film = (folder / "runs" / "figures" / "c" / "flip.mp4").read_bytes()
    assert film[4:8] == b"ftyp"


def test_a_notebook_plays_it(folder: Path) -> None:
    data = hodo.open(folder / "runs" / "c.h5")["flip"]
    frame = hodo.plot(data, kind="body")._repr_html_()
    assert frame.startswith("<iframe srcdoc=")
    assert "const data = {" in html.unescape(frame)
    assert len(frame) < 300_000
    assert hodo.plot(data, kind="phase", x="p", y="q")._repr_html_() is None


@pytest.mark.parametrize(
    ("figure", "line"),
    [
        ("{kind: body, cases: [flip, long]}", "expected one case, whose body moves, got 2"),
        ("{kind: body, cases: blind}", "has no attitude, which body needs"),
        ("{kind: herpolhode, cases: blind}", "has no attitude, which herpolhode needs"),
        ("{kind: axis-trace, cases: flip, axes: [x4]}", "x4"),
        ("{kind: body, cases: flip, seconds: 0}", "seconds"),
        ("{kind: body, cases: flip, moment: 1}", "did you mean 'moments'"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, figure: str, line: str) -> None:
    text = CONFIG.partition("figures:")[0] + f"figures:\n  wrong: {figure}\n"
    (tmp_path / "c.yaml").write_text(text)
    done = call(tmp_path, "run", "c.yaml")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("c.yaml:12:")
    assert line in done.stderr


def test_a_trace_names_its_curves_and_marks_both_ends(folder: Path) -> None:
    runs = hodo.open(folder / "runs" / "c.h5")
    axes = ["x1", "x3"]
    figure = hodo.plot(runs["flip"], kind="axis-trace", axes=axes)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "$x_1$", "$x_3$", "start", "end, $t = 60$ s"
    ]  # fmt: skip
    panel = figure.axes[0]
    names = {text.get_text(): text.get_color() for text in panel.texts}
    lines = legend.get_lines()
    assert [names["$x_1$"], names["$x_3$"]] == [line.get_color() for line in lines[:2]]
    assert len([line for line in panel.lines if line.get_marker() == "s"]) == 2
    coloured = hodo.plot(runs["flip"], kind="axis-trace", axes=axes, colour="time")
    assert [text.get_text() for text in coloured.legends[0].get_texts()][:1] == ["start"]
    both = hodo.plot([runs["flip"], runs["long"]], kind="axis-trace", axes=["x1"])
    assert [text.get_text() for text in both.legends[0].get_texts()][:2] == [
        "$x_1$, flip", "$x_1$, long"
    ]  # fmt: skip


@pytest.mark.parametrize(("attitude", "of_one", "of_two"), [
    ({"align": "G"}, "$G$ at the start", "each $G$ at the start"),
    ("yes", "$G$ at the start, along $z'$", "each $G$ at the start, along its $z'$"),
])  # fmt: skip
def test_a_herpolhode_says_along_what_it_looks(attitude: Any, of_one: str, of_two: str) -> None:
    case = {"model": "linear-diag", "inertia": [1, 0.8, 0.6], "attitude": attitude,
            "initial": {"p": 0.8, "q": 0.5, "r": 0.74}, "time": {"end": 9}}  # fmt: skip
    motions = [hodo.run(case, name=name) for name in ("one", "two")]
    for data, words in ((motions[0], of_one), (motions, of_two)):
        (legend,) = hodo.plot(data, kind="herpolhode").legends
        assert words in [text.get_text() for text in legend.get_texts()]


def test_other_formats_leave_the_pictures_on_the_page(folder: Path) -> None:
    page = folder / "runs" / "figures" / "index.html"
    images = re.findall(r'<img[^>]* src="([^"]*)"', page.read_text(encoding="utf-8"))
    assert {"c/flip.png", "c/part.png", "c/plane.png"} <= {*images}
    assert call(folder, "plot", "c.yaml", "--format", "html").returncode == 0
    assert re.findall(r'<img[^>]* src="([^"]*)"', page.read_text(encoding="utf-8")) == images


def test_aligned_with_no_momentum_is_warned_of(tmp_path: Path) -> None:
    text = CONFIG.partition("cases:")[0] + (
        "cases: {still: {initial: {p: 0, q: 0, r: 0}, time: {end: 1}}}\n"
    )
    (tmp_path / "c.yaml").write_text(text)
    done = call(tmp_path, "run", "c.yaml")
    assert done.returncode == 0
    assert "still: warning: without a G at the start, z lies along x3 there" in done.stderr


def test_a_moment_is_printed_at_the_sample_next_to_it(folder: Path) -> None:
    """Not at one of the fewer pictures of its film: of 20,001 samples it has 3,000."""
    data = hodo.open(folder / "runs" / "c.h5")["long"]
    for moments in (data.time.values[[7, 5000, 7777]], None):
        keys = {} if moments is None else {"moments": moments.tolist()}
        titles = [axes.get_title() for axes in hodo.plot(data, kind="body", **keys).axes]
        expected = [0, 50, 100] if moments is None else moments
        assert titles == [f"$t = {moment:.6g}$ s" for moment in expected]


def test_a_moment_outside_of_the_motion_is_no_picture(folder: Path) -> None:
    data = hodo.open(folder / "runs" / "c.h5")["flip"]
    with pytest.raises(hodo.HodoError, match="70 is no time of case flip"):
        hodo.plot(data, kind="body", moments=[70])


PIXELS = "document.getElementById('film').toDataURL()"


@pytest.mark.parametrize(("width", "dark"), [(640, False), (390, True)])
def test_it_plays_pauses_scrubs_and_turns(reader, folder: Path, width: int, dark: bool) -> None:
    window = reader(folder / "runs" / "figures" / "c" / "flip.html", width, 800, dark)
    page = window.page
    time = page.get_by_role("status")
    assert time.inner_text() == "t = 0.0000 s"
    pictures = {page.evaluate(PIXELS)}
    for part in (0.4, 0.45):
        page.evaluate(f"moment.value = {part}; moment.dispatchEvent(new Event('input'))")
        pictures.add(page.evaluate(PIXELS))
    assert time.inner_text() == "t = 27.000 s"
    box = page.locator("canvas").bounding_box()
    middle = int(box["x"] + box["width"] / 2), int(box["y"] + box["height"] / 2)
    window.drag(middle, (middle[0] + 60, middle[1] + 30))
    pictures.add(page.evaluate(PIXELS))
    assert len(pictures) == 4
    page.get_by_role("button", name="Play").click()
    page.wait_for_function("document.getElementById('time').textContent !== 't = 27.000 s'")
    page.get_by_role("button", name="Pause").click()
    stopped = time.inner_text()
    page.wait_for_timeout(300)
    assert time.inner_text() == stopped
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert window.is_clean()


def test_the_page_draws_as_print_does(reader, folder: Path) -> None:
    """Tips of arrows are where the printed view has them."""
    page = reader(folder / "runs" / "figures" / "c" / "flip.html", 640, 800).page
    film = film_in(folder, "flip")
    (a, b, c, d) = film["attitude"][240]
    # The body axis x1 in space: the first column of the rotation.
    x1 = np.array([a * a + b * b - c * c - d * d, 2 * (b * c + a * d), 2 * (b * d - a * c)])
    rows = np.array(page.evaluate("times(view(), rotation(240))"))
    e, az = np.radians(film["view"])
    right = np.array([-np.sin(az), np.cos(az), 0])
    up = np.array([-np.sin(e) * np.cos(az), -np.sin(e) * np.sin(az), np.cos(e)])
    np.testing.assert_allclose(rows[:2, 0], [right @ x1, up @ x1], atol=1e-6)


def test_a_checker_has_nothing_serious_against_the_page(reader, folder: Path) -> None:
    page = reader(folder / "runs" / "figures" / "c" / "flip.html").page
    faults = Axe().run(page).response["violations"]
    assert not [fault for fault in faults if fault["impact"] in ("serious", "critical")]
