"""A headless Chromium of the system's, for pages as a reader sees and handles them."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)

# WebGL is drawn by the processor: machines that test have no other.
OPTIONS = ["--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader"]

PATIENCE = 120_000
"""Milliseconds for an answer beside other work."""


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """The browser; a test without it is skipped, which the last lines of a run say."""
    if CHROMIUM is None:
        pytest.skip("needs Chromium (Debian: apt-get install chromium)")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield browser
        browser.close()


class Reader:
    """A page that is open, with the addresses that it has asked for and its errors."""

    def __init__(self, page: Page, path: Path) -> None:
        self.page, self.requests, self.errors = page, [], []
        page.set_default_timeout(PATIENCE)
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.goto(path.resolve().as_uri())

    def drag(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Press the mouse at one point, move it to another, and let go."""
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(*end, steps=8)
        self.page.mouse.up()

    def is_clean(self) -> bool:
        """Whether no error came, and nothing from elsewhere was asked for."""
        own = all(url.startswith(("file:", "data:", "blob:")) for url in self.requests)
        return own and not self.errors


@pytest.fixture
def reader(chromium: Browser) -> Iterator[type]:
    """`open_page(path, width, height, dark)`: a window on a file."""
    pages = []

    def open_page(path: Path, width: int = 1400, height: int = 900, dark: bool = False) -> Reader:
        scheme = "dark" if dark else "light"
        size = {"width": width, "height": height}
        pages.append(chromium.new_page(viewport=size, color_scheme=scheme))
        return Reader(pages[-1], path)

    yield open_page
    for page in pages:
        page.close()
