"""Pictures of grains and particles whose displacement is known.

Grains are drawn analytically in each frame (never warped): every sample point of a supersampled pixel is carried back
to the material at mid-time and the grain there is asked for its grey.
"""

import numpy as np

SETTINGS = {"window": 24, "step": 8, "passes": (64, 32), "min_correlation": 0.3, "min_texture": 2.0, "outlier": 2.0}
SHAPE = (168, 232)  # rows, columns
FIELDS = {
    "uniform": lambda x, y: (3.37 + 0 * x, -2.21 + 0 * x),
    "shear": lambda x, y: (0.06 * (y - 80), 0 * y),
    "rotation": lambda x, y: (-0.04 * (y - 80), 0.04 * (x - 115)),
    "vortex": lambda x, y: (2 * np.sin(y / 30) * np.cos(x / 30), -2 * np.cos(y / 30) * np.sin(x / 30)),
    "band": lambda x, y: (4 * np.tanh((y - 0.4 * x - 40) / 12), 1 + 0 * x),
}


def grains(shape, displacement, rng, radius=(2.5, 6.5), sub=4):
    """Two frames [grey] of textured discs; the material at (x, y) at mid-time moves by displacement(x, y)."""
    h, w = shape
    n = int(1.6 * (h + 30) * (w + 30) / (np.pi * np.mean(np.square(radius))))
    bed = np.stack(
        [
            rng.uniform(-15, w + 15, n),
            rng.uniform(-15, h + 15, n),
            rng.uniform(*radius, n),
            rng.uniform(60, 200, n),
            rng.uniform(10, 40, n),
            rng.uniform(0.3, 1.0, n),
            rng.uniform(0, 2 * np.pi, n),
            rng.uniform(0, 2 * np.pi, n),
        ],
        axis=1,
    )
    return [_frame(shape, bed, displacement, side, sub) for side in (-1, 1)]


def _frame(shape, bed, displacement, side, sub):
    q = (np.arange(sub) + 0.5) / sub - 0.5
    rows, columns = (np.add.outer(np.arange(n), q).ravel() for n in shape)
    y, x = np.meshgrid(rows, columns, indexing="ij")
    mx, my = x, y
    for _ in range(30):  # the material point that is at (x, y) in this frame; a contraction for gradients below 2
        u, v = displacement(mx, my)
        bx, by, mx, my = mx, my, x - side * u / 2, y - side * v / 2
        if max(np.abs(mx - bx).max(), np.abs(my - by).max()) < 1e-12:
            break
    image = np.full(x.shape, 35.0)
    for gx, gy, r, grey, amplitude, k, angle, phase in bed:
        u, v = displacement(np.float64(gx), np.float64(gy))
        cx, cy, reach = (gx + side * u / 2 + 0.5) * sub, (gy + side * v / 2 + 0.5) * sub, (1.3 * r + 3) * sub
        box = (
            slice(max(0, int(cy - reach)), max(0, int(cy + reach))),
            slice(max(0, int(cx - reach)), max(0, int(cx + reach))),
        )
        dx, dy = mx[box] - gx, my[box] - gy
        rho = np.hypot(dx, dy)
        wave = amplitude * np.cos(k * (np.cos(angle) * dx + np.sin(angle) * dy) + phase)
        cover = 1 / (1 + np.exp((rho - r) / 0.3))
        image[box] += cover * (grey * (1 - 0.35 * (rho / r) ** 2) + wave - image[box])
    return image.reshape(shape[0], sub, shape[1], sub).mean((1, 3))


def camera(image, noise, rng):
    return np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def spots(shape, x, y, amplitude, diameter):
    """Gaussian particles [grey] of e^-2 diameter [px] at (x, y), sampled at the pixel centres."""
    s2 = (diameter / 4) ** 2
    gx = np.exp(-((np.arange(shape[1]) - x[:, None]) ** 2) / (2 * s2))
    gy = np.exp(-((np.arange(shape[0]) - y[:, None]) ** 2) / (2 * s2))
    return np.einsum("p,py,px->yx", amplitude, gy, gx, optimize=True)
