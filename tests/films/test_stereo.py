"""Two cameras to places in space: the drawing has its own camera (matrices, OpenCV's own projection)."""

from __future__ import annotations

import cv2
import numpy as np
import pandas as pd
import pytest

import jumpvision as jv
from jumpvision.base.schema import InputError

FOCAL, MIDDLE = 1500.0, (640.0, 512.0)


def looking(at, eye):
    """(3, 4) matrix of a camera at `eye` [m] that looks `at` a place, z up."""
    forward = (np.subtract(at, eye)) / np.linalg.norm(np.subtract(at, eye))
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward])  # x right, y down, z forward
    inner = np.array([[FOCAL, 0.0, MIDDLE[0]], [0.0, FOCAL, MIDDLE[1]], [0.0, 0.0, 1.0]])
    return inner @ np.column_stack([turn, -turn @ np.asarray(eye)])


def see(camera, place):
    inner, turn, shift = cv2.decomposeProjectionMatrix(camera)[:3]
    shift = -turn @ (shift[:3] / shift[3])
    return cv2.projectPoints(np.asarray(place, float), cv2.Rodrigues(turn)[0], shift, inner / inner[2, 2], None)[0][
        :, 0
    ]


def way(t):
    """(n, 3) [m] of a body that flies."""
    return np.column_stack([-0.1 + 0.6 * t, 0.08 * np.cos(20 * t), 0.05 + 1.6 * t - 4.9 * t**2])


def scene(rng):
    marks = rng.uniform([-0.15, -0.15, 0.0], [0.15, 0.15, 0.4], (12, 3))
    cameras = looking((0, 0, 0.2), (1.2, 0.3, 0.3)), looking((0, 0, 0.2), (0.1, -1.4, 0.5))
    return marks, cameras, np.linspace(0.0, 0.3, 61)


def table(t, pixel, sigma=0.05):
    return pd.DataFrame({"time_s": t, "x_px": pixel[:, 0], "y_px": pixel[:, 1], "sigma_px": sigma, "flag": ""})


def of(out, name):
    return np.column_stack([out[name.format(axis)] for axis in "xyz"])


def test_without_noise_the_places_come_back():
    marks, cameras, t = scene(np.random.default_rng(1))
    out = jv.triangulate(*(table(t, see(c, way(t))) for c in cameras), marks, *(see(c, marks) for c in cameras))
    assert np.abs(of(out, "{}_m") - way(t)).max() < 1e-9 and (out.flag == "").all()


def test_error_is_near_the_bound_and_both_sigmas_are_true():
    """60 calibrations with marks read to 0.4 px, 61 places seen to 0.05 px. The bound is that of all pixels: the Fisher
    information of two cameras of 11 numbers and of the places by finite differences of the drawing's matrices.
    Deviations of 60 independent sets, each of three coordinates that hang together: about 7 % at worst."""
    rng = np.random.default_rng(3)
    marks, cameras, t = scene(rng)
    read, seen, path = 0.4, 0.05, way(t)
    misses, within, share, struck = [], [], [], []
    for _ in range(60):
        found = (see(c, marks) + rng.normal(0, read, (12, 2)) for c in cameras)
        tables = (table(t, see(c, path) + rng.normal(0, seen, (len(t), 2)), seen) for c in cameras)
        out = jv.triangulate(*tables, marks, *found)
        off, sigma, common = of(out, "{}_m") - path, of(out, "sigma_{}_m"), of(out, "sigma_common_{}_m")
        misses.append(off)
        struck.append(out.miss_sigma)
        within.append(np.mean(np.abs(off) < np.hypot(sigma, common)))
        share.append(off.mean(axis=0) / np.hypot(common.mean(axis=0), sigma.mean(axis=0) / np.sqrt(len(t))))
    error = np.sqrt(np.mean(np.square(misses), axis=0))  # by place and axis
    ratio = np.sqrt(np.mean((error / least_error(cameras, marks, path, read, seen)) ** 2))
    assert 0.85 < ratio < 1.2
    assert 0.60 < np.mean(within) < 0.76
    assert 0.85 < np.sqrt(np.mean(np.square(struck))) < 1.15  # rays miss by what pixels and marks allow
    assert 0.75 < np.std(share) < 1.25  # what all places share is in the common sigma


def least_error(cameras, marks, path, read, seen):
    """Cramer-Rao bound (n, 3) [m] of every place alone, with both cameras (11 numbers) unknown."""
    total = np.zeros((len(path), 3, 3))

    def view(q, place):
        u, v, w = q.reshape(3, 4) @ np.column_stack([place, np.ones(len(place))]).T
        return np.column_stack([u / w, v / w])

    for camera in cameras:
        q = camera.ravel() / camera[2, 3]
        steps = np.diag(1e-6 * np.maximum(np.abs(q), 0.1))[:11]  # the last is the scale of all
        by = [(view(q + s, marks) - view(q - s, marks)).ravel() / (2 * s.sum()) for s in steps]
        covariance = np.linalg.inv(np.stack(by) @ np.stack(by).T) * read**2
        by = np.stack([(view(q + s, path) - view(q - s, path)) / (2 * s.sum()) for s in steps], -1)  # (n, 2, 11)
        by_place = np.stack([(view(q, path + s) - view(q, path - s)) / 2e-6 for s in 1e-6 * np.eye(3)], -1)
        noise = by @ covariance @ np.swapaxes(by, 1, 2) + seen**2 * np.eye(2)
        total += np.swapaxes(by_place, 1, 2) @ np.linalg.solve(noise, by_place)
    return np.sqrt(np.diagonal(np.linalg.inv(total), axis1=1, axis2=2))


def drawn(rng, late=0.0):
    """The tables of two cameras, whose clocks differ by `late` [s], with marks that are read exactly."""
    marks, cameras, t = scene(rng)
    tables = [table(t, see(c, way(t + s)) + rng.normal(0, 0.05, (len(t), 2))) for c, s in zip(cameras, (0.0, late))]
    return tables, marks, [see(c, marks) for c in cameras], t


def test_two_tracks_become_one_in_space():
    """Clocks 2 ms apart: met by cubics, whose values between four samples are surer than one of them."""
    (a, b), marks, pixels, t = drawn(np.random.default_rng(5), late=0.002)
    out = jv.triangulate(a, b, marks, *pixels, offset=0.002)
    inside = out.flag == ""
    assert inside.sum() == 60 and out.flag[0] == "lost by the second camera"  # it begins 2 ms later
    for axis, name in enumerate("xyz"):
        off = (out[f"{name}_m"] - way(t)[:, axis])[inside]
        assert np.std(off / out[f"sigma_{name}_m"][inside]) == pytest.approx(1.0, abs=0.3)
    assert {"vx_m_s", "az_m_s2", "sigma_common_x_m", "miss_sigma"} <= set(out.columns)
    wrong, lost = b.copy(), b.copy()
    wrong.loc[30, "y_px"] += 8.0
    flagged = jv.triangulate(a, wrong, marks, *pixels, offset=0.002)
    assert "rays miss" in flagged.flag[30] and (flagged.flag != "").sum() <= 6  # the cubics through it
    assert np.isnan(flagged.x_m[30]) and flagged.miss_sigma[30] > 5.5
    lost.loc[30, ["x_px", "y_px", "sigma_px"]] = np.nan
    flagged = jv.triangulate(a, lost, marks, *pixels, offset=0.002)
    assert np.flatnonzero(flagged.flag != "").tolist() == [0, 30, 31]  # the frames on either side of the gap
    flagged = jv.triangulate(a.assign(sigma_px=lost.sigma_px, x_px=lost.x_px), b, marks, *pixels, offset=0.002)
    assert flagged.flag[30] == "lost by the first camera" and np.isnan(flagged.x_m[30])


def test_what_cannot_be_is_named():
    (a, b), marks, pixels, _ = drawn(np.random.default_rng(5))
    flat = marks * [1.0, 1.0, 0.0]
    for given, said in [
        ((marks[:5], pixels[0][:5], pixels[1][:5]), r"first camera.*\(5, 3\).*6 marks or more"),
        ((flat, *pixels), "one plane"),
        ((marks, pixels[0], pixels[1][:-1]), "second camera.*in the same order"),
        ((marks, pixels[0], np.where(pixels[1] == pixels[1][3], np.nan, pixels[1])), "second camera.*finite"),
        ((marks, pixels[0] * [1, -1], pixels[1]), "first camera.*rows counted down"),
    ]:
        with pytest.raises(InputError, match=said):
            jv.triangulate(a, b, *given)
    bare = [v.drop(columns="sigma_px") for v in (a, b)]
    for tables in ((bare[0], b), (a, bare[1]), bare):
        with pytest.raises(InputError, match="sigma_px"):
            jv.triangulate(*tables, marks, *pixels)
