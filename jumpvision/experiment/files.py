"""Names of the files that lie among results, in one place (docs/files.md says what is in them)."""

from __future__ import annotations

from jumpvision.engine import document

JUMPS = "jumps.csv"  # a row an experiment of a campaign
CAMPAIGN = "campaign.json"
DIAGNOSIS = document.FILE
PICTURE = "diagnosis.png"
MODEL = "model.toml"  # the extended model
SAMPLES = "samples.csv"  # of a user's own simulator in question
REPORT = "report.html"
PROVENANCE = "provenance.json"
SUMMARY = "summary.json"
ACTUATOR = "actuator.csv"
BANDWIDTH = "actuator_bandwidth.json"
CRATERS = "craters.csv"
FITS = "fits.json"
INTRUSIONS = "intrusion.csv"
INTRUSION_LAWS = "intrusion_laws.json"
BED_LAWS = "bed_laws.toml"

OF_A_CAMPAIGN = frozenset(
    {JUMPS, CAMPAIGN, DIAGNOSIS, PICTURE, MODEL, SAMPLES, REPORT, PROVENANCE}
    | {ACTUATOR, BANDWIDTH, CRATERS, FITS, INTRUSIONS, INTRUSION_LAWS, BED_LAWS}
)
