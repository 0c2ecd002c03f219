"""Two pages in Firefox: a report, the workbench; nothing on the console."""

from __future__ import annotations

import shutil
import threading
import time

import pytest
from conftest import SAMPLES

from jumpvision.browser.workbench.server import Server as Workbench
from jumpvision.cli import main

pytestmark = pytest.mark.long


@pytest.fixture
def opened(firefox):
    """Opens an address in Firefox; at the end nothing may have been said on the console."""
    pages, said = [], []

    def go(address):
        page = firefox.new_page()
        pages.append(page)
        page.on("console", lambda m: said.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda e: said.append(str(e)))
        page.goto(address)
        return page

    yield go
    for page in pages:
        page.close()
    assert said == []


@pytest.fixture
def served():
    """Serves until the end of the test."""
    open_ones = []

    def serve(server):
        open_ones.append(server)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        return server.address

    yield serve
    for s in open_ones:
        s.close()


def until(page, condition, limit=60.0):
    end = time.monotonic() + limit
    while not page.evaluate(condition):
        assert time.monotonic() < end, f"never came true: {condition}"
        page.wait_for_timeout(30)


def test_a_report_draws_its_figures_and_reads_them(opened, tmp_path):
    shutil.copytree(SAMPLES / "hard_ground", tmp_path / "hard")
    assert main(["run", str(tmp_path / "hard"), "--results", str(tmp_path / "results")]) == 0
    page = opened((tmp_path / "results" / "report.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.locator("figure.drawn a.point").first.click()
    page.wait_for_url("**/report.html")
    assert page.locator("figure.drawn svg").first.is_visible()


def test_the_workbench_shows_tracks_and_writes(opened, served, tmp_path):
    shutil.copytree(SAMPLES / "hard_ground", tmp_path / "hard", ignore=shutil.ignore_patterns("truth.json"))
    page = opened(served(Workbench(tmp_path / "hard", 0)))
    until(page, "!!window.workbench?.ready && workbench.player.shown === 0")
    page.keyboard.press("t")
    until(page, "workbench.store.track.finished && !workbench.store.track.running")
    assert page.evaluate("workbench.store.track.rows.filter((r) => r[3]).length") == 0
    page.locator("#scrub").fill("300")
    until(page, "workbench.player.shown === 300")
    page.keyboard.press("5")
    page.locator("#write").wait_for(state="visible")
