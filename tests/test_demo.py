"""The interactive jumper: the solvers' numbers over HTTP, quick answers, refusals, and the page in a real browser."""

from __future__ import annotations

import http.client
import json
import math
import signal
import socket
import statistics
import subprocess
import sys
import threading
import time
import urllib.request
from importlib.resources import files

import numpy as np
import pytest

from jumpvision.base.local_page import static_files
from jumpvision.base.schema import InputError
from jumpvision.browser.demo import controls, jumper
from jumpvision.browser.demo.server import QUESTIONS, Server, keys
from jumpvision.inputs.sections import SECTIONS
from jumpvision.mechanisms.registry import ModelParameters
from jumpvision.physics.forcing import delayed, from_log, sinusoid
from jumpvision.physics.hard.jump import hard_jump, hard_map
from jumpvision.physics.model import Model
from jumpvision.physics.sand.jump import simulate

ROBOT = {"motor_mass": 1.003, "rod_mass": 0.175, "stiffness": 5760.6, "damping": 1.368, "gravity": 0.276 * 9.81,
         "landing_loss": 0.0}  # fmt: skip
ROUNDED = 0.51e-6  # the motion is sent rounded to 1e-6
HAND = {"t": [0.0, 0.05, 0.1, 0.16, 0.2, 0.3], "x": [0.0, -0.01, -0.02, 0.0, 0.015, 0.012], "step": 1e-4}


def sand(terms=("two_resistance", "depth_drag", "added_mass"), foot_mass=0.04, **more) -> Model:
    values = {"k1": 2100.0, "k2": 2100.0, "delta": 0.01, "C": 2.7, "mu": 2.0, "theta": math.pi / 3, "b": 17.2} | more
    return Model("granular", terms, ModelParameters(**values), motor_mass=1.125, rod_mass=0.175, foot_mass=foot_mass,
                 spring_stiffness=3300.0, spring_damping=1.2, gravity=9.81, foot_radius=0.0381, volume_fraction=0.57,
                 grain_density=1000.0)  # fmt: skip


@pytest.fixture(scope="module")
def server():
    jumper.warm_up()
    with Server(0) as s:
        threading.Thread(target=s.serve_forever, daemon=True).start()
        yield s
        s.shutdown()


@pytest.fixture
def connection(server):
    c = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=30)
    yield c
    c.close()


def post(connection, path, question) -> tuple[int, dict]:
    body = question if isinstance(question, bytes) else json.dumps(question)
    connection.request("POST", path, body, {"Content-Type": "application/json"})
    reply = connection.getresponse()
    return reply.status, json.loads(reply.read())


# --- the numbers -----------------------------------------------------------------------------------------------------


def test_a_hard_ground_jump_is_hard_jumps(connection):
    law = {"frequency": 7.3, "amplitude": 0.0037, "phase": 1.9}
    status, answer = post(connection, "/api/jump", {"ground": "hard", "set": {"actuation": law}})
    assert status == 200 and answer["exact"]
    m, n = answer["motion"], answer["numbers"]
    t = np.array(m["t"])
    direct = hard_jump(**ROBOT, forcing=sinusoid(7.3, 0.0037, 1.9), t=t, t_end=float(t[-1]))
    for name in ("com_height", "jump_height", "flight_height"):
        assert n[f"{name}_m"] == getattr(direct, name)
    assert (n["n_jumps"], n["peak_power_W"], n["peak_force_N"]) == (
        direct.n_jumps, direct.peak_power_W, direct.peak_force_N,
    )  # fmt: skip
    rest = ROBOT["gravity"] * 1.178 / 5760.6
    # t is rounded too: a fall of 1 m/s over half a microsecond; forces by the spring's rate, k v
    np.testing.assert_allclose(np.array(m["rod"]) - rest, direct.rod, rtol=0, atol=2 * ROUNDED)
    np.testing.assert_allclose(m["motor"], direct.motor + rest, rtol=0, atol=2 * ROUNDED)
    np.testing.assert_allclose(m["spring"], direct.spring_force, rtol=0, atol=5760.6 * 2 * ROUNDED)
    assert n["alpha"] == pytest.approx(0.276 * 9.81 * 1.178 / (5760.6 * 0.0037), rel=1e-12)
    assert n["f_over_f0"] == pytest.approx(7.3 / 11.1297, rel=1e-5)


@pytest.mark.parametrize("terms", [controls.SAND["cone"], controls.SAND["drag"]], ids=list(controls.SAND))
def test_a_jump_on_sand_is_simulates(connection, terms):
    law = {"kind": "delayed_stutter", "frequency": 7.0, "delay": 0.1, "phase": math.pi / 2}
    tables = {"actuation": law, "model": {"terms": terms, "alpha": 73.0}}
    status, answer = post(connection, "/api/jump", {"ground": "granular", "set": tables})
    assert status == 200 and not answer["exact"]
    m, n = answer["motion"], answer["numbers"]
    t = np.array(m["t"])
    direct = simulate(sand(terms, alpha=73.0), delayed(7.0, 0.01875, math.pi / 2, 0.1), t=t, rtol=1e-9, atol=1e-12)
    # the demo integrates to 1e-6 of 0.1 m, events amplify it about tenfold
    assert n["jump_height_m"] == pytest.approx(direct.jump_height, abs=2e-6)
    assert n["flight_height_m"] == pytest.approx(direct.flight_height, abs=2e-6)
    assert n["depth_m"] == pytest.approx(direct.depth_max, abs=1e-6 + 1e-4 * direct.depth_max)  # of 600 samples
    np.testing.assert_allclose(m["foot"], direct.foot, rtol=0, atol=5e-6)
    np.testing.assert_allclose(np.array(m["rod"]) + direct.rest, direct.rod, rtol=0, atol=5e-6)
    assert ("cone_height" in m) == ("added_mass" in terms)
    assert np.all(np.diff(m["hole"]) >= 0.0)


def test_the_motor_moved_by_hand_drives_the_jumper(connection):
    status, answer = post(connection, "/api/jump", {"ground": "granular", "hand": HAND})
    assert status == 200
    t = np.array(HAND["t"])
    before, after = np.linspace(-jumper.HOLD, 0.0, 6)[:-1], 0.3 + np.linspace(0.0, jumper.HOLD, 6)[1:]
    time_, x = np.concatenate([before, t, after]), np.concatenate([np.zeros(5), HAND["x"], np.full(5, 0.012)])
    law = from_log(time_, x, 1e-4 / math.sqrt(12.0))
    direct = simulate(sand(), law, t=np.array(answer["motion"]["t"]), rtol=1e-9, atol=1e-12)
    assert answer["numbers"]["jump_height_m"] == pytest.approx(direct.jump_height, abs=2e-6)
    drive = np.interp(HAND["t"], answer["motion"]["t"], answer["motion"]["drive"])
    # the spline leaves the log by its residual rms, sigma; 6 of 16 points bear it: at most sqrt(16) sigma. Linear
    # interpolation over 1.2 ms adds X_m'' dt^2 / 8 < 1e-5 m
    np.testing.assert_allclose(drive, HAND["x"], rtol=0, atol=4 * 1e-4 / math.sqrt(12.0) + 1e-5)


def test_the_map_is_the_sweeps(connection):
    f, phase = np.linspace(3.0, 20.0, 7), np.linspace(0.0, 2 * math.pi, 5)
    question = {"ground": "hard", "frequencies": f.tolist(), "phases": phase.tolist()}
    status, answer = post(connection, "/api/map", question)
    direct = hard_map(f, phase, amplitude=4e-3, cycles=1.0, **ROBOT)["jump_height_m"]
    assert status == 200
    np.testing.assert_allclose(np.array(answer["height_m"], float), direct, rtol=0, atol=ROUNDED)
    status, answer = post(connection, "/api/map", question | {"ground": "granular"})
    one = simulate(sand(), sinusoid(f[2], 0.01875, phase[1]), t=np.linspace(0.0, 2.0, 9), rtol=1e-9, atol=1e-12)
    assert answer["height_m"][2][1] == pytest.approx(one.jump_height, abs=2e-6)


def test_two_frequencies_and_a_foot_on_hard_ground(connection):
    _, same = post(connection, "/api/jump", {"ground": "hard", "frequency2": 8.2})
    _, other = post(connection, "/api/jump", {"ground": "hard", "frequency2": 12.0})
    _, plain = post(connection, "/api/jump", {"ground": "hard"})
    assert same["numbers"] == plain["numbers"]
    assert other["numbers"]["stop_s"] == pytest.approx(0.5 / 8.2 + 0.5 / 12.0)
    status, heavy = post(connection, "/api/jump", {"ground": "hard", "set": {"robot": {"foot_mass": 0.1}}})
    assert status == 200 and not heavy["exact"]
    assert heavy["numbers"]["jump_height_m"] < plain["numbers"]["jump_height_m"]


@pytest.mark.parametrize("ground", controls.GROUNDS)
def test_every_slider_and_preset_has_a_place_in_the_declared_sections(ground):
    tables = controls.defaults(ground)
    for s in controls.SLIDERS:
        assert s.meaning and s.lo < s.hi
        if s.section != "model" and s.key != "frequency2":
            assert s.key in SECTIONS[s.section].__dataclass_fields__
        shown = s.only in ("", ground) or (ground == "granular" and s.only in controls.SAND)
        if shown and s.key != "frequency2":
            assert s.lo <= tables[s.section][s.key] * s.factor <= s.hi, s.key
    for law in controls.PRESETS[ground].values():
        answer = jumper.jump({"ground": ground, "set": tables | {"actuation": tables["actuation"] | law}})
        assert answer["numbers"]["n_jumps"] > 0


# --- time ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ground", controls.GROUNDS)
def test_a_slider_is_answered_within_50_ms(connection, ground):
    """Loopback, warm, request to parsed answer: about 5 (hard) and 11 ms (sand) on an idle core, so 4-fold margin."""
    tables, taken = controls.defaults(ground), []
    for f in np.linspace(4.0, 12.0, 41):
        tables["actuation"]["frequency"] = f
        began = time.perf_counter()
        status, _ = post(connection, "/api/jump", {"ground": ground, "set": tables})
        taken.append(time.perf_counter() - began)
        assert status == 200
    assert statistics.median(taken) < 0.050, sorted(taken)


# --- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ground", "question", "named"),
    [
        ("hard", {"set": {"robot": {"motor_mass": -1.0}}}, ["motor_mass"]),
        ("hard", {"set": {"robot": {"spring_stiffness": 0}}}, ["spring_stiffness"]),
        ("hard", {"set": {"actuation": {"amplitude": None}}}, ["amplitude"]),
        ("hard", {"set": {"actuation": {"delay": 0.1, "cycles": 3.0}}}, ["delay"]),
        ("hard", {"set": {"actuation": {"frequency": 0.01}}}, ["cycles", "delay", "frequency"]),
        ("hard", {"frequency2": "fast"}, ["frequency2"]),
        ("hard", {"set": {"model": {"e": 1.5, "terms": ["landing_loss"]}}}, ["e"]),
        ("granular", {"set": {"robot": {"foot_mass": 0.0}}}, ["foot_mass"]),
        ("granular", {"set": {"model": {"b": 0.1}}}, ["alpha", "b"]),
        ("granular", {"set": {"bed": {"volume_fraction": 2.0}}}, ["volume_fraction"]),
    ],
)
def test_an_impossible_value_is_refused_at_its_field(connection, ground, question, named):
    status, answer = post(connection, "/api/jump", {"ground": ground} | question)
    assert status == 400
    assert [p["keys"] for p in answer["problems"]] == [named]
    assert all("--set" not in p["text"] and "experiment.toml" not in p["text"] for p in answer["problems"])


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        ("/api/jump", b"not json", 400),
        ("/api/jump", b"[1]", 400),
        ("/api/jump", b'{"ground": "ice"}', 400),
        ("/api/jump", b'{"ground": "hard", "set": {"robot": 3}}', 400),
        ("/api/jump", b'{"ground": "hard", "set": {"robot": {"motor_mass": NaN}}}', 400),
        ("/api/jump", b'{"ground": "hard", "hand": {"t": [0, 0], "x": [0, 0], "step": 1e-4}}', 400),
        ("/api/jump", b'{"ground": "hard", "hand": {"t": [0, 1], "x": [0, 9], "step": 1e-4}}', 400),
        ("/api/map", b'{"ground": "hard", "frequencies": "all", "phases": [0]}', 400),
        ("/api/map", b'{"ground": "hard", "frequencies": [-1], "phases": [0]}', 400),
        ("/api/none", b"{}", 404),
    ],
)
def test_a_bad_question_is_answered_not_crashed_on(connection, path, body, status):
    got, answer = post(connection, path, body)
    assert got == status and answer["problems"][0]["text"]
    assert post(connection, "/api/jump", {"ground": "hard"})[0] == 200


@pytest.mark.parametrize(
    "path", ["/../server.py", "/static/../../cli.py", "/%2e%2e/server.py", "//etc/passwd", "/__init__.py"]
)
def test_only_the_pages_files_are_served(connection, path):
    connection.request("GET", path)
    reply = connection.getresponse()
    reply.read()
    assert reply.status == 404


def test_other_names_and_other_machines_are_refused(server, connection):
    assert server.server_address[0] == "127.0.0.1"
    connection.request("GET", "/", headers={"Host": "example.org:80"})
    assert connection.getresponse().status == 403


JSON = "Content-Type: application/json\r\n"


@pytest.mark.parametrize(
    ("head", "body", "status"),
    [
        (JSON + "Content-Length: 2\r\n", "{}", 400),  # heard: a jump without a ground
        (JSON + "Content-Length: 2\r\nOrigin: http://127.0.0.1:PORT\r\n", "{}", 400),
        (JSON + "Content-Length: 2\r\nOrigin: https://elsewhere.example\r\n", "{}", 403),
        (JSON + "Content-Length: 2\r\nOrigin: http://127.0.0.1:1\r\n", "{}", 403),
        (JSON + "Content-Length: 2\r\nOrigin: null\r\n", "{}", 403),
        (JSON + "Content-Length: 2\r\nHost: localhost:PORT\r\n", "{}", 403),  # two of them
        ("Content-Type: text/plain\r\nContent-Length: 2\r\n", "{}", 415),
        (JSON, "{}", 413),
        (JSON + "Content-Length: 2\r\nContent-Length: 3\r\n", "{}", 413),
        (JSON + "Content-Length: \u00b2\r\n", "{}", 413),
        (JSON + "Content-Length: -1\r\n", "{}", 413),
        (JSON + "Content-Length: 2000001\r\n", "{}", 413),
        (JSON + "Content-Length: 2\r\nTransfer-Encoding: chunked\r\n", "{}", 413),
        (JSON + "Content-Length: 9\r\n", "{}", 400),  # the rest never comes
    ],
)
def test_only_this_page_may_ask_and_lengths_are_kept(server, head, body, status):
    with socket.create_connection(server.server_address, timeout=10) as s:
        port = str(server.server_port)
        s.sendall(
            f"POST /api/jump HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{head}\r\n{body}".replace("PORT", port).encode(
                "latin-1"
            )
        )
        s.shutdown(socket.SHUT_WR)
        assert s.makefile("rb").readline().split()[1] == str(status).encode()


def test_a_taken_port_is_said_so(server):
    with pytest.raises(InputError, match=f"demo --port {server.server_port}"):
        Server(server.server_port)


def test_the_page_needs_nothing_from_elsewhere():
    pages = static_files("jumpvision.browser.demo", "index.html")
    assert {"/", "/index.html", "/main.js", "/style.css"} <= set(pages)
    assert len(pages) - 1 == len(list(files("jumpvision.browser.demo").joinpath("static").iterdir()))
    for name, (_, content) in pages.items():
        text = content.decode().replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text and "https://" not in text and "//cdn" not in text, name


def test_a_problem_names_its_settings():
    assert keys("model alpha, b: alpha + (b - 1/2) dm_a/dz < 0; foot_mass") == ["alpha", "b"]
    assert set(QUESTIONS) == {"/api/jump", "/api/map"}


def test_the_command_prints_the_address_serves_and_stops_on_interrupt():
    code = "import sys; from jumpvision.cli import main; sys.exit(main(['demo', '--port', '0', '--no-browser']))"
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


# --- in a browser ----------------------------------------------------------------------------------------------------


@pytest.fixture
def open_page(server, browser):
    """Opens the page; at the end nothing may have been said on the console but what `expected` matches."""
    contexts, said, expected = [], [], []

    def go(width=1280, height=800, **options):
        contexts.append(browser.new_context(viewport={"width": width, "height": height}, **options))
        page = contexts[-1].new_page()
        page.on("console", lambda m: said.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda e: said.append(str(e)))
        page.on("request", lambda r: said.append(r.url) if not r.url.startswith(server.address) else None)
        page.goto(server.address)
        until(page, "document.querySelector('#headline').textContent.includes('mm')")
        page.expected = expected
        return page

    yield go
    for c in contexts:
        c.close()
    assert [s for s in said if not any(e in s for e in expected)] == []


def until(page, condition):
    """Waits for a condition in JavaScript; playwright's own waiting needs eval, which the page's policy forbids."""
    deadline = time.monotonic() + 15.0
    while not page.evaluate(condition):
        assert time.monotonic() < deadline, f"never came true: {condition}"
        page.wait_for_timeout(30)


def headline(page) -> float:
    return float(page.inner_text("#headline").split()[1])


def changed(page, old) -> float:
    until(page, f"!document.querySelector('#headline').textContent.includes('{old:.1f} mm')")
    return headline(page)


PAINTED = """(id) => {
  const c = document.getElementById(id), d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
  return new Set(new Uint32Array(d.buffer)).size;
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_draws_the_default_jump(open_page, scheme):
    page = open_page(color_scheme=scheme, reduced_motion="reduce")
    assert headline(page) == 41.0  # docs/physics.md section 7: the best stutter jump
    until(page, "document.querySelector('#map-note').textContent.startsWith('200')")
    assert page.evaluate(PAINTED, "map") > 200  # most of the 256 colours
    assert page.evaluate(PAINTED, "robot") > 20
    assert page.evaluate(PAINTED, "traces") > 20
    assert page.inner_text("#clock") != "0 ms"  # still, at the top of the jump
    assert page.get_attribute("#play", "aria-label") == "Play"


def test_keys_reach_and_move_a_slider_and_space_plays(open_page):
    page = open_page(reduced_motion="reduce")
    for _ in range(20):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.id") == "s-frequency":
            break
    else:
        pytest.fail("Tab does not reach the frequency")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    for _ in range(10):
        page.keyboard.press("ArrowRight")
    new = changed(page, 41.0)
    direct = hard_map([8.7], [math.pi / 2], amplitude=4e-3, cycles=1.0, **ROBOT)["jump_height_m"][0, 0]
    until(page, f"document.querySelector('#headline').textContent.includes('{direct * 1e3:.1f} mm')")
    assert new < 41.0
    page.keyboard.press("Space")
    page.wait_for_selector("#play[aria-label=Pause]")
    page.keyboard.press("Space")
    page.wait_for_selector("#play[aria-label=Play]")


def test_it_plays_by_itself_and_the_scrubber_stops_it(open_page):
    page = open_page()
    first = page.inner_text("#clock")
    until(page, f"document.querySelector('#clock').textContent !== '{first}'")
    page.locator("#scrub").fill("500")
    page.wait_for_selector("#play[aria-label=Play]")


def test_a_click_on_the_map_sets_frequency_and_phase(open_page):
    page = open_page(reduced_motion="reduce")
    until(page, "document.querySelector('#map-note').textContent.startsWith('200')")
    page.locator("#map").scroll_into_view_if_needed()
    page.locator("#map").click(position={"x": 200, "y": 60})
    new = changed(page, 41.0)
    f, phase = float(page.input_value("#s-frequency-n")), float(page.input_value("#s-phase-n"))
    box = page.locator("#map").bounding_box()
    assert f == pytest.approx(1.0 + 23.0 * (200 - 40) / (box["width"] - 98), abs=0.2)  # 1.5 pixels
    assert phase == pytest.approx(2.0 * (1.0 - (60 - 6) / (box["height"] - 40)), abs=0.02)
    direct = hard_map([f], [phase * math.pi], amplitude=4e-3, cycles=1.0, **ROBOT)["jump_height_m"][0, 0]
    assert new == pytest.approx(1e3 * direct, abs=0.6)  # f and phase as shown are rounded


def test_sand_and_its_laws(open_page):
    page = open_page(reduced_motion="reduce")
    until(page, "document.querySelector('#map-note').textContent.startsWith('200')")
    page.locator("input[value=granular]").check(force=True)
    assert not page.inner_text("#map-note").startswith("200")  # the floor's map is no longer shown
    cone = changed(page, 41.0)
    assert page.locator("#s-C").is_visible() and not page.locator("#s-alpha").is_visible()
    page.locator("input[value=drag]").check(force=True)
    assert changed(page, cone) > cone  # constant drag over-predicts the stutter jump
    assert page.locator("#s-alpha").is_visible() and not page.locator("#s-C").is_visible()
    until(page, "document.querySelector('#map-note').textContent.includes('integrated')")
    page.locator("input[value=single]").check(force=True)
    until(page, "document.querySelector('#story').textContent.startsWith('One flight')")


def test_the_motor_can_be_moved_by_hand_and_by_keys(open_page):
    page = open_page(reduced_motion="reduce")
    box = page.locator("#grip").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(12):
        page.mouse.move(x, y + 40 * math.sin(k))
        page.wait_for_timeout(15)
    page.mouse.up()
    page.wait_for_selector("#law:not([hidden])")
    until(page, "!document.querySelector('#headline').textContent.includes('41.0 mm')")  # or no jump: a slow hand
    page.locator("#law").click()
    until(page, "document.querySelector('#headline').textContent.includes('41.0 mm')")
    page.locator("#grip").focus()
    for key in ("ArrowDown", "ArrowDown", "ArrowUp", "ArrowUp", "ArrowUp"):
        page.keyboard.press(key, delay=20)
    page.wait_for_selector("#law:not([hidden])")
    until(page, "!document.querySelector('#headline').textContent.includes('41.0 mm')")


def test_an_impossible_value_is_shown_at_its_field(open_page):
    page = open_page(reduced_motion="reduce")
    page.expected.append("400 (Bad Request)")  # the browser's own line for a refused question
    page.locator("#s-motor_mass-n").fill("-1")
    page.wait_for_selector("#s-motor_mass-wrong:not([hidden])")
    assert "must be in (0, 10000] kg" in page.inner_text("#s-motor_mass-wrong")
    assert page.get_attribute("#s-motor_mass-n", "aria-invalid") == "true"
    page.locator("#s-motor_mass-n").fill("1.003")
    page.wait_for_selector("#s-motor_mass-wrong", state="hidden")


def test_a_phone_needs_no_sideways_scrolling(open_page):
    page = open_page(360, 740, has_touch=True, is_mobile=True, reduced_motion="reduce")
    for ground in ("granular", "hard"):
        page.locator(f"input[value={ground}]").check(force=True)
        page.wait_for_timeout(200)
        for d in page.locator("details").all():
            d.evaluate("d => { d.open = true; }")
        wide = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert wide[0] <= wide[1] == 360
    page.locator("#s-frequency").scroll_into_view_if_needed()
    stage = page.locator("#stage").bounding_box()
    assert stage["y"] >= 0 and stage["y"] + stage["height"] < 400  # the robot stays in view beside the sliders
