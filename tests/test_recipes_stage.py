"""The recipe "Add a stage" of CONTRIBUTING.md in a copy of the package: three files, and all else follows."""

from __future__ import annotations

import pytest
from recipe import DOCS, package_with, run_there

STAGE = '''"""Slip: how long the robot does not touch the ground (a stage of the recipe)."""

from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.parameters import SlipParams
from jumpvision.experiment.inputs.sections import ContactLog
from jumpvision.experiment.results.values import Slip
from jumpvision.experiment.workflow.stage import stage


@stage(
    version=1,
    any_of=("contact",),
)
def slip(contact: ContactLog, *, p: SlipParams) -> Slip:
    """Time in the air [s] from [contact_log].

    Every sample counts alike.
    """
    d = read_log(contact.path, "time_s", "contact", at_least=2)
    step = (d.time_s.iloc[-1] - d.time_s.iloc[0]) / (len(d) - 1)
    return Slip({"air_s": p.share * float(step * (d.contact == 0).sum())})
'''
RECORD = '''

class Slip(Values):
    """Time in the air [s]."""

    file = "slip.json"
'''
PARAMS = '''

@dataclass(frozen=True)
class SlipParams(Params):
    """How time in the air is counted."""

    stage: ClassVar[str] = "slip"

    share: float = param(1.0, "", "share of the time that counts", lo=0, hi=1)

'''
SCRIPT = """
import contextlib, inspect, io, json, sys, warnings
from pathlib import Path
sys.path.append(sys.argv[1])
import jumpvision as jv
from jumpvision.cli import main

warnings.simplefilter("ignore")

def said(*words, code=0):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        assert main(list(words)) == code, err.getvalue()
    return out.getvalue() + err.getvalue()

out = {"help": said("--help")}
out["done"] = said("slip", "experiment", "--no-pictures")
out["file"] = json.loads(Path("results/experiment/slip.json").read_text())
out["notebook"] = jv.slip(jv.open("experiment", set=["slip.share=0.5"]), results="half").values
out["doc"] = inspect.getdoc(jv.slip)
Path("air.toml").write_text('stages = ["slip"]\\n[params.slip]\\nshare = 0.25\\n')
said("run", "experiment", "--pipeline", "air.toml", "--results", "quarter", "--no-report")
out["pipeline"] = json.loads(Path("quarter/slip.json").read_text())
out["refused"] = said("run", "experiment", "--set", "slip.share=2", code=2)
out["params"] = said("params", "slip")
import tables, reference
out["keys"], out["stub"] = tables.text(), reference.stub()
print(json.dumps(out))
"""


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    place = tmp_path_factory.mktemp("recipe")
    package_with(
        place,
        {"experiment/stages/slip.py": STAGE},
        {"experiment/results/values.py": RECORD, "experiment/inputs/parameters.py": PARAMS},
    )
    folder = place / "experiment"
    folder.mkdir()
    rows = [f"{0.01 * i:.2f},{int(not 20 <= i < 50)}" for i in range(101)]  # 0.3 s in the air
    (folder / "contact.csv").write_text("time_s,contact\n" + "\n".join(rows) + "\n")
    (folder / "experiment.toml").write_text('ground = "hard"\n[contact_log]\nfile = "contact.csv"\n')
    return run_there(place, SCRIPT, str(DOCS))


def test_command_notebook_and_pipeline_run_it(out):
    assert out["file"]["air_s"] == pytest.approx(0.3)
    assert out["notebook"]["air_s"] == pytest.approx(0.15)
    assert out["pipeline"]["air_s"] == pytest.approx(0.075)


def test_every_list_knows_it(out):
    assert "Time in the air [s] from [contact_log]" in " ".join(out["help"].replace("│", " ").split())
    assert "(slip.json)" in out["doc"] and "share = 1.0: share of the time" in out["doc"]
    assert "share" in out["params"] and "### [params.slip]" in out["keys"] and "| slip | Time in the air" in out["keys"]
    assert "def slip(" in out["stub"]
    assert "share" in out["refused"] and "1" in out["refused"]
