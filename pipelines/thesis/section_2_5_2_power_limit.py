"""Sections 1.2.2 and 2.5.2: the best stutter and squat (single) jump that the motor's power allows, and a catapult."""

import matplotlib.pyplot as plt
import numpy as np
from common import HARD, HOPPER, SINGLE, STUTTER, arguments, compare, first_crossing, save
from scipy.integrate import solve_ivp

import jumpvision as jv

args = arguments(__doc__)
A = 4e-3  # m, greatest amplitude
frequency = np.linspace(0.2, 3.0, 281 if args.small else 561) * HOPPER.f0
amplitude = A * np.geomspace(0.2 if args.small else 0.05, 1.0, 80 if args.small else 240)
jumps = jv.sweep("hard", robot=HARD, phase=[STUTTER, SINGLE], frequency=frequency, amplitude=amplitude)
height = jumps.com_height_m.where(jumps.lift_off_s.notnull())
power = np.geomspace(0.1, 12.0, 60 if args.small else 120)  # W
best = np.array([[h.where(p <= limit).max() for limit in power] for h, p in zip(height, jumps.peak_power_W)])
full = height.stack(law=("frequency", "amplitude"))
needed = jumps.peak_power_W.stack(law=("frequency", "amplitude")).isel(law=full.argmax("law")).values
stutter_wins = np.exp(first_crossing(np.log(power), np.nan_to_num(best[0] - best[1], nan=-1.0)))

# the motor presses the spring by its whole travel at any power, a catch holds it and lets go
travel, sag = 2.0 * A, HOPPER.mass * HOPPER.gravity / HOPPER.stiffness


def relaxed(t, s):
    return s[0] - sag


relaxed.terminal = True
push = solve_ivp(
    lambda t, s: (s[1], -(HOPPER.stiffness * s[0] + HOPPER.damping * s[1]) / HOPPER.mass),
    (0.0, 1.0),
    (-travel, 0.0),
    events=relaxed,
    rtol=1e-9,
    atol=1e-12,
)
catapult = sag + push.y[1, -1] ** 2 / (2.0 * HOPPER.gravity)

rows = compare(
    {
        "power of the best stutter jump, W": (needed[0], None),
        "power of the best single jump, W": (needed[1], None),
        "stutter the higher one from a limit of, W": (stutter_wins, "preferable where power is limited"),
        "best stutter, single jump, mm": (1e3 * full.max("law").values, None),
        "catapult of the same travel, mm": (1e3 * catapult, "above the squat jump"),
        "force of its catch, N": (HOPPER.stiffness * (travel + sag), None),
    }
)
figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
axis.semilogx(power, 1e3 * best.T, label=["stutter", "single (squat)"])
axis.axhline(1e3 * catapult, color="k", ls=":", label="catapult")
axis.set(xlabel="limit of the motor's power [W]", ylabel="best height [mm]")
axis.legend()
save(figure, rows, args.out)
