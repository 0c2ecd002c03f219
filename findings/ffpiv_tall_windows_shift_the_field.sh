#!/usr/bin/env bash
# Guess: ffpiv's `window_size` is (rows, columns), as its docs say, so windows of 64 x 32 suit a flow that is fast upwards.
# Seen (ffpiv 0.2.1 of May 2026, all three engines alike): the field is displaced by a constant: grains that move by
# (2.30, -1.40) px come out as (2.0, -17.0), those that do not move vertically with v = -16: half the difference of the window's
# sides is added, and the sub-pixel part lost, with as many vectors as asked and no NaN. The two sides change places where
# the correlation's middle is sought. Square windows are right (2.20, -1.31), wide ones give NaN or an error, so only tall
# ones mislead: a uniform, smooth field that every comparison with the neighbouring vectors passes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ffpiv==0.2.1 numpy
cat > "$folder/tall.py" <<'PY'
import ffpiv
import numpy as np

ROWS, COLUMNS, GRAINS = 192, 256, 5000
rng = np.random.default_rng(0)
at = rng.uniform(-20, 20, (GRAINS, 2)) + rng.uniform(0, 1, (GRAINS, 2)) * [COLUMNS, ROWS]
light = rng.uniform(60, 200, GRAINS)


def film(dx: float, dy: float) -> np.ndarray:
    """Gaussian grains of 1.2 px, displaced by (dx right, dy down) px."""
    image, near = np.zeros((ROWS, COLUMNS)), np.arange(-6, 7)
    for (x, y), a in zip(at + [dx, dy], light):
        c, r = int(round(x)) + near, int(round(y)) + near
        c, r = c[(c >= 0) & (c < COLUMNS)], r[(r >= 0) & (r < ROWS)]
        image[np.ix_(r, c)] += a * np.exp(-((c - x) ** 2 + (r[:, None] - y) ** 2) / (2 * 1.2**2))
    return image


first, seen = film(0, 0), {}
for true in ((2.3, -1.4), (4.6, 0.0), (0.0, 3.5)):
    second = film(*true)
    for window in ((32, 32), (48, 32), (64, 32)):
        for engine in ("numpy", "fftw"):
            u, v = ffpiv.piv(first, second, window_size=window, overlap=(window[0] // 2, window[1] // 2), engine=engine)
            seen[true, window] = np.median(u), np.median(v)
            assert not np.isnan(u).any()
        print(f"true {true}, window {window}: median u {np.median(u):.2f}, v {np.median(v):.2f} of {u.size} vectors")
    assert np.hypot(*np.subtract(seen[true, (32, 32)], true)) < 0.15
    for rows in (48, 64):
        off = seen[true, (rows, 32)][1] - true[1]
        assert abs(off + (rows - 32) / 2) < 3.0, "v is off by about half the difference of the window's sides"
PY
NUMBA_DISABLE_JIT=1 "$folder/venv/bin/python" "$folder/tall.py"  # its import compiles for minutes, but no engine used here needs it
