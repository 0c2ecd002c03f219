"""A person at a page of the workbench: pointer, keys and fingers in a real browser, and questions without one."""

from __future__ import annotations

import http.client
import json
import threading
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from jumpvision.browser.workbench.server import Server
from tests.worlds.recorded import RULER

LIMIT_S = 60.0  # of waiting for an event that comes within a second on an idle machine
WAITED = """async () => { const end = performance.now() + %g;
  while (!(%s)) { if (performance.now() > end) return false; await new Promise((r) => setTimeout(r, 15)); }
  return true; }"""  # waits in the page: playwright's own waiting needs eval, which the pages' policy forbids
AXE = "axe_playwright_python.sync_playwright"


def until(what) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + LIMIT_S
    while not what():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)


def wait_in(page, what: str) -> None:
    """Wait until a condition in JavaScript holds on a page."""
    assert page.evaluate(WAITED % (1e3 * LIMIT_S, what)), f"waited too long for {what}"


@contextmanager
def serving(path: Path, study: str = "") -> Iterator[Server]:
    """Serve the workbench of a path."""
    server = Server(path, 0, study)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server
    finally:
        server.close()


def asked(server: Server, path: str, question: Any = None, root: str = "", **headers: str) -> tuple[int, Any]:
    """Ask a server and return its status and answer; a question of bytes is sent as it is."""
    c = http.client.HTTPConnection("127.0.0.1", server.port, timeout=LIMIT_S)
    path = (root or server.root) + path.removeprefix("/")
    if question is None:
        c.request("GET", path, headers=headers)
    else:
        body = question if isinstance(question, bytes) else json.dumps(question)
        c.request("POST", path, body, {"Content-Type": "application/json"} | headers)
    reply = c.getresponse()
    content, kind = reply.read(), reply.headers.get_content_type()
    c.close()
    return reply.status, json.loads(content) if kind == "application/json" else content


class Hand:
    """A page that is worked by hand; clicks are counted (a drag is one), what its console says is kept."""

    def __init__(self, page, server: Server) -> None:
        self.page, self.server, self.clicks, self.said = page, server, 0, []
        self.key = page.keyboard.press
        page.on("console", lambda m: self.said.append(m.text))
        page.on("pageerror", lambda e: self.said.append(str(e)))
        page.goto(server.address)
        self.ready()

    def ready(self) -> None:
        self.until("window.workbench?.ready && (workbench.store.looked || workbench.store.section !== 'rod_video')")

    def again(self) -> None:
        """Load the page anew."""
        self.page.reload()
        self.ready()

    def until(self, what: str) -> None:
        wait_in(self.page, what)

    def get(self, what: str) -> Any:
        return self.page.evaluate(what)

    @property
    def draft(self) -> dict:
        return self.get("workbench.store.draft")

    def click(self, where: str) -> None:
        self.page.locator(where).filter(visible=True).first.click()
        self.clicks += 1

    def press(self, name: str) -> None:
        """Click the button of a name."""
        self.page.get_by_role("button", name=name, exact=True).filter(visible=True).click()
        self.clicks += 1

    def label(self, text: str) -> Any:
        return self.page.get_by_label(text, exact=True).filter(visible=True)

    def choose(self, label: str, option: str) -> None:
        self.label(label).select_option(option)
        self.clicks += 2  # with a pointer: the list, then its line

    def type_into(self, label: str, text: str) -> None:
        self.label(label).click()
        self.clicks += 1
        self.page.keyboard.type(text)

    def at(self, column: float, row: float) -> tuple[float, float]:
        """Place on the screen of a place in the film."""
        x, y = self.get(f"workbench.view.toScreen({column}, {row})")
        box = self.page.locator("#film").bounding_box()
        return box["x"] + x, box["y"] + y

    @property
    def pixel(self) -> float:
        """Film pixels in one of the screen."""
        return 1 / self.get("workbench.view.toScreen(1, 0)[0] - workbench.view.toScreen(0, 0)[0]")

    def click_film(self, *places: tuple[float, float]) -> None:
        for place in places:
            self.page.mouse.click(*self.at(*place))
            self.clicks += 1

    def mark(self, place: tuple[float, float]) -> None:
        """Click with Shift."""
        self.page.keyboard.down("Shift")
        self.click_film(place)
        self.page.keyboard.up("Shift")

    def drag(self, *places: tuple[float, float]) -> None:
        """Drag over places of the screen."""
        self.page.mouse.move(*places[0])
        self.page.mouse.down()
        for place in places[1:]:
            self.page.mouse.move(*place, steps=4)
        self.page.mouse.up()
        self.clicks += 1

    def drag_film(self, *places: tuple[float, float]) -> None:
        self.drag(*(self.at(*place) for place in places))

    def drag_in(self, where, begin: float, end: float) -> None:
        """Drag along an element between two shares of its width."""
        until(lambda: where.bounding_box() is not None)  # a plot is drawn anew
        box = where.bounding_box()
        y = box["y"] + box["height"] / 2
        self.drag(*((box["x"] + share * box["width"], y) for share in (begin, end)))

    def followed(self) -> None:
        self.until("workbench.store.track.finished && !workbench.store.track.running")

    def measure(self) -> None:
        """Give frame rate and ruler of the drop, and track it."""
        self.type_into("Frame rate [1/s]", "250")
        self.click("button[data-tool=marks]")
        self.drag_film(RULER[:2], RULER[2:])
        self.page.keyboard.type("200")
        self.until("Math.abs(workbench.store.table.rod_video?.scale - 1e-3) < 1e-5")
        self.click("#act")
        self.followed()

    def plot(self) -> None:
        self.click("#tab-plot")
        self.page.locator("#plot .u-over").wait_for()

    def fit(self, curve: str, parameters: int) -> list[dict]:
        """Fit a curve to what is plotted and return its parameters."""
        self.click(f"button[data-curve={curve}]")
        self.until(f"workbench.store.fit?.parameters.length === {parameters}")
        return self.get("workbench.store.fit.parameters")

    def slide(self, label: str, begin: float, end: float) -> float:
        """Drag a slider from one share of its width to another and return where the pointer left it."""
        slider = self.label(label)
        self.drag_in(slider, begin, end)
        return float(slider.input_value())

    def write(self) -> dict:
        """Write the experiment and return it as it is read."""
        self.click("#tab-run")
        self.click("#write")
        self.page.get_by_text("Written:").wait_for()
        return tomllib.loads((self.server.benches.bench.folder / "experiment.toml").read_text(encoding="utf-8"))


@contextmanager
def opened(
    browser,
    path: Path,
    size: tuple[int, int] = (1280, 800),
    scheme: str = "light",
    touch: bool = False,
    study: str = "",
    hand: type[Hand] = Hand,
) -> Iterator[Any]:
    """Open the workbench of a path in a browser; at the end nothing may have been said on the console."""
    with serving(path, study) as server:
        view = {"width": size[0], "height": size[1]}
        context = browser.new_context(viewport=view, color_scheme=scheme, has_touch=touch, accept_downloads=True)
        try:
            p = hand(context.new_page(), server)
            p.page.set_default_timeout(1e3 * LIMIT_S)
            yield p
            assert p.said == []
        finally:
            context.close()


def serious(page, module) -> list[tuple[str, list[str]]]:
    """Findings of axe that are serious or critical, and what is cut at the side, once all is drawn."""
    page.evaluate("""async () => { await new Promise(requestAnimationFrame);
      const ending = document.getAnimations().filter((a) => a.effect.getTiming().iterations < Infinity);
      await Promise.allSettled(ending.map((a) => a.finished)); }""")
    found = module.Axe().run(page).response["violations"]
    cut = page.evaluate("document.documentElement.scrollWidth") > page.viewport_size["width"]
    return [("cut", [])] * cut + [
        (v["id"], [n["html"] for n in v["nodes"]]) for v in found if v["impact"] in ("serious", "critical")
    ]
