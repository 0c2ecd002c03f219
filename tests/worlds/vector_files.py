"""Velocity fields of other programs, written in their documented layouts."""

import numpy as np
import xarray as xr
from scipy.io import savemat

from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.workflow.stage import results_stages
from jumpvision.experiment.workflow.workspace import Workspace

results_stages()  # registers them

RATE, SCALE, STEP = 500.0, 2e-4, 12  # 1/s, m/px, px
COLUMNS, ROWS = 30.0 + STEP * np.arange(41), 46.0 + STEP * np.arange(30)  # px, of the vectors; rows downwards
AXIS, FACE = 270.0, 34.0  # px: the foot's axis, and its face in the middle of the first pair
SPEED = 0.4 + 0.05 * np.arange(3)  # m/s, downwards, of the foot at the middle of the pairs
WIDE, DEEP, PLUG = 0.012, 0.010, 0.012  # m: v / foot = exp(-x^2/2 WIDE^2), times exp(-(d - PLUG)/DEEP) below PLUG
RHO, PHI = 1000.0, 0.57


def faces():
    """Height of the face [m] below its first place, at the middle of each pair."""
    return -np.concatenate([[0.0], np.cumsum(0.5 * (SPEED[1:] + SPEED[:-1]) / RATE)])


def flow_field(extra=True):
    """u, v [m/s], v up, shape (rows, columns, t): grains go down with the foot, a little u to tell axes apart."""
    x = (COLUMNS - AXIS) * SCALE
    d = ((ROWS - FACE) * SCALE)[:, None] + faces()[None, :]
    v = -SPEED * np.exp(-np.maximum(d - PLUG, 0.0) / DEEP)[:, None, :] * np.exp(-0.5 * (x / WIDE) ** 2)[None, :, None]
    u = 0.03 * (x[None, :, None] / 0.05) * np.ones_like(v)
    return u, v


BAD = (4, 7)  # the vector that the programs call bad, in every field


def openpiv(folder, turned):
    """openpiv.tools.save: tab, '%.4e', x y u v flags mask; turned: as after transform_coordinates."""
    u, v = flow_field()
    to_px = 1.0 / (SCALE * RATE)
    x, y = np.meshgrid(COLUMNS, ROWS)
    flags, mask = np.zeros(x.shape), np.zeros(x.shape)
    flags[BAD] = 1
    for k in range(v.shape[2]):
        down = -v[..., k] * to_px
        if turned:
            cols = (x, y[::-1], u[..., k] * to_px, -down, flags, mask)
        else:
            cols = (x, y, u[..., k] * to_px, down, flags, mask)
        name = folder / f"field_{k + 9}.txt"  # 9, 10, 11: not in alphabetical order
        table = np.stack([c.ravel() for c in cols], axis=1)
        np.savetxt(name, table, fmt="%.6e", delimiter="\t", header="x\ty\tu\tv\tflags\tmask")
    return "field_*.txt"


def pivlab_text(folder):
    """PIVlab's ASCII chart: three header lines, columns of the grid one after another, NaN where masked."""
    u, v = flow_field()
    x, y = np.meshgrid(COLUMNS, ROWS)
    (folder / "vectors").mkdir()
    for k in range(v.shape[2]):
        a, b = u[..., k] / (SCALE * RATE), -v[..., k] / (SCALE * RATE)
        a[BAD], b[BAD] = np.nan, np.nan
        lines = [
            "PIVlab by W.Th. & E.J.S., ASCII chart output - 01-Jan-2026",
            f"FRAME: {k + 1}, filenames: A: a.png & B: b.png, conversion factor xy (px -> m): 1, conversion factor uv "
            "(px/frame -> m/s): 1",
            "x [px],y [px],u [px/frame],v [px/frame]",
        ]
        rows = np.stack([f.T.ravel() for f in (x, y, a, b)], axis=1)
        lines += [",".join(f"{n:.9g}" for n in row) for row in rows]
        (folder / "vectors" / f"PIVlab_{k + 1:04d}.txt").write_bytes("\r\n".join(lines).encode() + b"\r\n")
    return "vectors"


def pivlab_mat(folder, metres, upwards):
    """PIVlab's MAT export: cells of grids; calibrated numbers carry calxy, calu and the sign of calv."""
    u, v = flow_field()
    x, y = np.meshgrid(COLUMNS, ROWS)
    n = v.shape[2]

    def cells(f):
        out = np.empty((n, 1), object)
        for k in range(n):
            out[k, 0] = f(k)
        return out

    length, speed = (SCALE, 1.0) if metres else (1.0, 1.0 / (SCALE * RATE))
    sign = 1.0 if upwards else -1.0
    kinds = np.ones(x.shape)
    kinds[BAD] = 2  # replaced
    top = ROWS[0] + ROWS[-1]
    data = {
        "x": cells(lambda k: x * length), "y": cells(lambda k: (top - y if upwards else y) * length),
        "u_original": cells(lambda k: u[..., k] * speed), "v_original": cells(lambda k: sign * v[..., k] * speed),
        "typevector_original": cells(lambda k: kinds), "u_filtered": cells(lambda k: u[..., k] * speed),
        "v_filtered": cells(lambda k: sign * v[..., k] * speed), "typevector_filtered": cells(lambda k: kinds),
        "u_smoothed": cells(lambda k: np.zeros((0, 0))), "calxy": length, "calu": speed, "calv": -sign * speed,
        "units": "[m] respectively [m/s]" if metres else "[px] respectively [px/frame]",
    }  # fmt: skip
    savemat(folder / "PIVlab.mat", data)
    return "PIVlab.mat"


def pivpy(folder, unit, dims):
    """pivpy schema 1: u, v, chc over (y, x, t) with 1-D coordinates, here in mm and mm/s or in pix and pix a frame."""
    u, v = flow_field()
    length, speed, names = (
        (SCALE * 1e3, 1e3, ("mm", "mm/s")) if unit == "mm" else (1.0, 1 / SCALE / RATE, ("pix", "pix"))
    )
    chc = np.ones(v.shape)
    chc[BAD] = 0
    at = ("y", "x", "t")
    data = xr.Dataset(
        {"u": (at, u * speed, {"units": names[1]}), "v": (at, v * speed, {"units": names[1]}), "chc": (at, chc)},
        coords={
            "x": ("x", COLUMNS * length, {"units": names[0]}), "y": ("y", (ROWS[0] + ROWS[-1] - ROWS) * length,
            {"units": names[0]}), "t": ("t", np.arange(3.0), {"units": "frame"}),
        },
        attrs={"delta_t": 0.0, "files": ["a.vc7"], "pivpy_schema_version": "1"},
    )  # fmt: skip
    data.transpose(*dims).to_netcdf(folder / "field.nc")
    return "field.nc"


TURNED = ROWS[0] + ROWS[-1]  # y up where a program turns the picture over: row + y
CASES = {  # how it is written; unit of length [m], y of the face, what [piv_field] has to add
    "openpiv": (lambda f: openpiv(f, True), 1.0, TURNED - FACE, 'length = "px"\nspeed = "px/frame"\n'),
    "openpiv-rows": (lambda f: openpiv(f, False), 1.0, FACE, 'length = "px"\nspeed = "px/frame"\nup = "-y"\n'),
    "pivlab-text": (pivlab_text, 1.0, FACE, ""),
    "pivlab-mat": (lambda f: pivlab_mat(f, False, False), 1.0, FACE, ""),
    "pivlab-mat-up": (lambda f: pivlab_mat(f, False, True), 1.0, TURNED - FACE, ""),
    "pivlab-mat-metres": (lambda f: pivlab_mat(f, True, False), SCALE, FACE, ""),
    "pivpy-mm": (lambda f: pivpy(f, "mm", ("y", "x", "t")), SCALE * 1e3, TURNED - FACE, ""),
    "pivpy-pix": (lambda f: pivpy(f, "pix", ("t", "x", "y")), 1.0, TURNED - FACE, ""),
}


def folder_of(folder, case):
    write, unit, face, more = CASES[case]
    folder.mkdir(exist_ok=True)
    file = write(folder)
    scale = f"scale = {SCALE}\n" if unit == 1.0 else ""
    sigma = 1e-3 / (SCALE * RATE) if unit == 1.0 else 1.0 if unit == SCALE * 1e3 else 1e-3  # 1 mm/s as the file counts
    text = f"[bed]\nvolume_fraction = {PHI}\ngrain_density = {RHO}\n[robot]\nfoot_radius = 0.0381\n"
    text += f'[piv_field]\nfile = "{file}"\nframe_rate = {RATE}\nsigma = {sigma}\n'
    text += f"foot_row = {face * unit}\naxis_column = {AXIS * unit}\n"
    (folder / "experiment.toml").write_text(text + scale + more)
    return folder


def made(folder, output):
    return Workspace(open_experiment(folder), folder.parent / "out", folder.parent / "cache").make(output)
