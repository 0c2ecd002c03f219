"""The recipe "Add a command" of CONTRIBUTING.md in a copy of the package: one file, and all else follows."""

from __future__ import annotations

from recipe import ROOT, package_with, run_there

COMMAND = '''"""Counting experiments (a command of the recipe)."""

from __future__ import annotations

from pathlib import Path

from .app import DONE, OPTIONS, Options, app
from .folders import open_folder


@app.command
def count(path: Path, /, *, options: Options = OPTIONS) -> int:
    """How many experiments a folder holds.

    Example: jumpvision count data_samples/loose_sand
    """
    from . import terminal

    n = len(open_folder(path, options).experiments)
    terminal.result({"experiments": n}, [{"experiments": n}], as_json=options.json)
    return DONE
'''
SCRIPT = """
import contextlib, io, json, sys
from jumpvision.cli import main

def said(*words, code=0):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        assert main(list(words)) == code, err.getvalue()
    return out.getvalue() + err.getvalue()

out = {"help": said("--help"), "count": json.loads(said("count", sys.argv[1], "--json"))}
out["light"] = sorted({m.split(".")[0] for m in sys.modules} & {"numpy", "scipy", "numba"})
out["wrong"] = said("count", "nowhere", code=2)
print(json.dumps(out))
"""


def test_a_command_is_its_own_file(tmp_path):
    package_with(tmp_path, {"cli/count.py": COMMAND})
    out = run_there(tmp_path, SCRIPT, str(ROOT.parent / "data_samples" / "loose_sand"))
    assert "How many experiments a folder holds" in " ".join(out["help"].replace("│", " ").split())
    assert out["count"] == {"experiments": 25}
    assert "nowhere" in out["wrong"]
