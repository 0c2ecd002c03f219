"""The interactive jumper: its files served to this machine only, and the page in a real browser."""

from __future__ import annotations

import http.client
import math
import signal
import subprocess
import sys
import threading
import time
import urllib.request

import pytest
from pace import in_time

from jumpvision.base.schema import InputError
from jumpvision.browser.demo import controls
from jumpvision.browser.demo.server import Server, export, page_files
from jumpvision.cli import main
from jumpvision.jumper.physics.hard.jump import hard_map

ROBOT = {"motor_mass": 1.003, "rod_mass": 0.175, "stiffness": 5760.6, "damping": 1.368, "gravity": 0.276 * 9.81,
         "landing_loss": 0.0}  # fmt: skip


@pytest.fixture(scope="module")
def server():
    s = Server(0)
    threading.Thread(target=s.serve_forever, daemon=True).start()
    yield s
    s.close()


@pytest.mark.parametrize("ground", controls.GROUNDS)
def test_what_a_jump_type_sets_lies_in_the_knobs_ranges(ground):
    law = controls.default_jump(ground)["law"]
    for values in (law, *controls.presets(ground).values()):
        for knob in controls.KNOBS:
            assert knob.lo <= (law | values)[knob.key] * knob.factor <= knob.hi, knob.key


# --- the server ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", ["/../server.py", "/static/../../cli.py", "/%2e%2e/server.py", "//etc/passwd"])
def test_only_the_pages_files_are_served_to_this_machine(server, path):
    assert server.socket.getsockname()[0] == "127.0.0.1"
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    connection.request("GET", path)
    assert connection.getresponse().status == 404
    connection.close()


def test_a_taken_port_is_said_so(server):
    with pytest.raises(InputError, match=f"demo --port {server.port}"):
        Server(server.port)


def test_the_page_needs_nothing_from_elsewhere():
    for name, content in page_files().items():
        text = content.decode().replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text and "https://" not in text and "//cdn" not in text, name


def test_an_export_goes_to_an_empty_folder_only(tmp_path):
    export(tmp_path / "new" / "page")
    written = {f.name for f in (tmp_path / "new" / "page").iterdir()}
    assert written == {"index.html", "jumper.js", "style.css", "icon.svg"}
    with pytest.raises(InputError, match="empty"):
        export(tmp_path / "new" / "page")
    with pytest.raises(InputError, match="empty"):
        export(tmp_path / "new" / "page" / "index.html")


def test_the_command_prints_the_address_serves_and_stops_on_interrupt():
    code = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"  # a shell's job ignores it
    code += "from jumpvision.cli import main; sys.exit(main(['demo', '--port', '0', '--no-browser']))"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as p:
        try:
            address = p.stdout.readline().strip()
            with urllib.request.urlopen(address, timeout=20) as reply:
                assert b"<title>The jumper" in reply.read()
            p.send_signal(signal.SIGINT)
            assert p.wait(20) == 0
        finally:
            p.kill()
        assert p.stderr.read().endswith("stopped\n")


def test_the_command_writes_the_page_to_a_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["demo", "--export", "jumper_page"]) == 0
    assert (tmp_path / capsys.readouterr().out.strip()).read_text("utf-8").startswith("<!doctype html>")
    assert main(["demo", "--export", "jumper_page"]) == 2


# --- in a browser ----------------------------------------------------------------------------------------------------


@pytest.fixture
def open_page(server, browser):
    """Opens the page, served or at an address; at the end nothing may have been said on the console."""
    contexts, said = [], []

    def go(width=1280, height=800, address=None, **options):
        contexts.append(browser.new_context(viewport={"width": width, "height": height}, **options))
        page, address = contexts[-1].new_page(), address or server.address
        page.on("console", lambda m: said.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda e: said.append(str(e)))
        page.on("request", lambda r: said.append(r.url) if not r.url.startswith(address.rpartition("/")[0]) else None)
        page.goto(address)
        until(page, "document.querySelector('#headline').textContent.includes('mm')")
        return page

    yield go
    for c in contexts:
        c.close()
    assert said == []


def until(page, condition):
    """Waits for a condition in JavaScript; playwright's own waiting needs eval, which the page's policy forbids."""
    deadline = time.monotonic() + 30.0
    while not page.evaluate(condition):
        assert time.monotonic() < deadline, f"never came true: {condition}"
        page.wait_for_timeout(30)


def until_rises(page, height_mm):
    until(page, f"document.querySelector('#headline').textContent.includes('rises {height_mm:.1f}\\u00a0mm')")


def until_map(page, n):
    until(page, f"document.querySelector('#map-note').textContent === '{n} × {n} jumps'")


PAINTED = """(id) => {
  const c = document.getElementById(id), d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
  return new Set(new Uint32Array(d.buffer)).size;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_draws_the_default_jump(open_page, scheme):
    page = open_page(color_scheme=scheme, reduced_motion="reduce")
    until_rises(page, 41.0)  # docs/physics.md section 7: the best stutter jump
    until_map(page, 72)
    assert page.evaluate(PAINTED, "map") > 200  # most of the 256 colours
    assert page.evaluate(PAINTED, "robot") > 20
    assert page.evaluate(PAINTED, "traces") > 20
    assert page.inner_text("#clock") == "291 ms"  # still, at the top of the jump
    assert page.get_attribute("#play", "aria-label") == "Play"


def test_keys_reach_and_move_a_knob_and_space_plays(open_page):
    page = open_page(reduced_motion="reduce")
    for _ in range(20):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.id") == "knob-frequency":
            break
    else:
        pytest.fail("Tab does not reach the frequency")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    for _ in range(10):
        page.keyboard.press("ArrowRight")
    assert page.get_attribute("#knob-frequency", "aria-valuetext") == "8.7 Hz"
    until_rises(page, 1e3 * hard_map([8.7], [math.pi / 2], amplitude=4e-3, cycles=1.0, **ROBOT)["jump_height_m"][0, 0])
    page.keyboard.press("Space")
    page.wait_for_selector("#play[aria-label=Pause]")
    page.keyboard.press("Space")
    page.wait_for_selector("#play[aria-label=Play]")


def test_it_plays_by_itself_and_step_and_scrubber_stop_it(open_page):
    page = open_page()
    first = page.inner_text("#clock")
    until(page, f"document.querySelector('#clock').textContent !== '{first}'")
    page.locator("#scrub").fill("500")
    page.wait_for_selector("#play[aria-label=Play]")
    before = int(page.inner_text("#clock").split()[0])
    page.locator("#step").click()
    until(page, f"document.querySelector('#clock').textContent === '{before + 5} ms'")


def test_a_click_and_keys_on_the_map_set_frequency_and_phase(open_page):
    page = open_page(reduced_motion="reduce")
    until_map(page, 72)
    page.locator("#map").scroll_into_view_if_needed()
    page.locator("#map").click(position={"x": 200, "y": 60})
    until(page, "!document.querySelector('#headline').textContent.includes('41.0')")
    box = page.locator("#map").bounding_box()
    f, phase = 1.0 + 23.0 * (200 - 40) / (box["width"] - 98), 2.0 * (1.0 - (60 - 6) / (box["height"] - 40))
    assert float(page.inner_text("[for=knob-frequency]:is(output)").split()[0]) == pytest.approx(f, abs=0.2)
    assert float(page.inner_text("[for=knob-phase]:is(output)").split()[0]) == pytest.approx(phase, abs=0.02)
    direct = hard_map([f], [phase * math.pi], amplitude=4e-3, cycles=1.0, **ROBOT)["jump_height_m"][0, 0]
    rise = float(page.inner_text("#headline").split()[3])
    assert rise == pytest.approx(1e3 * direct, abs=0.6)  # of a pixel and a half
    old = float(page.input_value("#knob-frequency"))
    page.keyboard.press("ArrowRight")
    until(page, f"Math.abs(document.querySelector('#knob-frequency').value - {old} - 0.1) < 0.03")


def test_sand_and_the_jump_types(open_page):
    page = open_page(reduced_motion="reduce")
    until_map(page, 72)
    page.locator("input[value=granular]").check(force=True)
    assert not page.inner_text("#map-note").startswith("72")  # the floor's map is no longer shown
    until_rises(page, 24.1)
    assert "mass of the jammed cone" in page.inner_text("#numbers")
    page.locator("input[value=single]").check(force=True)
    until(page, "document.querySelector('#story').textContent.includes('One flight')")
    page.locator("input[value=delayed_stutter]").check(force=True)
    assert page.input_value("#knob-delay") == "100"
    page.locator("#knob-delay").fill("0")
    assert page.is_checked("input[value=stutter]")
    page.locator("#reset").click()
    until_rises(page, 24.1)
    page.locator("input[value=hard]").check(force=True)
    until_rises(page, 41.0)


def test_a_foot_that_stays_on_the_ground_is_said(open_page):
    page = open_page(reduced_motion="reduce")
    page.locator("#knob-frequency").fill("1")
    until(page, "document.querySelector('#headline').textContent === 'The foot stays on the ground'")


def test_a_phone_needs_no_sideways_scrolling(open_page):
    page = open_page(360, 740, has_touch=True, is_mobile=True, reduced_motion="reduce")
    for ground in ("granular", "hard"):
        page.locator(f"input[value={ground}]").check(force=True)
        page.wait_for_timeout(200)
        wide = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert wide[0] <= wide[1] == 360
    page.locator("#knob-delay").scroll_into_view_if_needed()
    stage = page.locator("#stage").bounding_box()
    assert stage["y"] >= 0 and stage["y"] + stage["height"] < 400  # the robot stays in view beside the knobs


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_serious_finding_of_axe(open_page, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    page = open_page(color_scheme=scheme, reduced_motion="reduce", bypass_csp=True)
    for ground in ("granular", "hard"):
        page.locator(f"input[value={ground}]").check(force=True)
        page.wait_for_timeout(300)
        found = axe.Axe().run(page).response["violations"]
        assert [
            (v["id"], [n["target"] for n in v["nodes"]]) for v in found if v["impact"] in ("serious", "critical")
        ] == []


@pytest.mark.long
def test_every_knob_is_answered_within_a_tenth_of_a_second(open_page):
    """From a knob's event to the second frame after the numbers have changed, p95 over the knobs that do so."""
    page = open_page(reduced_motion="reduce", bypass_csp=True)
    move = """async () => {
      const frame = () => new Promise(requestAnimationFrame), out = [];
      const said = () => ['headline', 'numbers'].map((n) => document.getElementById(n).textContent).join();
      for (const name of ['frequency', 'phase', 'amplitude']) {
        const s = document.getElementById(`knob-${name}`);
        for (let i = 0; i < 12; i++) {
          const old = said(), began = performance.now();
          s.value = Number(s.value) + (i % 2 ? -2 : 2) * Number(s.step);
          s.dispatchEvent(new Event('input'));
          do { await frame(); } while (said() === old && performance.now() - began < 1000);
          await frame();
          if (said() !== old) out.push(performance.now() - began);
        }
      }
      return out; }"""
    for ground in ("hard", "granular"):
        page.locator(f"input[value={ground}]").check(force=True)
        page.wait_for_timeout(500)  # its map goes on meanwhile

        def p95() -> float:
            times = page.evaluate(move)
            assert len(times) >= 24
            return sorted(times)[int(0.95 * len(times))]

        in_time(p95, 100.0)


def test_the_exported_page_works_from_a_folder_without_a_server(open_page, tmp_path):
    export(tmp_path / "page")
    page = open_page(address=(tmp_path / "page" / "index.html").as_uri(), reduced_motion="reduce")
    until_rises(page, 41.0)
    page.locator("input[value=granular]").check(force=True)
    until_rises(page, 24.1)
