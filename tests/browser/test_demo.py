"""The interactive jumper: its integrator against the package's solvers, its files, and the page in a real browser."""

from __future__ import annotations

import http.client
import json
import math
import shutil
import signal
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import later

from jumpvision.base.schema import InputError
from jumpvision.browser.demo import controls
from jumpvision.browser.demo.controls import BED_TERMS, default_jump
from jumpvision.browser.demo.server import MODULES, STATIC, Server, export, made_module, page_files
from jumpvision.cli import main
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import Segments
from jumpvision.jumper.physics.hard.jump import half_cycle_rows, hard_jump, hard_map, sine_rows
from jumpvision.jumper.physics.model import OF_BED, Model
from jumpvision.jumper.physics.sand.jump import simulate
from tests.worlds.hand import AXE, serious, wait_in

NODE = shutil.which("node")
TIMES = np.linspace(0.0, 0.7, 71)
ROBOT = {"motor_mass": 1.003, "rod_mass": 0.175, "stiffness": 5760.6, "damping": 1.368, "gravity": 0.276 * 9.81,
         "landing_loss": 0.0}  # fmt: skip


def rise_mm(frequency: float, phase: float) -> float:
    """Height of the default robot's jump on hard ground by the package."""
    return 1e3 * hard_map([frequency], [phase], amplitude=4e-3, cycles=1.0, **ROBOT)["jump_height_m"][0, 0]


# --- the integrator in JavaScript, run with node ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def modules(tmp_path_factory) -> Path:
    """The page's modules as files, the one that is made from the package among them."""
    folder = tmp_path_factory.mktemp("page")
    for name in MODULES:
        (folder / name).write_bytes(STATIC.joinpath(name).read_bytes())
    (folder / "made.js").write_text(made_module(), "utf-8")
    (folder / "package.json").write_text('{"type": "module"}')
    return folder


def solved(modules: Path, jumps: list[dict[str, Any]], tolerance: float) -> list[dict[str, Any]]:
    """The page's numbers and tracks of these jumps."""
    lines = "\n".join(json.dumps(j | {"times": TIMES.tolist()}) for j in jumps)
    command = [NODE, Path(__file__).with_name("demo_jumps.mjs"), modules, str(tolerance)]
    done = subprocess.run(command, input=lines, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def drawn(rng: np.random.Generator, ground: str) -> dict[str, Any]:
    """A jump with every value of robot and bed between 0.7 and 1.4 times the thesis', one of three with a delay."""
    jump = default_jump(ground)
    for table in (jump["robot"], jump["robot"].get("bed", {})):
        table |= {k: x * rng.uniform(0.7, 1.4) for k, x in table.items() if k != "bed"}
    law = jump["law"]
    law |= {"amplitude": law["amplitude"] * rng.uniform(0.7, 1.4), "phase": rng.uniform(0.0, 2 * math.pi)}
    law |= {"frequency": rng.uniform(*((4.0, 20.0) if ground == "hard" else (3.0, 12.0)))}
    law |= {"delay": rng.uniform(0.0, 0.2) if rng.integers(3) == 0 else 0.0}
    return jump


def law_of(jump: dict[str, Any]) -> Segments:
    f, amplitude, phase, delay = (jump["law"][k] for k in ("frequency", "amplitude", "phase", "delay"))
    if delay:
        return Segments(half_cycle_rows(f, f, amplitude, phase, delay))
    return Segments(sine_rows(f, amplitude, phase, 1.0))


def until_landed(follow, stop):
    """Follow the motion until a flight has ended after the motor's stop [s], if there is one, or half a minute on."""
    tail = 0.6
    while True:
        motion, flights = follow(stop + tail)
        airborne = flights.size > 0 and math.isnan(flights[-1, 1])
        if not airborne or (flights[:, 1] > stop).any() or tail > 30.0:
            return motion
        tail *= 2.0


def by_hard_jump(jump: dict[str, Any]) -> dict[str, Any]:
    r, law = jump["robot"], law_of(jump)

    def follow(end, t=None):
        m = hard_jump(
            motor_mass=r["motor_mass"], rod_mass=r["rod_mass"], stiffness=r["spring_stiffness"],
            damping=r["spring_damping"], gravity=r["gravity"], landing_loss=0.0, forcing=law, t=t, t_end=end,
        )  # fmt: skip
        return m, np.column_stack([m.lift_off, m.landing])

    m, track = until_landed(follow, law.stop), follow(max(law.stop, TIMES[-1]), TIMES)[0]
    return {
        "jump_height_m": m.jump_height, "com_height_m": m.com_height, "flight_height_m": m.flight_height,
        "n_jumps": m.n_jumps, "rod": track.rod, "foot": np.maximum(track.rod, 0.0),
    }  # fmt: skip


def by_simulate(jump: dict[str, Any]) -> dict[str, Any]:
    robot = {k: x for k, x in jump["robot"].items() if k not in ("bed", *OF_BED.values())}
    bed = dict(jump["robot"]["bed"])
    of_bed = {name: bed.pop(symbol) for symbol, name in OF_BED.items()}
    model, law = Model("granular", BED_TERMS, ModelParameters(**bed), **robot, **of_bed), law_of(jump)

    def follow(end, t=None):
        j = simulate(model, law, t=np.array([0.0, end]) if t is None else t, rtol=1e-12, atol=1e-15)
        return j, j.flights

    j, track = until_landed(follow, law.stop), follow(0.0, TIMES)[0]
    return {
        "jump_height_m": j.jump_height, "com_height_m": j.com_height, "depth_m": j.depth_max,
        "flights": len(j.flights), "rod": track.rod, "foot": track.foot,
    }  # fmt: skip


@pytest.mark.skipif(NODE is None, reason="no node in PATH")
@pytest.mark.parametrize(
    ("ground", "n", "direct"),
    [
        ("hard", 10, by_hard_jump),
        ("granular", 1, by_simulate),
        *later(("hard", 50, by_hard_jump), ("granular", 10, by_simulate)),
    ],
)
def test_random_jumps_are_those_of_the_package_to_a_nanometre(modules, ground, n, direct):
    """Steps to 1e-12 of about 0.1 m; some thousand of them and the impacts between leave 1e-11 m; a hundred times that
    is allowed where a jump grazes. hard_jump is exact, simulate as fine as the page. Heights are shown to 0.1 mm: for
    that the page's own steps to 1e-7, and its map's to 1e-6, are fine enough."""
    rng = np.random.default_rng(1)
    jumps = [drawn(rng, ground) for _ in range(n)]
    shown = solved(modules, jumps, 1e-7)
    for jump, page, coarse in zip(jumps, solved(modules, jumps, 1e-12), shown, strict=True):
        expected = direct(jump)
        found = {k: math.nan if page[k] is None else page[k] for k in expected}
        if "flights" in expected:
            found["flights"] = len(page["flights"])
        for name, x in expected.items():
            np.testing.assert_allclose(found[name], x, rtol=0, atol=1e-9, err_msg=f"{name} of {jump}")
        assert coarse["jump_height_m"] == pytest.approx(page["jump_height_m"], abs=5e-6)
        assert coarse["map_height_m"] == pytest.approx(page["jump_height_m"], abs=5e-5)


@pytest.mark.parametrize("ground", controls.GROUNDS)
def test_what_a_jump_type_sets_lies_in_the_knobs_ranges(ground):
    law = default_jump(ground)["law"]
    for values in (law, *controls.presets(ground).values()):
        for knob in controls.KNOBS:
            assert knob.lo <= (law | values)[knob.key] * knob.factor <= knob.hi, knob.key


# --- the server and the export ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def server():
    s = Server(0)
    threading.Thread(target=s.serve_forever, daemon=True).start()
    yield s
    s.close()


def test_only_the_page_s_files_are_served_to_this_machine(server):
    assert server.socket.getsockname()[0] == "127.0.0.1"
    for path in ("/../server.py", "/static/../../cli.py", "/%2e%2e/server.py", "//etc/passwd"):
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
        connection.request("GET", path)
        assert connection.getresponse().status == 404, path
        connection.close()
    with pytest.raises(InputError, match=f"demo --port {server.port}"):
        Server(server.port)  # it is taken
    for name, content in page_files().items():
        text = content.decode().replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text and "https://" not in text and "//cdn" not in text, name


def test_the_command_serves_until_it_is_interrupted_or_exports_to_an_empty_folder(tmp_path, capsys):
    code = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"  # a shell's job ignores it
    code += "from jumpvision.cli import main; sys.exit(main(['demo', '--port', '0', '--no-browser']))"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as p:
        try:
            address = p.stdout.readline().strip()
            with urllib.request.urlopen(address, timeout=60) as reply:
                assert b"<title>The jumper" in reply.read()
            p.send_signal(signal.SIGINT)
            assert p.wait(60) == 0
        finally:
            p.kill()
        assert p.stderr.read().endswith("stopped\n")
    folder = tmp_path / "new" / "page"
    assert main(["demo", "--export", str(folder)]) == 0 and capsys.readouterr().out.strip()
    assert {f.name for f in folder.iterdir()} == {"index.html", "jumper.js", "style.css", "icon.svg"}
    assert main(["demo", "--export", str(folder)]) == 2
    for taken in (folder, folder / "index.html"):
        with pytest.raises(InputError, match="empty"):
            export(taken)


# --- in a browser -----------------------------------------------------------------------------------------------------


@pytest.fixture
def open_page(server, browser):
    """Opens the page, served or at an address; at the end nothing may have been said on the console."""
    contexts, said = [], []

    def go(size=(1280, 800), address=None, reduced_motion="reduce", **options):
        view = {"width": size[0], "height": size[1]}
        contexts.append(browser.new_context(viewport=view, reduced_motion=reduced_motion, **options))
        page, address = contexts[-1].new_page(), address or server.address
        page.on("console", lambda m: said.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda e: said.append(str(e)))
        page.on("request", lambda r: said.append(r.url) if not r.url.startswith(address.rpartition("/")[0]) else None)
        page.goto(address)
        wait_in(page, "document.querySelector('#headline').textContent.includes('mm')")
        return page

    yield go
    for c in contexts:
        c.close()
    assert said == []


def until_rises(page, height_mm):
    wait_in(page, f"document.querySelector('#headline').textContent.includes('rises {height_mm:.1f}\\u00a0mm')")


def until_map(page):
    wait_in(page, "document.querySelector('#map-note').textContent === '72 × 72 jumps'")


def take(page, value):
    page.locator(f"input[value={value}]").check(force=True)


PAINTED = """(id) => {
  const c = document.getElementById(id), d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
  return new Set(new Uint32Array(d.buffer)).size;
}"""


def test_demo(open_page):
    """The default jump is drawn; keys, map and jump types change it, and its height is the package's."""
    page = open_page()
    until_rises(page, 41.0)  # docs/physics.md section 7: the best stutter jump
    until_map(page)
    assert page.evaluate(PAINTED, "map") > 200  # most of the 256 colours
    assert page.evaluate(PAINTED, "robot") > 20 and page.evaluate(PAINTED, "traces") > 20
    assert page.inner_text("#clock") == "291 ms"  # still, at the top of the jump
    assert page.get_attribute("#play", "aria-label") == "Play"
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
    until_rises(page, rise_mm(8.7, math.pi / 2))
    page.keyboard.press("Space")
    page.wait_for_selector("#play[aria-label=Pause]")
    page.keyboard.press("Space")
    page.wait_for_selector("#play[aria-label=Play]")
    # a click and keys on the map set frequency and phase
    until_map(page)
    old = page.inner_text("#headline")
    page.locator("#map").scroll_into_view_if_needed()
    page.locator("#map").click(position={"x": 200, "y": 60})
    wait_in(page, f"document.querySelector('#headline').textContent !== {json.dumps(old)}")
    box = page.locator("#map").bounding_box()
    f, phase = 1.0 + 23.0 * (200 - 40) / (box["width"] - 98), 2.0 * (1.0 - (60 - 6) / (box["height"] - 40))
    assert float(page.inner_text("[for=knob-frequency]:is(output)").split()[0]) == pytest.approx(f, abs=0.2)
    assert float(page.inner_text("[for=knob-phase]:is(output)").split()[0]) == pytest.approx(phase, abs=0.02)
    rise = float(page.inner_text("#headline").split()[3])
    assert rise == pytest.approx(rise_mm(f, phase * math.pi), abs=0.6)  # of a pixel and a half
    before = float(page.input_value("#knob-frequency"))
    page.keyboard.press("ArrowRight")
    wait_in(page, f"Math.abs(document.querySelector('#knob-frequency').value - {before} - 0.1) < 0.03")
    page.locator("#reset").click()
    until_rises(page, 41.0)
    # sand and the jump types
    until_map(page)
    take(page, "granular")
    assert not page.inner_text("#map-note").startswith("72")  # the floor's map is no longer shown
    until_rises(page, 24.1)
    assert "mass of the jammed cone" in page.inner_text("#numbers")
    take(page, "single")
    wait_in(page, "document.querySelector('#story').textContent.includes('One flight')")
    take(page, "delayed_stutter")
    assert page.input_value("#knob-delay") == "100"
    page.locator("#knob-delay").fill("0")
    assert page.is_checked("input[value=stutter]")
    page.locator("#reset").click()
    until_rises(page, 24.1)
    take(page, "hard")
    until_rises(page, 41.0)
    page.locator("#knob-frequency").fill("1")
    wait_in(page, "document.querySelector('#headline').textContent === 'The foot stays on the ground'")


def test_it_plays_by_itself_and_step_and_scrubber_stop_it_without_a_server(open_page, tmp_path):
    export(tmp_path / "page")
    page = open_page(address=(tmp_path / "page" / "index.html").as_uri(), reduced_motion="no-preference")
    until_rises(page, 41.0)
    first = page.inner_text("#clock")
    wait_in(page, f"document.querySelector('#clock').textContent !== '{first}'")
    page.locator("#scrub").fill("500")
    page.wait_for_selector("#play[aria-label=Play]")
    before = int(page.inner_text("#clock").split()[0])
    page.locator("#step").click()
    wait_in(page, f"document.querySelector('#clock').textContent === '{before + 5} ms'")
    take(page, "granular")
    until_rises(page, 24.1)


@pytest.mark.parametrize(
    ("size", "scheme"),
    [((1280, 800), "light"), ((360, 740), "dark"), pytest.param((1280, 800), "dark", marks=pytest.mark.long)],
    ids=str,
)
def test_the_demo_has_no_serious_finding_of_axe(open_page, size, scheme):
    """And on a phone it needs no sideways scrolling, and shows the robot beside the knobs."""
    axe, phone = pytest.importorskip(AXE), size[0] < 400
    page = open_page(size, color_scheme=scheme, bypass_csp=True, has_touch=phone, is_mobile=phone)
    for ground, height_mm in (("granular", 24.1), ("hard", 41.0)):
        take(page, ground)
        until_rises(page, height_mm)
        assert serious(page, axe) == []
    if phone:
        page.locator("#knob-delay").scroll_into_view_if_needed()
        stage = page.locator("#stage").bounding_box()
        assert stage["y"] >= 0 and stage["y"] + stage["height"] < 400
