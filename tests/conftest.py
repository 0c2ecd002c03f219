"""What several test files share: the samples analysed once, and where real recordings are."""

from __future__ import annotations

import gc
import importlib
import os
import shutil
import sys
from pathlib import Path

import pytest

for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # before numpy is imported, as the command line does:
    os.environ.setdefault(_threads, "1")  # matrices here are small, and threads of two workers wait for one another

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "data_samples"
KEPT = pytest.StashKey[bool]()  # what Python was told of bytecode


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session):
    """In a fresh clone pytest writes the asserts of every test file anew, a quarter of a minute: of two workers each
    writes half of them, as the second begins with the last file. Its errors are told when it is collected. They are
    kept where Python is told to keep no bytecode too, else each worker writes all of them in each run."""
    session.config.stash[KEPT], sys.dont_write_bytecode = sys.dont_write_bytecode, False
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0")
    if int(worker[2:]) % 2 and [Path(a) for a in session.config.args] == [ROOT / "tests"]:
        for file in sorted((ROOT / "tests").glob("test_*.py"), reverse=True):
            try:
                importlib.import_module(file.stem)
            except (Exception, pytest.skip.Exception):
                sys.modules.pop(file.stem, None)


def pytest_collection_finish(session):
    """What 3,000 tests import stays, and need not be looked through for garbage time and again."""
    sys.dont_write_bytecode = session.config.stash[KEPT]
    gc.freeze()


def later(*cases: object) -> list:
    """Cases of a parameter that are left to the second run, `-m long`; the first has others of the same test."""
    return [pytest.param(*(c if isinstance(c, tuple) else (c,)), marks=pytest.mark.long) for c in cases]


@pytest.fixture(scope="session", autouse=True)
def a_core_each():
    """The workers of pytest share the cores; a command of a test that is not told how many processes starts none."""
    if int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")) > 1:
        importlib.import_module("jumpvision.cli.app")  # from which commands that are loaded later take it
        for name, module in list(sys.modules.items()):
            if name.startswith("jumpvision.cli.") and hasattr(module, "cores"):
                module.cores = lambda: 1


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real recordings by others; tests that need it skip where it is not given."""
    folder = os.environ.get("JUMPVISION_REAL_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("JUMPVISION_REAL_DATA does not name the folder of real recordings")
    return Path(folder)


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed: pip install playwright"
    )
    names = ("chromium", "chromium-browser", "google-chrome")
    path = os.environ.get("JUMPVISION_CHROMIUM") or next(filter(None, map(shutil.which, names)), None)
    if path is None:
        pytest.skip("no chromium, chromium-browser or google-chrome in PATH; JUMPVISION_CHROMIUM may name one")
    with playwright.sync_playwright() as p:
        b = p.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        yield b
        b.close()


@pytest.fixture(scope="module")
def firefox():
    """A stock Firefox over WebDriver BiDi, as a context with nothing emulated; playwright's own build is not needed."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed: pip install playwright"
    )
    names = ("firefox", "firefox-esr")
    path = os.environ.get("JUMPVISION_FIREFOX") or next(filter(None, map(shutil.which, names)), None)
    if path is None:
        pytest.skip("no firefox or firefox-esr in PATH; JUMPVISION_FIREFOX may name one")
    with playwright.sync_playwright() as p:
        still = {"ui.prefersReducedMotion": 1}
        given = dict.fromkeys(("color_scheme", "reduced_motion", "forced_colors", "contrast"), "null")
        try:
            b = p.firefox.launch(channel="moz-firefox", executable_path=path, firefox_user_prefs=still)
            context = b.new_context(viewport={"width": 1280, "height": 800}, **given)
        except playwright.Error as error:  # other BiDi commands than this Firefox has; 1.58 drives Firefox 153
            pytest.skip(f"this playwright cannot drive {path}: {str(error).splitlines()[0]}")
        yield context
        b.close()
