"""What is passed on with the libraries of others carries their notice."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGING = ROOT / "pipelines" / "packaging"
GPL = ("x264", "x265", "xvid", "vidstab", "rubberband", "postproc")  # of FFmpeg's parts those under the GPL alone


def test_the_gpl_libraries_of_the_installed_wheel_are_named():
    found = importlib.util.find_spec("av")
    libs = Path(found.origin).parents[1] / "av.libs"
    if not libs.is_dir():
        pytest.skip("av is no wheel with its own libraries here")
    held = [name for name in GPL if any(name in f.name for f in libs.iterdir())]
    notice = (PACKAGING / "THIRD_PARTY.txt").read_text(encoding="utf-8")
    assert all(f"lib{name} " in notice for name in held) and "Offer of source" in notice


@pytest.mark.parametrize("recipe", ["Dockerfile", "pipelines/jumpvision.def", "pipelines/packaging/jumpvision.spec"])
def test_every_recipe_takes_the_notice_along(recipe):
    text = (ROOT / recipe).read_text(encoding="utf-8")
    assert "packaging/*.txt" in text or '("THIRD_PARTY.txt", "."), ("GPL-2.txt", ".")' in text
    assert (PACKAGING / "GPL-2.txt").read_text(encoding="utf-8").lstrip().startswith("GNU GENERAL PUBLIC LICENSE")
