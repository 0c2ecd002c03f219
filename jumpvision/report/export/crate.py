"""Results as an RO-Crate 1.1 (https://w3id.org/ro/crate/1.1): what they are, what made them, how to cite them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jumpvision import __version__
from jumpvision.base.extras import require_extra
from jumpvision.experiment import files

from .results import Results

FORMATS = {
    ".csv": "text/csv",
    ".json": "application/json",
    ".html": "text/html",
    ".toml": "application/toml",
    ".nc": "application/x-netcdf",
    ".png": "image/png",
    ".webm": "video/webm",
}
UNSTATED = "not stated: ask the owner of the recordings"
SPDX = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*")
DOI = re.compile(r"(?:doi:\s*|https?://(?:dx\.)?doi\.org/)?(10\.\d{4,9}/\S+)", re.IGNORECASE)


def write_crate(found: list[Results], out: Path) -> list[str]:
    """Every result with its SHA-256, the run of each experiment as a CreateAction; what is left to be given."""
    with require_extra("rocrate", "--to ro-crate", "ro-crate"):
        from rocrate.model.contextentity import ContextEntity
        from rocrate.rocrate import ROCrate
    crate = ROCrate(version="1.1")

    def entity(of: str, /, **properties: Any) -> Any:
        return crate.add(ContextEntity(crate, of, properties={k: v for k, v in properties.items() if v}))

    top = found[0].folder.absolute().name
    crate.name, crate.description = top, f"Results of jumpvision {__version__}: {top}"
    program = entity(
        "#jumpvision", **{"@type": "SoftwareApplication", "name": "jumpvision", "softwareVersion": __version__}
    )
    for r in found:
        prefix = f"{r.name}/" if len(found) > 1 and r.name else ""
        listed = files.PROVENANCE if r.name else files.CAMPAIGN
        made = [
            crate.add_file(
                r.folder / f,
                prefix + f,
                properties={
                    "name": prefix + f,
                    "encodingFormat": FORMATS.get(Path(f).suffix, "application/octet-stream"),
                    "contentSize": str((r.folder / f).stat().st_size),
                    **({"identifier": f"sha256:{r.outputs[f]}"} if f in r.outputs else {}),
                },
            )
            for f in (*r.outputs, listed)
        ]
        read = [
            entity(f"#sha256-{digest}", **{"@type": "CreativeWork", "name": f, "identifier": f"sha256:{digest}"})
            for f, digest in r.provenance.get("inputs", {}).items()
        ]
        action = entity(
            f"#run-{r.name or top}",
            **{
                "@type": "CreateAction",
                "name": r.provenance.get("command") or f"jumpvision run {r.name or top}",
                "description": _versions(r.provenance.get("versions", {})),
            },
        )
        action["instrument"], action["result"] = program, made
        if read:
            action["object"] = read
        crate.root_dataset.append_to("mentions", action)
    lacking = []
    crate.license = UNSTATED
    for key, write in (("license", _license), ("citation", _citation)):
        texts = sorted({r.provenance[key] for r in found if r.provenance.get(key)})
        if texts:
            crate.root_dataset[key] = [entity(name, **facts) for name, facts in map(write, texts)]
        else:
            lacking.append(f"no {key}: give {key} = ... above the first section of experiment.toml or campaign.toml")
    crate.write(out)
    return lacking


def _versions(versions: Mapping[str, object]) -> str:
    packages = ", ".join(f"{p} {v}" for p, v in versions.items() if isinstance(v, str))
    return f"made with {packages}" if packages else ""


def _license(text: str) -> tuple[str, Mapping[str, str]]:
    """An address stays, an SPDX identifier becomes one, other words are described."""
    spdx = SPDX.fullmatch(text)
    where = text if "://" in text else f"https://spdx.org/licenses/{text}" if spdx else "#license"
    return where, {"@type": "CreativeWork", "name": text, "description": f"licence of the data: {text}"}


def _citation(text: str) -> tuple[str, Mapping[str, str]]:
    found = DOI.search(text)
    where = text if re.fullmatch(r"https?://\S+", text) else "#citation"
    doi = f"https://doi.org/{found[1].rstrip('.,;)')}" if found else where
    return doi, {"@type": "ScholarlyArticle", "name": text}
