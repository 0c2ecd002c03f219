"""Two cameras to places in space: the drawing has its own camera (matrices, OpenCV's own projection for the lens)."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.vision.stereo import FAR, at_times, pinhole, triangulate

FOCAL, MIDDLE = 1500.0, (640.0, 512.0)


def looking(at, eye, lens=0.0, focal=FOCAL):
    """(3, 3) inner matrix, rotation, T, distortion of a camera at `eye` [m] that looks `at` a place, z up."""
    forward = (np.subtract(at, eye)) / np.linalg.norm(np.subtract(at, eye))
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward])  # x right, y down, z forward
    inner = np.array([[focal, 0.0, MIDDLE[0]], [0.0, focal, MIDDLE[1]], [0.0, 0.0, 1.0]])
    return inner, turn, -turn @ np.asarray(eye), np.array([lens, 0.0, 0.0, 0.0])


def see(camera, place):
    inner, turn, shift, lens = camera
    return cv2.projectPoints(np.asarray(place, float), cv2.Rodrigues(turn)[0], shift, inner, lens)[0][:, 0]


def scene(rng, lens=0.0):
    marks = rng.uniform([-0.15, -0.15, 0.0], [0.15, 0.15, 0.4], (12, 3))
    cameras = looking((0, 0, 0.2), (1.2, 0.3, 0.3), lens), looking((0, 0, 0.2), (0.1, -1.4, 0.5), lens)
    t = np.linspace(0.0, 0.3, 61)
    path = np.column_stack([-0.1 + 0.6 * t, 0.08 * np.cos(20 * t), 0.05 + 1.6 * t - 4.9 * t**2])
    return marks, cameras, t, path


@pytest.mark.parametrize("lens", [0.0, -0.12])
def test_without_noise_the_places_come_back(lens):
    marks, cameras, _, path = scene(np.random.default_rng(1), lens)
    found = tuple(pinhole(see(c, marks), marks, lens=lens != 0.0) for c in cameras)
    assert found[0].p[:4] == pytest.approx([FOCAL, *MIDDLE, lens], abs=1e-4)
    ones = np.full(len(path), 0.02)
    places = triangulate(found, tuple(see(c, path) for c in cameras), (ones, ones))
    assert np.abs(places.place - path).max() < 1e-9


def test_error_is_at_the_bound_and_both_sigmas_are_true():
    """60 calibrations with marks read to 0.4 px, 61 places seen to 0.05 px. The bound is that of all pixels: the Fisher
    information of cameras and places by finite differences of the drawing's own projection. Deviations of 60
    independent sets, each of three coordinates that hang together: about 7 % at worst."""
    rng = np.random.default_rng(3)
    marks, cameras, _, path = scene(rng)
    read, seen = 0.4, 0.05
    misses, within, share, struck = [], [], [], []
    for _ in range(60):
        found = tuple(pinhole(see(c, marks) + rng.normal(0, read, (12, 2)), marks) for c in cameras)
        pixels = tuple(see(c, path) + rng.normal(0, seen, (len(path), 2)) for c in cameras)
        places = triangulate(found, pixels, (np.full(len(path), seen),) * 2)
        off = places.place - path
        misses.append(off)
        struck.append(places.miss)
        within.append(np.mean(np.abs(off) < np.hypot(places.sigma, places.common)))
        shared = places.place.mean(axis=0) - path.mean(axis=0)
        share.append(shared / np.hypot(places.common.mean(axis=0), places.sigma.mean(axis=0) / np.sqrt(len(path))))
    error = np.sqrt(np.mean(np.square(misses), axis=0))  # by place and axis
    bound = least_error(cameras, marks, path, read, seen)
    assert 0.85 < np.sqrt(np.mean((error / bound) ** 2)) < 1.2
    assert 0.60 < np.mean(within) < 0.76
    assert 0.85 < np.sqrt(np.mean(np.square(struck))) < 1.15  # rays miss by what pixels and marks allow
    assert 0.75 < np.std(share) < 1.25  # what all places share is in the common sigma


def least_error(cameras, marks, path, read, seen):
    """Cramer-Rao bound (n, 3) [m] of every place alone, with both cameras (f, c_x, c_y, rotation, T) unknown."""
    total = np.zeros((len(path), 3, 3))
    for inner, turn, shift, lens in cameras:

        def view(q, place, lens=lens):
            k = np.array([[q[0], 0, q[1]], [0, q[0], q[2]], [0, 0, 1.0]])
            return see((k, cv2.Rodrigues(q[3:6])[0], q[6:], lens), place)

        q = np.concatenate([[inner[0, 0], *MIDDLE], cv2.Rodrigues(turn)[0][:, 0], shift])
        steps = np.diag(1e-6 * np.maximum(np.abs(q), 0.1))
        by = [(view(q + s, marks) - view(q - s, marks)).ravel() / (2 * s.sum()) for s in steps]
        covariance = np.linalg.inv(np.stack(by) @ np.stack(by).T) * read**2
        by = np.stack([(view(q + s, path) - view(q - s, path)) / (2 * s.sum()) for s in steps], -1)  # (n, 2, 9)
        by_place = np.stack([(view(q, path + s) - view(q, path - s)) / 2e-6 for s in 1e-6 * np.eye(3)], -1)
        noise = by @ covariance @ np.swapaxes(by, 1, 2) + seen**2 * np.eye(2)
        total += np.swapaxes(by_place, 1, 2) @ np.linalg.solve(noise, by_place)
    return np.sqrt(np.diagonal(np.linalg.inv(total), axis1=1, axis2=2))


def test_a_ball_is_where_its_middle_is_not_where_its_outline_is():
    """A sphere's outline by its tangent cone: the points of it, drawn, and the ellipse's middle by least squares."""
    marks, cameras, _, _ = scene(np.random.default_rng(1))
    middle, radius = np.array([0.25, -0.2, 0.45]), 0.06
    outlines = []
    for camera in cameras:
        eye = -camera[1].T @ camera[2]
        away = middle - eye
        d = np.linalg.norm(away)
        one = np.cross(away, [0.0, 0.0, 1.0])
        two = np.cross(away, one)
        a = np.linspace(0, 2 * np.pi, 400)[:, None]
        ring = np.cos(a) * one / np.linalg.norm(one) + np.sin(a) * two / np.linalg.norm(two)
        touch = middle - away * (radius / d) ** 2 + radius * np.sqrt(1 - (radius / d) ** 2) * ring
        outlines.append(np.array(cv2.fitEllipseDirect(see(camera, touch).astype(np.float32))[0])[None])
    found = tuple(pinhole(see(c, marks), marks) for c in cameras)
    sigma = (np.array([0.05]), np.array([0.05]))
    ball = triangulate(found, tuple(outlines), sigma, radius).place[0]
    point = triangulate(found, tuple(outlines), sigma).place[0]
    assert np.linalg.norm(ball - middle) < 3e-6 < 1e-4 < np.linalg.norm(point - middle)


def test_clocks_that_differ_are_met_by_cubics():
    t = np.arange(20) * 0.01
    values = np.column_stack([t**3, 1 + t])
    got, sigma = at_times(t, values, np.full(20, 0.1), np.array([0.0, 0.004, 0.05, 0.187, 0.2]))
    want = np.array([0.0, 0.004, 0.05, 0.187])
    assert got[:4] == pytest.approx(np.column_stack([want**3, 1 + want]), abs=1e-12)
    assert np.isnan(got[4]).all() and np.isnan(sigma[4]) and sigma[2] == 0.1 and 0.05 < sigma[3] < 0.11
    values[7] = np.nan
    got, _ = at_times(t, values, np.full(20, 0.1), np.array([0.05, 0.062, 0.08]))
    assert np.isfinite(got[[0, 2]]).all() and np.isnan(got[1]).all()


def tables(rng, late=0.0):
    marks, cameras, t, path = scene(rng)
    frame = {}
    for name, camera, shift in (("a", cameras[0], 0.0), ("b", cameras[1], late)):
        s = t + shift
        there = np.column_stack([-0.1 + 0.6 * s, 0.08 * np.cos(20 * s), 0.05 + 1.6 * s - 4.9 * s**2])
        pixel = see(camera, there) + rng.normal(0, 0.05, (len(t), 2))
        frame[name] = jv_table(t, pixel)
    return frame, marks, [see(c, marks) for c in cameras], t, path


def jv_table(t, pixel):
    import pandas as pd

    return pd.DataFrame({"time_s": t, "x_px": pixel[:, 0], "y_px": pixel[:, 1], "sigma_px": 0.05, "flag": ""})


def test_two_tracks_become_one_in_space():
    frame, marks, pixels, _, path = tables(np.random.default_rng(5), late=0.002)
    out = jv.triangulate(frame["a"], frame["b"], marks, *pixels, offset=0.002)
    inside = out.flag == ""
    assert inside.sum() >= 60
    for axis, name in enumerate("xyz"):
        off = (out[f"{name}_m"] - path[:, axis])[inside]
        assert np.std(off / out[f"sigma_{name}_m"][inside]) == pytest.approx(1.0, abs=0.3)
    assert {"vx_m_s", "az_m_s2", "sigma_common_x_m", "miss_sigma"} <= set(out.columns)
    wrong = frame["b"].copy()
    wrong.loc[30, "y_px"] += 8.0
    with pytest.warns(StageWarning, match="same body"):
        flagged = jv.triangulate(frame["a"], wrong, marks, *pixels, offset=0.002)
    assert "rays miss" in flagged.flag[30] and (flagged.flag != "").sum() <= 5  # the cubics through it
    assert np.isnan(flagged.x_m[30]) and flagged.miss_sigma[30] > FAR


def test_what_cannot_be_is_named():
    frame, marks, pixels, _, _ = tables(np.random.default_rng(5))
    flat = marks * [1.0, 1.0, 0.0]
    for given, said in [
        ((marks[:5], pixels[0][:5], pixels[1][:5]), "first camera.*5; a camera needs 6"),
        ((flat, *pixels), "one plane"),
        ((marks, pixels[0], pixels[1][:-1]), "second camera.*in the same order"),
        ((marks, pixels[0], np.where(pixels[1] == pixels[1][3], np.nan, pixels[1])), "second camera.*finite"),
    ]:
        with pytest.raises(InputError, match=said):
            jv.triangulate(frame["a"], frame["b"], *given)
    with pytest.raises(InputError, match="sigma_px"):
        jv.triangulate(frame["a"].drop(columns="sigma_px"), frame["b"], marks, *pixels)
