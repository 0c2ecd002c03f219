"""Parameters of the bed as laws of its volume fraction, read from a table: a number, or values at increasing phi."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics.packing_laws import PackingLaw
from jumpvision.physics.parameters import ModelParameters
from jumpvision.physics.points import BY_AREA, OF_MODEL
from jumpvision.schema import check_value, closest, type_of

BED_PARAMETERS = ("k", "k1", "k2", "delta", "sigma_cone", "alpha", "b", "C", "mu", "theta", "s", "lam", "s_p")


@dataclass(frozen=True)
class Laws:
    """Parameters of [model] as functions of phi, for a foot of foot_radius [m] (None: of the robot's foot)."""

    laws: Mapping[str, PackingLaw]
    foot_radius: float | None = None
    source: str = ""

    def points(self, phi: ArrayLike, foot_radius: float) -> dict[str, NDArray[np.float64]]:
        """Values at phi (...) for the foot of the model, under the names of physics.points. ValueError out of range."""
        out = {}
        for name, law in self.laws.items():
            area = (foot_radius / self.foot_radius) ** 2 if self.foot_radius and name in BY_AREA else 1.0
            if math.isnan(area):
                raise ValueError("robot.foot_radius: missing; the forces of the laws are scaled with the foot's area")
            try:
                out[OF_MODEL + name] = area * law(phi)
            except ValueError as e:
                raise ValueError(f"law of {name}: {e}; change --phi, or give a wider law") from None
        return out

    def with_law(self, name: str, phi: ArrayLike, value: ArrayLike) -> Laws:
        """These laws with another one, given at phi (n,) for the foot of the laws."""
        law = PackingLaw(tuple(np.asarray(phi, float).tolist()), tuple(np.asarray(value, float).tolist()))
        return Laws({**self.laws, name: law}, self.foot_radius, self.source)

    def without(self, names: Iterable[str]) -> Laws:
        """These laws but those of the names."""
        return Laws({n: law for n, law in self.laws.items() if n not in set(names)}, self.foot_radius, self.source)

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        return {n: asdict(law) for n, law in self.laws.items()} | {"foot_radius": self.foot_radius}


def laws_from(table: Mapping[str, Any], where: str) -> tuple[Laws | None, list[str]]:
    """The laws of a table (foot_radius, source, and a law a parameter), or every problem, each beginning with where."""
    problems: list[str] = []
    entries = dict(table)
    radius, source = entries.pop("foot_radius", None), entries.pop("source", "")
    if radius is not None and not (_number(radius) and radius > 0):
        problems.append(f"{where}: foot_radius = {radius!r}: must be > 0 m, of the foot whose forces the laws give")
    if not isinstance(source, str):
        problems.append(f"{where}: source = {source!r}: must be text: where the laws come from")
    laws = {}
    for name, entry in entries.items():
        if name not in BED_PARAMETERS:
            problems.append(f"{where}: {name}: unknown parameter of the bed{closest(name, BED_PARAMETERS)}")
            continue
        found = _law(entry)
        if isinstance(found, str):
            problems.append(f"{where}: {name}: {found}")
            continue
        field = ModelParameters.__dataclass_fields__[name]
        for value in found.value:
            _, problem = check_value(value, type_of(ModelParameters, name)[0], field.metadata)
            if problem:
                problems.append(f"{where}: {name} = {value:g}: {problem}")
        laws[name] = found
    if not problems and not laws:
        problems.append(f"{where}: holds no law; give e.g. k1 = {{phi = [0.57, 0.605], value = [2100.0, 3500.0]}}")
    return (None, problems) if problems else (Laws(laws, None if radius is None else float(radius), source), [])


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _law(entry: Any) -> PackingLaw | str:
    """The law of one entry, or what is wrong with it."""
    if _number(entry):
        return PackingLaw((0.0, 1.0), (float(entry), float(entry)))
    says = "must be a number, or a table of two lists of numbers: phi, increasing in 0 to 1, and value, as long"
    if not isinstance(entry, dict) or set(entry) != {"phi", "value"}:
        return says
    phi, value = entry["phi"], entry["value"]
    if not (isinstance(phi, list) and isinstance(value, list) and len(phi) == len(value) > 1):
        return says
    if not all(map(_number, phi + value)) or any(b <= a for a, b in itertools.pairwise([0.0, *phi, 1.0])):
        return says
    return PackingLaw(tuple(map(float, phi)), tuple(map(float, value)))
