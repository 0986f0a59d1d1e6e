"""Pages of ours in headless Chromium: what they ask for, what goes wrong, what is drawn."""

import contextlib
import io
import shutil
import time
import types

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
_FLAGS = [
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip
_OWN = ("data:", "blob:", "file:", "http://127.0.0.1:", "ws://127.0.0.1:")
_LONGEST_S = 300.0
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


def picture(shown):
    """Return what a page or an element looks like.

    Chromium that draws in software refuses a capture now and then, on a busy machine.
    """
    error = pytest.importorskip("playwright.sync_api").Error
    deadline = time.monotonic() + _LONGEST_S
    while True:
        try:
            data = shown.screenshot()
            break
        except error as exc:
            if "Unable to capture" not in str(exc) or time.monotonic() > deadline:
                raise
            time.sleep(0.2)
    return pytest.importorskip("PIL.Image").open(io.BytesIO(data)).convert("RGB")


class Watched:
    """A page that keeps a record. errors: of its console and its scripts. strangers: requests that
    leave this machine.
    """

    def __init__(self, page):
        self.page = page
        self.errors, self.strangers = [], []
        page.on("console", lambda m: self.errors.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self._take(request.url))
        page.on("websocket", lambda socket: self._take(socket.url))

    def _take(self, url):
        if not url.startswith(_OWN):
            self.strangers.append(url)

    def colours(self):
        """Return how many colours the page shows now."""
        return len(picture(self.page).getcolors(maxcolors=1 << 24))

    def values(self):
        """Return what all fields of the page hold."""
        return self.page.locator("input").evaluate_all("fields => fields.map(f => f.value)")

    def wait(self, is_done, what):
        """Wait until something is true, however slow this machine is."""
        deadline = time.monotonic() + _LONGEST_S
        while not is_done():
            assert time.monotonic() < deadline, f"waited for {what}; errors: {self.errors}"
            self.page.wait_for_timeout(200)


class Curves:
    """The curves that a page shows, from its charts in the browser."""

    JS = """() => Object.values((window.__viserTestpoints || {}).uplots || {}).map(({chart}) => ({
        names: chart.series.map(s => s.label), data: chart.data.map(d => Array.from(d)),
        x: [chart.scales.x.min, chart.scales.x.max], width: chart.bbox.width}))"""
    PIXELS = """() => { const canvas = document.querySelector(".u-over").parentNode
        .querySelector("canvas"), seen = new Set();
        const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        for (let i = 0; i < data.length; i += 4) if (data[i + 3] === 255)
            seen.add([data[i], data[i + 1], data[i + 2]].join());
        return [...seen] }"""

    def __init__(self, watched):
        self.watched = watched

    def drawn(self):
        """Return the names, data and limits of the chart that is drawn; None without one."""
        charts = [chart for chart in self.watched.page.evaluate(self.JS) if chart["width"] > 0]
        return types.SimpleNamespace(**charts[0]) if charts else None

    def has(self, *names):
        """Return whether curves with these names have data, in the chart that is drawn first."""
        drawn = self.drawn()
        if drawn is None or len(drawn.data[0]) < 2:
            return False
        shown = [name for name in drawn.names[1:] if not name.startswith("\u2060")]
        return [name.lstrip("\u2061\u2062") for name in shown] == list(names)

    def lines(self, name):
        """Return where lines up and down of a kind stand in the chart that is drawn first [s]."""
        drawn = self.drawn()
        row = drawn.data[drawn.names.index(f"\u2060{name}")]
        return [x for x, y in zip(drawn.data[0], row, strict=True) if y == max(row) > min(row)]

    def pick(self, *labels):
        """Choose signals, or leave them out, in the tree of ports, whose folders are open."""
        for label in labels:
            self.watched.page.get_by_role("checkbox", name=label, exact=True).click()

    def colours(self):
        """Return the colours of the chart's canvas, red, green, blue."""
        return set(self.watched.page.evaluate(self.PIXELS))


@contextlib.contextmanager
def opened(address, width=800, height=600, scheme="light"):
    """Yield an address of ours in Chromium, watched."""
    with pytest.importorskip("playwright.sync_api").sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=_FLAGS)
        try:
            context = browser.new_context(viewport={"width": width, "height": height})
            watched = Watched(context.new_page())
            watched.page.emulate_media(color_scheme=scheme)
            watched.page.set_default_timeout(1000 * _LONGEST_S)
            watched.page.goto(address)
            yield watched
        finally:
            browser.close()


@pytest.fixture
def page():
    """A page of ours, served and closed at the end."""
    from stepbus_tools.viewing.door import open_page  # noqa: PLC0415  (it loads viser)

    page = open_page("test")
    yield page
    page.close()
