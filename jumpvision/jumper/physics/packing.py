"""Parameters of the bed as laws of its volume fraction phi: piecewise linear with a kink, or from a table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import TypeGuard

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.schema import Toml, check_value, closest, type_of
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.mechanisms.registry import ModelParameters, acting

from .batch import BY_AREA, OF_MODEL

GRID = 301  # trial places of the kink
DRAWS = 2000  # of noise, for the distribution of the test without a kink


@dataclass(frozen=True)
class PackingLaw:
    """A parameter given at increasing volume fractions, linear between them.

    Its outer lines go on beyond its ends by what a volume fraction is uncertain by; it is unknown further out.
    """

    phi: tuple[float, ...]
    value: tuple[float, ...]

    def __call__(self, phi: ArrayLike, sigma: float = 0.0) -> Array:
        """The parameter at phi (...), of standard uncertainty sigma. ValueError out of the reach of the law."""
        # half of the last of three decimals, to which volume fractions are told, or three sigmas
        x, reach = np.asarray(phi, float), max(5e-4, 3.0 * sigma)
        off = np.where(np.isfinite(x), self.beyond(x), math.inf)
        if (off > reach).any():
            ends = f"{self.phi[0]:g} to {self.phi[-1]:g}"
            raise ValueError(f"phi = {x[off > reach].flat[0]:g} is outside {ends}, where the law is known")
        slope = np.diff(self.value) / np.diff(self.phi)
        below, above = np.minimum(x - self.phi[0], 0.0), np.maximum(x - self.phi[-1], 0.0)
        return np.interp(x, self.phi, self.value) + slope[0] * below + slope[-1] * above

    def beyond(self, phi: ArrayLike) -> Array:
        """How far phi (...) is outside the law's range."""
        x = np.asarray(phi, float)
        return np.maximum(np.maximum(self.phi[0] - x, x - self.phi[-1]), 0.0)


@dataclass(frozen=True)
class PackingFit:
    """value = value_c + slope (phi - phi_c), with one slope below phi_c and one above.

    covariance: (4, 4) of phi_c, value_c, slope_below, slope_above, multiplied by max(1, chi2/(n - 4)) as is the
    interval. interval: 95 % confidence of phi_c, the profile of chi2; an end of the searched range means: not bounded
    there. p_straight: probability of so much better a fit than a straight line where there is no kink.
    """

    phi_c: float
    value_c: float
    slope_below: float
    slope_above: float
    covariance: Array
    interval: tuple[float, float]
    p_straight: float
    chi2: float
    n: int
    range: tuple[float, float]  # of the volume fractions fitted
    line: PackingLaw  # the straight line through the same data

    @property
    def law(self) -> PackingLaw:
        """The fit as a law over the range of its data."""
        x = (self.range[0], self.phi_c, self.range[1])
        return PackingLaw(x, tuple(float(v) for v in self.at(x)[0]))

    def at(self, phi: ArrayLike) -> tuple[Array, Array]:
        """(value, standard uncertainty) at phi (...)."""
        d = np.asarray(phi, float) - self.phi_c
        value = self.value_c + self.slope_below * np.minimum(d, 0.0) + self.slope_above * np.maximum(d, 0.0)
        j = _jacobian(d, self.slope_below, self.slope_above)
        return value, np.sqrt(np.einsum("...i,ij,...j->...", j, self.covariance, j))


def fit_packing_law(
    phi: ArrayLike, value: ArrayLike, sigma: ArrayLike, *, rng: np.random.Generator | None = None
) -> PackingFit:
    """The kinked line with the least sum ((value - law)/sigma)^2, over every place of the kink.

    phi, value, sigma: (n,), sigma > 0 the standard uncertainty of value; points with a NaN are left out. The kink is
    looked for between the second and the last but one volume fraction. p_straight is of the ratio of the drop in chi2
    to chi2/(n - 4), whose distribution without a kink is drawn (`rng`; the place of the kink has no meaning then, so no
    table holds: Davies, Biometrika 74, 1987); it does not depend on the scale of sigma.
    ValueError for shapes that differ, a sigma that is not positive or fewer than five different phi.
    """
    x, y, s = (np.asarray(v, float) for v in (phi, value, sigma))
    if not (x.shape == y.shape == s.shape and x.ndim == 1):
        raise ValueError(f"fit_packing_law phi, value, sigma: shapes {x.shape}, {y.shape}, {s.shape} must be one (n,)")
    if (s <= 0.0).any():
        raise ValueError("fit_packing_law sigma: must be > 0; give the standard uncertainty of each value")
    use = np.isfinite(x) & np.isfinite(y) & np.isfinite(s)
    x, y, w = x[use], y[use], 1.0 / s[use]
    different = np.unique(x)
    if different.size < 5:
        raise ValueError(f"fit_packing_law phi: {different.size} different volume fractions; a kink needs five or more")
    trial = np.linspace(different[1], different[-2], GRID)
    noise = (np.random.default_rng(0) if rng is None else rng).standard_normal((x.size, DRAWS))
    straight, drop = _kinks(trial, x, w, np.column_stack([y * w, noise]))
    profile = straight[0] - drop[:, 0]
    ratio = drop.max(axis=0) / np.maximum(straight - drop.max(axis=0), 1e-12 * straight)
    i = int(np.argmin(profile))
    lo, hi = trial[max(i - 1, 0)], trial[min(i + 1, GRID - 1)]
    fine = scipy.optimize.minimize_scalar(
        lambda c: _linear(c, x, y, w)[1], bounds=(lo, hi), method="bounded", options={"xatol": 1e-9}
    )
    at = float(fine.x) if fine.fun < profile[i] else float(trial[i])
    (value_c, below, above), chi2 = _linear(at, x, y, w)
    scatter = max(1.0, chi2 / max(x.size - 4, 1))
    j = _jacobian(x - at, below, above) * w[:, None]
    inside = trial[profile <= chi2 + 3.841 * scatter]  # 95 % point of chi2 with one degree of freedom
    return PackingFit(
        phi_c=at,
        value_c=value_c,
        slope_below=below,
        slope_above=above,
        covariance=scatter * _inverse(j.T @ j),
        interval=(min(float(inside.min()), at), max(float(inside.max()), at)) if inside.size else (at, at),
        p_straight=float((1 + np.sum(ratio[1:] >= ratio[0])) / (1 + DRAWS)),
        chi2=chi2,
        n=x.size,
        range=(float(x.min()), float(x.max())),
        line=_straight(x, y, w),
    )


def _linear(c: float, x: Array, y: Array, w: Array) -> tuple[tuple[float, float, float], float]:
    """Value and slopes at a kink at c, and chi2."""
    design = np.column_stack([np.ones_like(x), np.minimum(x - c, 0.0), np.maximum(x - c, 0.0)]) * w[:, None]
    p = np.linalg.lstsq(design, y * w, rcond=None)[0]
    return (float(p[0]), float(p[1]), float(p[2])), float(np.sum((y * w - design @ p) ** 2))


def _straight(x: Array, y: Array, w: Array) -> PackingLaw:
    slope, level = np.polyfit(x - x.mean(), y, 1, w=w)
    ends = np.array([x.min(), x.max()])
    return PackingLaw(tuple(ends.tolist()), tuple((level + slope * (ends - x.mean())).tolist()))


def _jacobian(d: Array, below: float, above: float) -> Array:
    """Derivatives (..., 4) of the value by phi_c, value_c and the slopes at the distances d (...) from the kink."""
    slope = np.where(d < 0.0, below, np.where(d > 0.0, above, 0.5 * (below + above)))
    return np.stack([-slope, np.ones_like(d), np.minimum(d, 0.0), np.maximum(d, 0.0)], axis=-1)


def _inverse(normal: Array) -> Array:
    """The inverse of a normal matrix, NaN where it has none: two equal slopes leave the kink no place."""
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0.0).all() or np.linalg.cond(normal / np.outer(scale, scale)) > 1e12:
        return np.full(normal.shape, np.nan)
    return np.linalg.inv(normal / np.outer(scale, scale)) / np.outer(scale, scale)


def _kinks(trial: Array, x: Array, w: Array, data: Array) -> tuple[Array, Array]:
    """chi2 (k,) of straight lines through weighted data (n, k), and by how much a kink at each trial (m,) lowers it."""
    line, _ = np.linalg.qr(np.column_stack([w, x * w]))
    bends = np.maximum(x[:, None] - trial, 0.0) * w[:, None]
    bends -= line @ (line.T @ bends)  # what a kink adds to a line
    bends /= np.linalg.norm(bends, axis=0)
    rest = data - line @ (line.T @ data)
    return np.sum(rest**2, axis=0), (bends.T @ rest) ** 2


ON_FOOT = (Body.STATIC, Body.DRAG, Body.FOOT, Body.INERTIA, Body.OVERSHOOT)
BED_PARAMETERS = tuple(dict.fromkeys(n for m in acting(*ON_FOOT) for n in m.names))


@dataclass(frozen=True)
class Laws:
    """Parameters of [model] as functions of phi, for a foot of foot_radius [m] (None: of the robot's foot)."""

    laws: Mapping[str, PackingLaw]
    foot_radius: float | None = None
    source: str = ""

    def points(self, phi: ArrayLike, foot_radius: float, sigma: float = 0.0) -> dict[str, NDArray[np.float64]]:
        """Values at phi (...) for the foot of the model, under the names of physics.points. ValueError out of reach.

        sigma: standard uncertainty of phi.
        """
        out = {}
        for name, law in self.laws.items():
            area = (foot_radius / self.foot_radius) ** 2 if self.foot_radius and name in BY_AREA else 1.0
            if math.isnan(area):
                raise ValueError("robot.foot_radius: missing; the forces of the laws are scaled with the foot's area")
            try:
                out[OF_MODEL + name] = area * law(phi, sigma)
            except ValueError as e:
                raise ValueError(f"law of {name}: {e}; change --phi, or give a wider law") from None
        return out

    def continued(self, phi: ArrayLike) -> str:
        """What is to be said of laws used at phi (...) beyond their ends; "" where none is."""
        off = {name: float(np.max(law.beyond(phi))) for name, law in self.laws.items()}
        names = [n for n, x in off.items() if x > 0.0]
        if not names:
            return ""
        law, far = self.laws[names[0]], max(off.values())
        return (
            f"volume fraction up to {far:.2g} beyond {law.phi[0]:g} to {law.phi[-1]:g}, where the laws of "
            f"{', '.join(names)} are known: within its uncertainty their outer lines go on"
        )

    def with_law(self, name: str, phi: ArrayLike, value: ArrayLike) -> Laws:
        """These laws with another one, given at phi (n,) for the foot of the laws."""
        law = PackingLaw(tuple(np.asarray(phi, float).tolist()), tuple(np.asarray(value, float).tolist()))
        return Laws({**self.laws, name: law}, self.foot_radius, self.source)

    def without(self, names: Iterable[str]) -> Laws:
        """These laws but those of the names."""
        return Laws({n: law for n, law in self.laws.items() if n not in set(names)}, self.foot_radius, self.source)

    def plain(self) -> dict[str, object]:
        """For JSON."""
        return {n: asdict(law) for n, law in self.laws.items()} | {"foot_radius": self.foot_radius}


def laws_from(table: Toml, where: str) -> tuple[Laws | None, list[str]]:
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


def _number(value: object) -> TypeGuard[float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _law(entry: object) -> PackingLaw | str:
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
