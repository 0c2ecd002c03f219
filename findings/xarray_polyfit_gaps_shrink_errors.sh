#!/usr/bin/env bash
# Guess: `DataArray.polyfit(cov=True)` over a track with gaps (NaN) gives the covariance of the fit to what is there, as
# numpy.polyfit of the valid samples does: the coefficients are the same, after all.
# Seen (xarray 2026.9.0, numpy 2.4.6): the coefficients are, the covariance is not. It counts every gap as a measured
# point, in the degrees of freedom and in the normal matrix: with 60 % of the frames lost, an acceleration's standard
# error is .39 of the right one and covers the truth in 27 % of draws, numpy's in 66 %. `cov="unscaled"` is too small too, by
# the second half. Nothing warns; dropping the NaN along the dimension first gives numpy's.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q xarray==2026.9.0 numpy==2.4.6
cat > "$folder/gaps.py" <<'PY'
import numpy as np
import xarray as xr

N, LOST, NOISE, ACCELERATION, DRAWS = 200, 0.6, 1e-3, -9.81, 400  # frames; share; m; m/s^2
rng = np.random.default_rng(0)
t = np.linspace(0.0, 0.2, N)
said, right, within = [], [], []
for _ in range(DRAWS):
    z = 0.3 * t + ACCELERATION / 2 * t**2 + rng.normal(0.0, NOISE, N)
    z[rng.random(N) < LOST] = np.nan
    there = np.isfinite(z)
    track = xr.DataArray(z, dims="t", coords={"t": t})
    fit = track.polyfit("t", 2, cov=True)
    p, cov = np.polyfit(t[there], z[there], 2, cov=True)
    assert np.allclose(fit.polyfit_coefficients, p)
    dropped = track.dropna("t").polyfit("t", 2, cov=True)
    assert np.allclose(dropped.polyfit_covariance, cov)
    said.append(2 * float(fit.polyfit_covariance[0, 0]) ** 0.5)
    right.append(2 * cov[0, 0] ** 0.5)
    within.append([abs(2 * p[0] - ACCELERATION) < s for s in (said[-1], right[-1])])
ratio, (covered, due) = np.mean(said) / np.mean(right), np.mean(within, axis=0)
print(f"standard error of the acceleration: xarray {np.mean(said):.3f}, numpy {np.mean(right):.3f} m/s^2, ratio {ratio:.2f}")
print(f"true value within one standard error: xarray {covered:.2f}, numpy {due:.2f} of {DRAWS} draws (.68 is right)")
assert 0.35 < ratio < 0.45 and covered < 0.4 and due > 0.6
PY
"$folder/venv/bin/python" "$folder/gaps.py"
