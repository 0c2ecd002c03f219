"""Draw the figures of docs/hard_ground.md and print its numbers: `python docs/hard_figures.py [NAME ...]`; 1 min."""

from __future__ import annotations

import io
import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory import write
from jumpvision.laboratory.jumper import Law, motion_of
from jumpvision.laboratory.samples import HARD_ROBOT
from jumpvision.thesis.figures.sweeps import picture
from jumpvision.thesis.studies.comparison import compare
from jumpvision.thesis.studies.study import Call, run, studies

IMAGES = Path(__file__).with_name("images")
WIDTH, COLOURS = 1000, 256  # of a picture: the width of a page, and a palette that keeps its maps
HIDDEN = {"e": 0.1}  # landing loss that the model of the comparison's campaign does not know


def save(name: str, png: bytes) -> None:
    """docs/images/hard_NAME.png, small."""
    image = Image.open(io.BytesIO(png)).convert("RGB")
    image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    image.quantize(COLOURS, kmeans=4, dither=Image.Dither.NONE).save(IMAGES / f"hard_{name}.png", optimize=True)


def campaign(folder: Path) -> Path:
    """Tracks of 40 jumps of the laboratory, on scattered frequencies and phases, with HIDDEN in force."""
    rng = np.random.default_rng(20140630)
    folder.mkdir()
    robot = {n: round(v, 9) for n, v in HARD_ROBOT._asdict().items()}
    sigma = {"spring_stiffness": 30.0, "spring_damping": 0.1, "gravity": 0.01}
    write.toml(folder / "campaign.toml", {"ground": "hard", "robot": robot, "robot.sigma": sigma})
    for i, (f, phase) in enumerate(zip(rng.uniform(6.0, 17.0, 40), rng.uniform(0.35 * math.pi, 1.7 * math.pi, 40))):
        law = Law(round(float(f), 2), 0.004, round(float(phase), 3), 0.2)
        motion = motion_of(HARD_ROBOT, law, ["landing_loss"], HIDDEN, ground="hard", duration=1.0, dt=5e-6, every=20)
        own = folder / f"jump-{i:02d}"
        own.mkdir()
        write.table(own / "rod.csv", logs.rod_track(motion, rate=200.0, noise=5e-5, zero=0.0, rng=rng))
        text = {"kind": "sine", "frequency": law.frequency, "amplitude": 0.004, "phase": law.phase, "start": 0.2}
        write.toml(own / "experiment.toml", {"actuation": text, "rod_track": {"file": "rod.csv"}})
    return folder


def main(names: list[str]) -> None:
    """The pictures named, or all."""
    for name in names or studies("hard"):
        if name == compare.name:
            with tempfile.TemporaryDirectory() as place:
                folder = campaign(Path(place) / "campaign")
                data, rows = run(Call("hard", {}, name, campaign=folder, results=Path(place) / "results"))
                rows = rows[-1:]
        else:
            data, rows = run(Call("hard", {}, name))
        save(name, picture(data))
        for row in rows:
            print(name, "|", " | ".join(str(v) for v in row.values()), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
