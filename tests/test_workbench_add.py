"""Files dropped on the workbench: copied whole into a new folder, or not at all; nothing that exists is changed."""

from __future__ import annotations

import errno
import http.client
import json
import os
import shutil
import socket
import time
import tracemalloc
from pathlib import Path

import pytest
from test_workbench_flow import Hand, falling, many_pairs, served  # noqa: F401

from jumpvision.base.schema import InputError
from jumpvision.browser.workbench.adding import Adding

PIECE = bytes(range(256)) * 4096  # 1 MiB


def posted(server, path: str, body: object, kind: str = "application/json", root: str | None = None):
    c = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    content = body if isinstance(body, bytes) else json.dumps(body).encode()
    c.request("POST", (server.root if root is None else root) + path, content, {"Content-Type": kind})
    reply = c.getresponse()
    answer = json.loads(reply.read())
    c.close()
    return reply.status, answer


def tree(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def test_a_large_film_does_not_stand_in_memory(tmp_path):
    adding = Adding(tmp_path, "new", {"a.npy": 300 * len(PIECE)})
    tracemalloc.start()
    adding.write("a.npy", (PIECE for _ in range(300)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (adding.done() / "a.npy").stat().st_size == 300 * 2**20 and peak < 2 * 2**20


def test_a_film_is_sent_in_pieces_and_half_of_one_leaves_nothing(tmp_path, served):  # noqa: F811
    falling(tmp_path / "drop")
    s, size = served(tmp_path / "drop"), 64 * len(PIECE)
    before = tree(tmp_path)
    assert posted(s, "api/add", {"folder": "new", "files": {"a.npy": size, "b.csv": 3}}) == (200, {})
    c = http.client.HTTPConnection("127.0.0.1", s.port, timeout=60)
    kind = {"Content-Type": "application/octet-stream", "Content-Length": str(size)}
    tracemalloc.start()
    c.request("POST", f"{s.root}api/add/file/a.npy", iter([PIECE] * 40), kind)
    end = time.monotonic() + 20
    while not any(p.stat().st_size >= 30 * len(PIECE) for p in (tmp_path / "new").glob("*")):
        assert time.monotonic() < end
        time.sleep(0.01)
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["a.npy.part"]  # until it is whole
    assert tracemalloc.get_traced_memory()[1] < 8 * len(PIECE)
    tracemalloc.stop()
    c.sock.shutdown(socket.SHUT_RDWR)
    c.close()
    while s.benches.adding.writing or list((tmp_path / "new").iterdir()):
        assert time.monotonic() < end, list((tmp_path / "new").iterdir())
        time.sleep(0.01)
    assert posted(s, "api/add/file/b.csv", b"abc", "application/octet-stream") == (200, {})
    status, answer = posted(s, "api/add/end", {})
    assert status == 400 and "a.npy is missing" in answer["problems"][0]
    status, answer = posted(s, "api/add/stop", {})
    assert (
        status == 200 and "came" in answer["problem"] and tree(tmp_path) == before and not (tmp_path / "new").exists()
    )


def test_what_is_refused_is_refused_in_plain_words(tmp_path, served, monkeypatch):  # noqa: F811
    falling(tmp_path / "drop")
    s, before = served(tmp_path / "drop"), tree(tmp_path)
    for folder, files, said in (
        ("drop", {"a.npy": 1}, "exists|is open"),
        ("../out", {"a.npy": 1}, "plain name"),
        (".x", {"a.npy": 1}, "plain name"),
        ("results", {"a.npy": 1}, "plain name"),
        ("new", {"../a.npy": 1}, "plain name of a file"),
        ("new", {"a.npy": 1, "A.npy": 1}, "same name"),
        ("new", {"letter.docx": 1}, "'.docx' is no known recording"),
        ("new", {"a.npy": 10**18}, "no space: .* GB to copy"),
        ("new", {}, "must be 1 to"),
    ):
        status, answer = posted(s, "api/add", {"folder": folder, "files": files})
        with pytest.raises(InputError, match=said):
            raise InputError(answer["problems"])
        assert status == 400 and tree(tmp_path) == before and not (tmp_path / "new").exists()
    assert posted(s, "api/add", {"folder": "new", "files": {"a.npy": 1}}, root="/")[0] == 403
    assert posted(s, "api/add/file/a.npy", b"x", "application/octet-stream")[0] == 400  # none begun
    (tmp_path / "taken").mkdir()
    adding = Adding(tmp_path, "full", {"a.npy": 3})
    (tmp_path / "full" / "a.npy").write_bytes(b"old")  # of somebody else, meanwhile
    with pytest.raises(InputError, match="exists already"):
        adding.write("a.npy", [b"new"])
    adding.stop()
    assert tree(tmp_path / "full") == {"a.npy": b"old"}

    def no_space():
        yield b"xx"
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    adding = Adding(tmp_path, "disk", {"a.npy": 3})
    with pytest.raises(InputError, match="no space left on this disk"):
        adding.write("a.npy", no_space())
    adding.stop()
    assert not (tmp_path / "disk").exists()


# --- by hand, in a browser --------------------------------------------------------------------------------------------


def dropped(h: Hand, *files: Path) -> None:
    """Drops files from outside on the middle of the page."""
    data = {"items": [], "files": [str(f) for f in files], "dragOperationsMask": 1}
    cdp = h.page.context.new_cdp_session(h.page)
    for kind in ("dragEnter", "dragOver", "drop"):
        cdp.send("Input.dispatchDragEvent", {"type": kind, "x": 600, "y": 300, "data": data})


def test_dropped_pictures_become_an_experiment_beside_and_are_opened(tmp_path, browser, served):  # noqa: F811
    (tmp_path / "work").mkdir()
    falling(tmp_path / "work" / "drop")
    source = many_pairs(tmp_path / "camera")
    s = served(tmp_path / "work" / "drop")
    h = Hand(browser, s)
    notes = tmp_path / "letter.docx"
    notes.write_text("x")
    dropped(h, *sorted(source.iterdir()), notes)
    h.page.locator("#adding").wait_for()
    assert "6 files" in h.page.inner_text("#adding") and "letter.docx" in h.page.inner_text("#adding")
    field = h.page.get_by_label("Its name")
    field.fill("drop")
    h.page.get_by_role("button", name="Copy and open").click()
    h.page.get_by_text("give another name").wait_for()
    if place := os.environ.get("JUMPVISION_SCREENSHOTS"):
        h.page.screenshot(path=f"{place}/adding.png")
    field.fill("jet")
    h.page.get_by_role("button", name="Copy and open").click()
    h.until("workbench.store.state.name === 'jet'")
    assert tree(tmp_path / "work" / "jet") == tree(source)
    assert h.get("workbench.store.table.grain_video.pairs") == "names"
    h.page.select_option("#experiment", "drop")  # what was open is there still
    h.until("workbench.store.state.name === 'drop'")
    assert [t for t in h.said if "400" not in t] == []


def test_a_folder_is_dropped_and_a_film_is_added_by_the_button(tmp_path, browser, served):  # noqa: F811
    work = tmp_path / "work"
    work.mkdir()
    falling(work / "drop")
    source = many_pairs(tmp_path / "camera")
    s = served(work / "drop")
    h = Hand(browser, s)
    dropped(h, source)
    h.page.locator("#adding").wait_for()
    assert h.page.get_by_label("Its name").input_value() == "camera"  # the folder's own name is proposed
    h.page.keyboard.press("Enter")
    h.until("workbench.store.state.name === 'camera'")
    assert tree(work / "camera") == tree(source)
    shutil.copy(work / "drop" / "rod.npy", tmp_path / "toss.npy")
    with h.page.expect_file_chooser() as asked:
        h.click("#add")
    asked.value.set_files(tmp_path / "toss.npy")
    h.page.get_by_role("button", name="Copy and open").click()
    h.until("workbench.store.state.name === 'toss'")
    assert h.get("workbench.store.state.experiments") == ["drop", "camera", "toss"]
    h.page.keyboard.press("t")
    h.until("workbench.store.track.rows.length === 20")
    assert h.said == []


def test_a_copy_that_is_stopped_leaves_nothing(tmp_path, browser, served):  # noqa: F811
    falling(tmp_path / "drop")
    s = served(tmp_path / "drop")
    h, slow = Hand(browser, s), Adding.write

    def waits(self, name, pieces):
        slow(self, name, (time.sleep(0.05) or p for p in pieces))

    Adding.write = waits
    try:
        (tmp_path / "big.npy").write_bytes(PIECE * 40)
        with h.page.expect_file_chooser() as asked:
            h.click("#add")
        asked.value.set_files(tmp_path / "big.npy")
        h.page.get_by_label("Its name").fill("new")
        h.page.get_by_role("button", name="Copy and open").click()
        end = time.monotonic() + 20
        while not list(tmp_path.glob("new/*.part")):
            assert time.monotonic() < end
            time.sleep(0.01)
        h.page.get_by_role("button", name="Cancel").click()
        h.page.get_by_text("what was copied is removed").wait_for()
        while (tmp_path / "new").exists():
            assert time.monotonic() < end, list((tmp_path / "new").iterdir())
            time.sleep(0.01)
    finally:
        Adding.write = slow
    assert h.get("workbench.store.state.name") == "drop"
