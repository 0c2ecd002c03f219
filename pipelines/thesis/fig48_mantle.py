"""Fig 48(b): the second resistance k_2 against packing, beside that predicted from k_1 and stresses on a cone's mantle.

Resistive force theory gives the stress per depth on a plate that goes straight down, level (k_1) or as steep as the
mantle of the grown cone (k_2): by Li, Zhang & Goldman, Science 339, 1408 (2013), and Agarwal, Goldman & Kamrin, PNAS
120, e2214017120 (2023).
"""

import matplotlib.pyplot as plt
import numpy as np
from common import LAWS, SAND, SINGLE, arguments, compare, save

import jumpvision as jv
from jumpvision.sweeps.axes import read_laws

# f1, f2, f3 of Agarwal et al.: powers of g.v, g.n, n.v in each of 20 monomials, and their coefficients
MONOMIALS = "000 100 010 001 200 020 002 110 011 101 300 030 003 120 210 012 021 201 102 111"
COEFFICIENTS = """
    0.00212 -0.02320 -0.20890 -0.43083 -0.00259 0.48872 -0.00415 0.07204 -0.02750 -0.08772
    0.01992 -0.45961 0.40799 -0.10107 -0.06576 0.05664 -0.09269 0.01892 0.01033 0.15120
    -0.06796 -0.10941 0.04725 -0.06914 -0.05835 -0.65880 -0.11985 -0.25739 -0.26834 0.02692
    -0.00736 0.63758 0.08997 0.21069 0.04748 0.20406 0.18589 0.04934 0.13527 -0.33207
    -0.02634 -0.03436 0.45256 0.00835 0.02553 -1.31290 -0.05532 0.06790 -0.16404 0.02287
    0.02927 0.95406 -0.00131 -0.11028 0.01487 -0.02730 0.10911 -0.04097 0.07881 -0.27519
"""
POWERS = np.array([[int(power) for power in word] for word in MONOMIALS.split()])
GENERIC = np.array(COEFFICIENTS.split(), dtype=float).reshape(3, 20)
DOWN = np.array([0.0, 0.0, -1.0])
args = arguments(__doc__)


def by_li(theta):
    """Vertical stress per depth on a plate at theta [rad] to the horizontal that goes straight down."""
    attack = 0.5 * np.pi
    both, apart = 2.0 * theta + attack, -2.0 * theta + attack
    return 0.206 + 0.169 * np.cos(2.0 * theta) + 0.212 * np.sin(both) + 0.358 * np.sin(attack) + 0.055 * np.sin(apart)


def by_agarwal(theta, friction):
    """The same in three dimensions, its tangential part at most friction times the normal one."""
    n = np.array([np.sin(theta), 0.0, -np.cos(theta)])
    f1, f2, f3 = GENERIC @ np.prod(np.array([1.0, n @ DOWN, n @ DOWN]) ** POWERS, axis=1)
    stress = f1 * n + f2 * DOWN + f3 * DOWN
    pressure = max(-(stress @ n), 0.0)
    slide = stress - (stress @ n) * n
    size = np.linalg.norm(slide)
    return float((slide * min(1.0, friction * pressure / max(size, 1e-12)) - pressure * n)[2])


mantle = np.radians([55.0, 60.0, 65.0])  # of the cone; the dissertation: about 60 degrees
shares = {  # k_2 / k_1: the mantle's area is that of the foot over the cosine
    "Li et al.": np.array([by_li(x) / np.cos(x) / by_li(0.0) for x in mantle]),
    "Agarwal et al.": np.array(
        [by_agarwal(x, mu) / np.cos(x) / by_agarwal(0.0, mu) for mu in (0.2, 0.4, 0.6) for x in mantle]
    ),
}
mean = np.mean([x.mean() for x in shares.values()])
least, most = min(x.min() for x in shares.values()), max(x.max() for x in shares.values())
phi = np.linspace(0.57, 0.63, 5 if args.small else 13)
laws = read_laws(LAWS).laws
k1, k2 = laws["k1"](phi), laws["k2"](phi)


def single(x, k):
    """Height [mm] of the single jump at 8 Hz at a packing, with a second resistance k."""
    law = {"frequency": 8.0, "phase": SINGLE, "amplitude": 0.01875, "phi": x}
    return 1e3 * float(jv.sweep("granular", robot=SAND, laws=LAWS, model={"k2": k}, **law).jump_height_m)


rows = compare(
    {
        **{f"k_2 / k_1 by {n}: mean, least, greatest": ([x.mean(), x.min(), x.max()], None) for n, x in shares.items()},
        "k_2 over the predicted one, loose and dense sand": ((k2 / (mean * k1))[[0, -1]], "1 and 1"),
        "single at 8 Hz on loose sand: own k_2, least, greatest, mm": (
            [single(phi[0], k) for k in (k2[0], least * k1[0], most * k1[0])],
            None,
        ),
    }
)
area = np.pi * SAND["foot_radius"] ** 2 * 1e6  # of the foot, for N/cm^3
figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
axis.plot(phi, k1 / area, label="$k_1$")
axis.plot(phi, k2 / area, label="$k_2$")
axis.plot(phi, mean * k1 / area, "k--", label="$k_2$ predicted")
axis.fill_between(phi, least * k1 / area, most * k1 / area, color="k", alpha=0.15)
axis.set(xlabel="volume fraction", ylabel="resistance / area of the foot [N/cm³]")
axis.legend()
save(figure, rows, args.out)
