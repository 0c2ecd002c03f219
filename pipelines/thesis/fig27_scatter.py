"""Text of Fig 27: how much a jump's height scatters between trials that start from a faintly ringing spring."""

import matplotlib.pyplot as plt
import numpy as np
from common import HOPPER, arguments, compare, save

from jumpvision.jumper.physics.hard.jump import hard_sweep, sine_rows

RINGING = 1e-5  # m rms of the rod, a third of what the tracking of the dissertation could see
TRIALS = 24
args = arguments(__doc__)
f0, n = HOPPER.f0, 17 if args.small else 97
frequency, phase = np.linspace(0.2, 1.4, n) * f0, np.linspace(0.0, 2.0 * np.pi, n)
rng = np.random.default_rng(20140630)

# a cycle at f_0 leaves the rod ringing with pi m_m/M of its amplitude; a pause, then the law
shape = (n, n, TRIALS)
ringing = RINGING * np.hypot(rng.standard_normal(shape), rng.standard_normal(shape))
a = ringing * HOPPER.mass / (np.pi * HOPPER.motor_mass)
pause = (0.5 + rng.uniform(size=shape)) / f0
rows_of_law = np.zeros((*shape, 3, 6))  # begin, end, base, amplitude, angular frequency, phase
for column, value in enumerate((0.0, 1.0 / f0, -a, a, 2.0 * np.pi * f0, 0.5 * np.pi)):
    rows_of_law[..., 0, column] = value
rows_of_law[..., 1, 0], rows_of_law[..., 1, 1] = 1.0 / f0, 1.0 / f0 + pause
law = sine_rows(frequency[:, None], 4e-3, phase, 1.0)
rows_of_law[..., 2, :] = law[..., None, 0, :]
rows_of_law[..., 2, :2] += (1.0 / f0 + pause)[..., None]

height = hard_sweep(law, **HOPPER._asdict())["flight_height_m"]
spread = hard_sweep(rows_of_law, **HOPPER._asdict())["flight_height_m"].std(axis=2, ddof=1)
fast, jumps = frequency > 4.0, height > 1e-3


def share(where):
    """Median scatter of the jumps in percent of their heights."""
    return 100.0 * np.median((spread / np.where(jumps, height, np.nan))[where[:, None] & jumps])


rows = compare(
    {
        "scatter of the flight height above 4 Hz, median, mm": (1e3 * np.median(spread[fast]), "below 0.5"),
        "the same in % of the height": (share(fast), "about 1"),
        "scatter below 4 Hz, median, % of the height": (share(~fast), "larger at some phases"),
    }
)
figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
for axis, values, title in zip(
    axes, (1e3 * height, np.log10(1e3 * np.maximum(spread, 1e-9))), ("height [mm]", "log$_{10}$ scatter [mm]")
):
    figure.colorbar(axis.pcolormesh(phase / np.pi, frequency / f0, values), ax=axis)
    axis.set(title=title, xlabel="start phase [π]")
axes[0].set_ylabel("frequency / $f_0$")
save(figure, rows, args.out)
