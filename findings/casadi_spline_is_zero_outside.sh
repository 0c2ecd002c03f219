#!/usr/bin/env bash
# Guess: outside its grid `casadi.interpolant("bspline", ...)` goes on as its "linear" does (along the last piece), or
# holds the last value: a torque of a motor's map changes little a hair beyond the fastest speed that was measured.
# Seen (casadi 3.8.2): it is 0 with slope 0 beyond the grid, in silence, 1e-9 past the last point as much as far away;
# "linear" extrapolates. A torque of 5.3 N m falls to 0 at once and its gradient says that nothing changes there, so
# neither an integrator nor an optimiser feels the map's end. A mass on a spring whose measured force ends at 1 m is let
# go there: pushed off at 3 m/s it has reached 3.7 m after half a period, where 1.5 m and the way back were due.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q casadi==3.8.2 numpy
cat > "$folder/outside.py" <<'PY'
import casadi
import numpy as np

speed = np.linspace(0.0, 10.0, 11)  # rad/s
torque = 12.0 - 0.67 * speed  # N m, a straight line: both are exact inside
at = casadi.MX.sym("at")
value = {}
for kind in ("linear", "bspline"):
    law = casadi.interpolant("torque", kind, [speed], torque)
    slope = casadi.Function("slope", [at], [casadi.jacobian(law(at), at)])
    for w in (9.5, 10.0 + 1e-9, 10.5, -0.5):
        value[kind, w] = float(law(w)), float(slope(w))
        print(f"{kind:8s} at {w:5.1f} rad/s: torque {value[kind, w][0]:6.3f} N m (line {12.0 - 0.67 * w:6.3f}), slope {value[kind, w][1]:6.3f}")
    # a mass of 1 kg on a spring of 4 N/m, pushed off at 3 m/s: it turns round at 1.5 m, the map ends at 1 m
    force = casadi.interpolant("force", kind, [np.linspace(-1.0, 1.0, 21)], -4.0 * np.linspace(-1.0, 1.0, 21))
    x = casadi.MX.sym("x", 2)
    swing = casadi.integrator("swing", "cvodes", {"x": x, "ode": casadi.vertcat(x[1], force(x[0]))}, 0.0, np.linspace(0.0, np.pi / 2, 101))
    value[kind, "reach"] = float(casadi.mmax(swing(x0=[0.0, 3.0])["xf"][0, :]))
    print(f"{kind:8s} mass pushed off at 3 m/s reaches {value[kind, 'reach']:.3f} m in half a period (1.5 is right)")
for w in (10.0 + 1e-9, 10.5, -0.5):
    assert abs(value["linear", w][0] - (12.0 - 0.67 * w)) < 1e-9 and abs(value["linear", w][1] + 0.67) < 1e-9
    assert value["bspline", w] == (0.0, 0.0)
assert abs(value["bspline", 9.5][0] - (12.0 - 0.67 * 9.5)) < 1e-9
assert abs(value["linear", "reach"] - 1.5) < 1e-3 and value["bspline", "reach"] > 3.0
PY
"$folder/venv/bin/python" "$folder/outside.py"
