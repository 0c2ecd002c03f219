"""The documentation as a site, without a network: `pip install '.[docs]'`, then `sphinx-build -W docs results/site`.

Its first page, results/site/index.html, is docs/README.md: where to begin, and which page answers what."""

import re
import shutil
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import reference
import surprises
import tables

import jumpvision

PARTS = {  # of the site
    "Begin": ["samples", "tutorial", "workbench", "notebook", "bring_your_own_data"],
    "Only match pictures": ["velocity_fields"],
    "Only track": ["tracking"],
    "Test a simulation": ["diagnosis", "any_simulator"],
    "Jumping robots": ["planning", "report", "figures"],
    "Reference": [
        "commands", "keys", "api", "files", "stages", "physics", "hard_ground", "granular", "laboratory", "scale",
        "piv_sigma", "disc_image", "benchmarks", "beside", "surprises", "architecture",
    ],
    "Stages": [
        "stages/track", "stages/bed", "stages/crater", "stages/geometry", "stages/piv", "stages/flow", "stages/column",
        "stages/intrusion", "stages/fit", "stages/simulate",
    ],
}  # fmt: skip

project, author, release = "jumpvision", "the authors of jumpvision", jumpvision.__version__
extensions = ["myst_parser"]
root_doc = "README"
myst_heading_anchors = 4
html_theme = "furo"
html_title = "jumpvision"
html_show_copyright = False
suppress_warnings = ["misc.highlighting_failure"]  # signatures are not whole statements


def _trees() -> str:
    each = (f":caption: {part}\n:hidden:\n\n" + "\n".join(pages) for part, pages in PARTS.items())
    return "".join(f"\n```{{toctree}}\n{text}\n```\n" for text in each)


def _read(app, docname, source) -> None:
    """The index gets the parts; a link out of docs/ becomes its words, one that names its file a title."""
    out = re.escape("../" * (docname.count("/") + 1))
    text = re.sub(rf"\[([^\]]+)\]\({out}[^)]*\)", r"\1", source[0])
    text = re.sub(r"\[(\w+\.md)\]\(\1\)", r"[](\1)", text)
    source[0] = text + (_trees() if docname == root_doc else "")


def _index(app, exception) -> None:
    """The first page under the name that a browser and a web server look for."""
    if exception is None and app.builder.name == "html":
        shutil.copyfile(Path(app.outdir) / f"{root_doc}.html", Path(app.outdir) / "index.html")


def _generate(app) -> None:
    """Write keys.md, api.md and surprises.md, which are made from the code and not kept in git."""
    for module in (tables, reference, surprises):
        module.TARGET.write_text(module.text(), encoding="utf-8")


def setup(app) -> None:
    """Called by Sphinx."""
    app.connect("builder-inited", _generate)
    app.connect("source-read", _read)
    app.connect("build-finished", _index)
