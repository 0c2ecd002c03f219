"""What several test files share: the samples analysed once, and where real recordings are."""

from __future__ import annotations

import gc
import importlib
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from shared import ROOT, SAMPLES

for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):  # before numpy is imported, as the command line does:
    os.environ.setdefault(_threads, "1")  # matrices here are small, and threads of two workers wait for one another

KEPT = pytest.StashKey[bool]()  # what Python was told of bytecode


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session):
    """In a fresh clone pytest writes the asserts of every test file anew, a quarter of a minute: of two workers each
    writes half of them, as the second begins with the last file. Its errors are told when it is collected. They are
    kept where Python is told to keep no bytecode too, else each worker writes all of them in each run."""
    session.config.stash[KEPT], sys.dont_write_bytecode = sys.dont_write_bytecode, False
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0")
    if int(worker[2:]) % 2 and [Path(a) for a in session.config.args] == [ROOT / "tests"]:
        for file in sorted((ROOT / "tests").rglob("test_*.py"), reverse=True):
            if str(file.parent) not in sys.path:  # as pytest has it when it collects the file
                sys.path.insert(0, str(file.parent))
            try:
                importlib.import_module(file.stem)
            except (Exception, pytest.skip.Exception):
                sys.modules.pop(file.stem, None)


def pytest_collection_finish(session):
    """What 3,000 tests import stays, and need not be looked through for garbage time and again."""
    sys.dont_write_bytecode = session.config.stash[KEPT]
    gc.freeze()


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


@pytest.fixture(scope="session")
def sound(tmp_path_factory) -> Path:
    """A small filmed experiment that runs without an error."""
    from tests.worlds.small import filmed_experiment

    return filmed_experiment(tmp_path_factory.mktemp("sound") / "exp")


@pytest.fixture
def folder(sound, tmp_path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(sound, tmp_path / "campaign" / "exp"))


@pytest.fixture(scope="session")
def calm(tmp_path_factory) -> Path:
    """A campaign of two experiments and its results: folder/campaign, folder/results. Not to be changed."""
    from jumpvision.base import storage
    from tests.worlds.small import run_here, write_campaign

    folder = tmp_path_factory.mktemp("calm")
    campaign = write_campaign(folder / "campaign", 2)
    time.sleep(storage.FRESH)  # what was hashed just after it was written is hashed again
    assert run_here(campaign, folder / "results") == 0
    return folder


@pytest.fixture
def work(calm, tmp_path) -> Path:
    """A copy of it."""
    return Path(shutil.copytree(calm, tmp_path / "work"))


@pytest.fixture(scope="session")
def results(tmp_path_factory) -> Path:
    """Both samples analysed once for all workers, about 100 s on two cores; pictures of one are enough here."""
    import fcntl  # POSIX

    root = tmp_path_factory.getbasetemp()
    root = (root.parent if "PYTEST_XDIST_WORKER" in os.environ else root) / "analysed"
    root.mkdir(exist_ok=True)
    run = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))", "run"]
    with (root / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # the others wait
        for name, options in (("hard_ground", ()), ("loose_sand", ("--no-pictures", "--table"))):
            if (root / f"{name}.out").exists():
                continue
            call = [*run, str(SAMPLES / name), "--results", str(root / name), *options]
            done = subprocess.run(call, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
            (root / f"{name}.out").write_text(done.stdout)
    return root


@pytest.fixture(scope="module")
def playwright():
    """The one of a process, which starts no second; its event loop runs until the module's end."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    with api.sync_playwright() as p:
        yield p


def program(variable: str, *names: str) -> str:
    """Path of a browser, else the test is skipped."""
    path = os.environ.get(variable) or next(filter(None, map(shutil.which, names)), None)
    if path is None:
        pytest.skip(f"no {' or '.join(names)} in PATH; {variable} may name one")
    return path


@pytest.fixture(scope="module")
def browser(playwright):
    path = program("JUMPVISION_CHROMIUM", "chromium", "chromium-browser", "google-chrome")
    b = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
    yield b
    b.close()


@pytest.fixture(scope="module")
def firefox(playwright):
    """A stock Firefox over WebDriver BiDi, as a context with nothing emulated; playwright's own build is not needed."""
    path = program("JUMPVISION_FIREFOX", "firefox", "firefox-esr")
    still = {"ui.prefersReducedMotion": 1}
    given = dict.fromkeys(("color_scheme", "reduced_motion", "forced_colors", "contrast"), "null")
    try:
        b = playwright.firefox.launch(channel="moz-firefox", executable_path=path, firefox_user_prefs=still)
        context = b.new_context(viewport={"width": 1280, "height": 800}, **given)
    except Exception as error:  # other BiDi commands than this Firefox has; 1.58 drives Firefox 153
        if type(error).__module__.partition(".")[0] != "playwright":
            raise
        pytest.skip(f"this playwright cannot drive {path}: {str(error).splitlines()[0]}")
    yield context
    b.close()
