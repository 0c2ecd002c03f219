"""What new users met who knew only the README: small drawn inputs, one section for each."""

from __future__ import annotations

import csv
import re

from tests.worlds.small import edit, run_here, write_campaign

# -- a campaign that cannot be diagnosed ----------------------------------------------------------------------


def test_a_campaign_that_cannot_be_diagnosed_ends_with_its_table_and_page(tmp_path, capsys):
    """Five trials of one motion, one of them written without `start`: by their texts two motions, of which one has no
    track. `run` ends as without a [model]; the terminal and the page say what is lacking."""
    campaign, results = write_campaign(tmp_path / "campaign", 5), tmp_path / "results"
    toml = campaign / "campaign.toml"
    toml.write_text(toml.read_text() + "[model]\nterms = []\n")
    for folder in campaign.glob("jump-*"):
        file = folder / "experiment.toml"
        file.write_text(re.sub("frequency = .*", "frequency = 8.0", file.read_text()))
    edit(campaign / "jump-0003", "start = 0.1\n", "")
    assert run_here(campaign, results) == 0
    why = "5 jumps of 1 condition; at least 4 of 2 are needed"
    assert f"not diagnosed: {why}" in capsys.readouterr().err
    rows = list(csv.DictReader((results / "jumps.csv").open()))
    assert len(rows) == 5 and sum(bool(r["jump_height_m"]) for r in rows) >= 4
    assert f"Not diagnosed: {why}" in (results / "report.html").read_text()
    assert (results / "campaign.json").exists() and not (results / "diagnosis.json").exists()
