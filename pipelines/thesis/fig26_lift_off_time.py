"""Fig 26: forcing cycles until the first lift-off, and the frequency that is easiest when one waits for N cycles.

Until it lifts off the robot is a linear system. A motor that a feedback loop holds gives way to what it pushes.
"""

import matplotlib.pyplot as plt
import numpy as np
from common import HARD, HOPPER, SINGLE, STUTTER, arguments, compare, peak, save
from scipy.linalg import expm

import jumpvision as jv

STEPS = 100  # of a forcing cycle
args = arguments(__doc__)
f0, M, k, m_m, m_r = HOPPER.f0, HOPPER.mass, HOPPER.stiffness, HOPPER.motor_mass, HOPPER.rod_mass
ratio = np.arange(0.9, 1.3, 0.002 if args.small else 0.0005)  # frequency / f_0
w = 2.0 * np.pi * f0 * ratio
cut_offs = np.array([2, 3, 5, 10, 20, 50, 100])  # N, cycles


def easiest(phase, c=HOPPER.damping, kp=None, kd=120.0):
    """f_N / f_0 of each N: where the rod rises most within N cycles of a law of amplitude 1; kp, kd: of the loop."""
    # x and v of the rod, X and V of the motor on it, sine and cosine of the law, 1
    a = np.zeros((w.size, 7, 7))
    a[:, 0, 1] = a[:, 2, 3] = 1.0
    a[:, 4, 5], a[:, 5, 4] = w, -w
    if kp is None:
        a[:, 1, :2], a[:, 1, 4] = [-k / M, -c / M], m_m / M * w**2
    else:
        force = np.zeros((w.size, 7))  # kp (X_c - X) + kd (V_c - V)
        force[:, 2], force[:, 3], force[:, 4], force[:, 5], force[:, 6] = -kp, -kd, kp, kd * w, -kp * np.sin(phase)
        a[:, 1] = -force / m_r
        a[:, 1, :2] -= np.array([k, c]) / m_r
        a[:, 3] = force / m_m - a[:, 1]
    step = expm(a * (2.0 * np.pi / STEPS / w)[:, None, None])
    state = np.tile([0.0, 0.0, 0.0, 0.0, np.sin(phase), np.cos(phase), 1.0], (w.size, 1))[..., None]
    top, found = np.zeros(w.size), []
    for i in range(1, cut_offs[-1] * STEPS + 1):
        state = step @ state
        x, v, acceleration = state[:, 0, 0], state[:, 1, 0], (a[:, 1:2] @ state)[:, 0, 0]
        passed = (acceleration < 0.0) & (v <= 0.0) & (v / acceleration < 2.0 * np.pi / STEPS / w)  # in this step
        top = np.maximum(top, np.where(passed, x - v**2 / (2.0 * acceleration), x))
        if i % STEPS == 0 and i // STEPS in cut_offs:
            found.append(peak(ratio, top)[0])
    return np.array(found)


by_law = np.array([easiest(p) for p in (STUTTER, SINGLE)])
stiffness = np.array([5e4, 1e5, 2e5])  # N/m, kp
by_loop = np.array([easiest(STUTTER, kp=kp) for kp in stiffness])
zeta = np.array([0.0083, 0.03, 0.06, 0.1, 0.15])
damped = np.array([easiest(STUTTER, c=2.0 * z * np.sqrt(k * M))[-1] for z in zeta])
n = 30 if args.small else 120
jumps = jv.sweep(
    "hard",
    robot=HARD,
    phase=STUTTER,
    cycles=20 if args.small else 100,
    frequency=np.linspace(0.3, 1.5, n) * f0,
    amplitude=np.geomspace(1e-5, 6e-3, n),
)
cycles = jumps.lift_off_s * jumps.frequency

rows = compare(
    {
        "f_2/f_0 at phases pi/2, 3 pi/2": (by_law[:, 0], "1 down to about N = 2"),
        "f_5/f_0 at phases pi/2, 3 pi/2": (by_law[:, 2], 1),
        "f_100/f_0 at phases pi/2, 3 pi/2": (by_law[:, -1], "1 simulated, below 1 measured"),
        "f_100/f_0 with a loop of 5e4, 1e5, 2e5 N/m": (by_loop[:, -1], "below 1 measured"),
        "least f_100/f_0 over damping ratios 0.0083 to 0.15": (damped.min(), "damping suspected to lower it"),
    }
)
figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
drawn = axes[0].pcolormesh(1e3 * jumps.amplitude, jumps.frequency / f0, np.log10(cycles))
figure.colorbar(drawn, ax=axes[0], label="log$_{10}$ cycles to lift-off")
axes[0].set(xscale="log", xlabel="amplitude [mm]", ylabel="frequency / $f_0$")
axes[1].semilogx(cut_offs, by_law.T, label=["phase π/2", "phase 3π/2"])
axes[1].semilogx(cut_offs, by_loop.T, "--", label=[f"loop, {x:.0e} N/m" for x in stiffness])
axes[1].set(xlabel="cycles waited for, N", ylabel="easiest frequency $f_N$ / $f_0$")
axes[1].legend()
axes[2].plot(zeta, damped, "o", label="$f_{100}$ / $f_0$")
axes[2].plot(zeta, 1.0 / np.sqrt(1.0 - 2.0 * zeta**2), label="1 / √(1 − 2ζ²)")
axes[2].set(xlabel="damping ratio ζ")
axes[2].legend()
save(figure, rows, args.out)
