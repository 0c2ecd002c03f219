"""Gradients, strain and grain momentum against written-down fields; stated against true errors."""

import math

import numpy as np
import pytest

from jumpvision.films.grains.gradients import (
    correlated_variance,
    divergence,
    divergence_sigma,
    gradients,
    overlap,
    shear_rate,
    shear_rate_sigma,
    vorticity,
    vorticity_sigma,
)
from jumpvision.films.grains.grid import Plane
from jumpvision.films.grains.momentum import Domain, Foot, added_mass, grain_momentum
from tests.worlds.vector_fields import window_noise

DX = 1e-3
NY, NX = 18, 25
X = (np.arange(NX) - 11.3) * DX
Y = -(np.arange(NY) + 0.5) * DX


def plane(u_x, u_y, v_x, v_y, x=X, y=Y):
    return u_x * x[None] + u_y * y[:, None], v_x * x[None] + v_y * y[:, None]


ONES = np.ones((NY, NX))


@pytest.mark.parametrize(("flip_x", "flip_y"), [(1, -1), (-1, 1)])
def test_a_plane_is_exact_whatever_way_the_axes_run_and_whatever_is_missing(flip_x, flip_y):
    x, y = X[::flip_x] + 3e-5 * np.sin(np.arange(NX)), Y[::flip_y]  # not equally spaced either
    u, v = plane(3.0, -2.0, 5.0, 1.0, x, y)
    valid = np.random.default_rng(0).random((NY, NX)) > 0.2
    g = gradients(np.where(valid, u, 1e3), v, x, y, ONES, ONES, valid, half_width=1, correlation_length=1.0)
    there = np.isfinite(g.u_x)
    assert there.sum() > 0.7 * NY * NX and not there[~valid].any()
    for got, true in ((g.u_x, 3.0), (g.u_y, -2.0), (g.v_x, 5.0), (g.v_y, 1.0)):
        assert np.abs(got[there] - true).max() < 1e-9  # rounding: 1e3 m/s * 1e-16 / 1e-3 m


def test_no_difference_is_taken_across_a_hole_and_a_line_gives_none():
    u = np.zeros((NY, NX))
    u[:, 12:] = 1.0  # a jump behind an invalid column: any fit across it would see it
    valid = np.ones((NY, NX), dtype=bool)
    valid[:, 11] = False
    g = gradients(u, u, X, Y, ONES, ONES, valid, half_width=3, correlation_length=1.0)
    assert np.nanmax(np.abs(g.u_x)) < 1e-9
    line = np.zeros((NY, NX), dtype=bool)
    line[4, :] = True
    line[np.arange(8, 14), np.arange(8, 14)] = True
    g = gradients(u, u, X, Y, ONES, ONES, line, half_width=2, correlation_length=1.0)
    assert np.isnan(g.u_x).all()


@pytest.mark.parametrize("length", [1, 4])
def test_stated_sigmas_are_the_true_errors_with_overlapping_windows(length):
    rng, z = np.random.default_rng(length), {k: [] for k in ("u_x", "v_y", "shear", "vorticity", "divergence")}
    for _ in range(30):
        s = 0.004 * (1.0 + 0.5 * rng.random((NY, NX)))
        u, v = plane(3.0, -2.0, 8.0, 1.0)
        u, v = u + window_noise(rng, NY, NX, length) * s, v + window_noise(rng, NY, NX, length) * s
        g = gradients(u, v, X, Y, s, s, rng.random((NY, NX)) > 0.1, half_width=2, correlation_length=length)
        z["u_x"].append((g.u_x - 3.0) / g.u_x_sigma)
        z["v_y"].append((g.v_y - 1.0) / g.v_y_sigma)
        z["shear"].append((shear_rate(g.u_x, g.u_y, g.v_x, g.v_y) - math.sqrt(2.0 + 18.0)) / shear_rate_sigma(g))
        z["vorticity"].append((vorticity(g.u_y, g.v_x) - 10.0) / vorticity_sigma(g))
        z["divergence"].append((divergence(g.u_x, g.v_y) - 4.0) / divergence_sigma(g))
    for name, parts in z.items():
        all_z = np.concatenate([p[np.isfinite(p)] for p in parts])
        # 13,000 values in some 30 * 18 independent patches: 1 sigma of the coverage is 0.02
        assert abs(np.mean(np.abs(all_z) < 1.0) - 0.683) < 0.06, name


def test_strain_of_known_motions():
    zero, rate = np.zeros(1), np.full(1, 7.0)
    assert shear_rate(zero, rate, zero, zero)[0] == pytest.approx(7.0 / math.sqrt(2.0))  # simple shear
    assert shear_rate(zero, -rate, rate, zero)[0] == pytest.approx(0.0)  # solid rotation
    assert vorticity(-rate, rate)[0] == pytest.approx(14.0)
    assert shear_rate(rate, zero, zero, rate)[0] == pytest.approx(0.0)  # plane dilation


def test_window_overlap_is_what_averaging_over_windows_makes():
    rng = np.random.default_rng(0)
    n = np.array([window_noise(rng, 5, 7, 3) for _ in range(4000)])
    for dy, dx in ((0, 1), (1, 1), (2, 0), (3, 0)):
        got = np.mean(n[:, 0, 0] * n[:, dy, dx])
        assert abs(got - overlap(dy, 3) * overlap(dx, 3)) < 4.0 / math.sqrt(4000)
    a = rng.normal(0.0, 1.0, (5, 7))
    assert np.mean((n * a).sum(axis=(1, 2)) ** 2) == pytest.approx(
        correlated_variance(a, 3), rel=4 * math.sqrt(2 / 4000)
    )


A, B, V = 6e-3, 5e-3, 0.4  # v = -V exp(-(r/A)^2) exp(-depth/B)
M = {"bulk_density": 570.0, "disc": "full"}


def momentum(v, x, y, sigma, valid, *, top, bottom, left, right, **how):
    """`grain_momentum` about the axis x = 0."""
    return grain_momentum(Plane(v, sigma, valid, x, y), Domain(top, bottom, left, right), **how)


def plume(nx, ny, shift=0.0):
    """x, y, v and the exact momentum inside the domain; the axis lies `shift` grid steps right of the middle."""
    x = (np.arange(nx) - 0.5 * (nx - 1) - shift) * DX
    y = -(np.arange(ny) + 0.5) * DX
    box = {"top": 0.0, "bottom": -ny * DX, "left": (-0.5 * nx - shift) * DX, "right": (0.5 * nx - shift) * DX}
    v = -V * np.exp(-((x[None] / A) ** 2)) * np.exp(y[:, None] / B)
    far = max(-box["left"], box["right"])
    true = (
        570.0 * 2.0 * math.pi * V * 0.5 * A * A * (1 - math.exp(-((far / A) ** 2))) * B * (1 - math.exp(-ny * DX / B))
    )
    return x, y, v, box, true


@pytest.mark.parametrize("shift", [0.3, 6.2])
def test_momentum_of_a_plume_with_the_axis_anywhere(shift):
    x, y, v, box, true = plume(41, 40, shift)
    s, valid, how = np.zeros_like(v), np.ones_like(v), box | M | {"correlation_length": 1.0}
    got = momentum(v, x, y, s, valid, **how)
    # midpoint rule: relative error DX^2/24 (v''/v) is 0.0017 along depth (1/B^2) and less than 0.5 % across
    assert got.value == pytest.approx(true, rel=0.005) and got.value > 0.0
    assert got.covered == pytest.approx(1.0)
    assert momentum(v, x, y, s, valid, **how | {"disc": "half"}).value == pytest.approx(0.5 * got.value)
    assert momentum(v[::-1, ::-1], x[::-1], y[::-1], s, valid, **how).value == pytest.approx(got.value)
    loud = np.where(y[:, None] > -10.0 * DX, 50.0, v)  # above the face nothing counts
    deep, same = (momentum(w, x, y, s, valid, **how | {"top": -10.0 * DX}) for w in (v, loud))
    assert deep.value == same.value < got.value


def test_momentum_sigma_is_the_true_error(length=4):
    x, y, v, box, true = plume(41, 40, 0.3)
    rng, z, s = np.random.default_rng(length), [], np.full(v.shape, 0.02)
    for _ in range(200):
        noisy, valid = v + window_noise(rng, *v.shape, length) * s, rng.random(v.shape) > 0.05
        got = momentum(noisy, x, y, s, valid, **box, **M, correlation_length=length)
        assert got.covered > 0.98
        z.append((got.value - true) / got.sigma)
    assert 0.58 < np.mean(np.abs(z) < 1.0) < 0.785  # 200 draws: 0.683 +- 3 * 0.033
    assert abs(np.mean(z)) < 0.25  # 3/sqrt(200) = 0.21, and the midpoint rule's 0.5 %


def test_the_gap_below_the_face_is_bridged_and_a_lost_corner_is_reported():
    x, y, v, box, true = plume(41, 40)
    s, valid = np.zeros_like(v), np.ones(v.shape, dtype=bool)
    valid[:2] = False  # within half a window of the face, as PIV leaves it
    got = momentum(v, x, y, s, valid, **box, **M, correlation_length=4.0)
    assert got.covered == pytest.approx(1.0)
    assert abs(got.value - true) < 2.0 * got.sigma and got.sigma < 0.07 * true
    # the speed falls to 1/e in 5 mm here: taking the first vector's value for the 2 mm gap would lose 8.6 %
    assert abs(got.value - true) < 0.05 * true
    valid[20:, 20:] = False
    lost = momentum(v, x, y, s, valid, **box, **M, correlation_length=1.0)
    assert 0.6 < lost.covered < 0.8  # a quarter of the view, and the rows too far below the face


def test_a_hole_is_uncertain_by_the_difference_of_its_neighbours():
    """Evenly spread between them: their difference over sqrt(12), times what the momentum changes by with the cell."""
    x, y, v, box, _ = plume(41, 40)
    one = np.zeros(v.shape)
    one[10, 24] = 1.0
    whole, more, hole = (
        momentum(w, x, y, 0.0 * v, ok, **box, **M, correlation_length=4.0)
        for w, ok in ((v, one < 2), (v - one, one < 2), (v, one < 1))
    )
    of_hole = (more.value - whole.value) * (v[10, 25] - v[10, 23]) / math.sqrt(12.0)
    assert math.sqrt(hole.sigma**2 - whole.sigma**2) == pytest.approx(abs(of_hole), rel=1e-6)


def test_a_plug_counts_in_full_wherever_the_face_lies_between_two_rows():
    """Windows of 3 steps leave no vectors within 1.5 steps of the face; the cells up to it are part of the plug."""
    x, y, v, box, _ = plume(41, 40)
    for below in (0.05, 0.45, 0.55, 0.95):
        top = y[5] + below * DX
        valid = np.repeat((y < top - 1.5 * DX)[:, None], x.size, axis=1)
        flat = np.full(v.shape, -V)
        whole = momentum(flat, x, y, 0.0 * v, valid, **(box | {"top": top}), **M, correlation_length=3.0)
        assert whole.covered == pytest.approx(1.0)
        assert whole.value == pytest.approx(570.0 * math.pi * V * box["right"] ** 2 * (top - box["bottom"]))


def test_grains_at_the_face_of_a_pushing_foot_are_not_slower_than_it():
    """v = -V exp(-depth/4 mm) under the foot, at rest beside it, first vectors at 2.5 mm: a straight line to the foot's
    speed there is d^3/(12 B^3) of 3/4 of the momentum too much, 1.5 %; a slope from below falls short by more."""
    x, y, _, box, _ = plume(41, 40)
    under = np.abs(x) < 15.2 * DX
    v = -V * np.exp(y / 4e-3)[:, None] * under
    valid = np.repeat((y < -2e-3)[:, None], x.size, axis=1)
    how = {**box, **M, "correlation_length": 3.0}
    fine = np.linspace(0.0, -box["bottom"], 4000)
    true = 570.0 * math.pi * (15.5 * DX) ** 2 * V * np.trapezoid(np.exp(-fine / 4e-3), fine)
    without = momentum(v, x, y, 0.0 * v, valid, **how)
    held = momentum(v, x, y, 0.0 * v, valid, **how, foot=Foot(15.2e-3, -V))
    assert 0.0 < held.value - true < 0.02 * true < true - without.value
    assert abs(held.value - true) < 2.0 * held.sigma
    # a foot in the air over grains at rest, and one that lifts off moving grains, push nothing
    assert momentum(0.0 * v, x, y, 0.0 * v, valid, **how, foot=Foot(15.2e-3, -V)).value == 0.0
    assert momentum(v, x, y, 0.0 * v, valid, **how, foot=Foot(15.2e-3, V)).value == without.value


def test_added_mass_is_masked_near_reversal_and_its_sigma_holds():
    m, s = added_mass([0.02, 0.02, 0.02], [1e-3] * 3, [0.5, 0.04, 0.2], [0.01, 0.001, 0.1], min_speed=0.05)
    assert m[0] == pytest.approx(0.04) and s[0] == pytest.approx(math.hypot(1e-3, 0.04 * 0.01) / 0.5)
    assert np.isnan(m[1:]).all()  # below min_speed; below five sigmas


def test_the_rim_that_the_grid_leaves_at_the_edge_of_the_picture_counts():
    """A picture 0.6 steps wider than the outermost windows at each edge, in a flow that reaches the edges.

    Left out the rim would lose 1 - (15/15.6)^2 13/13.6 = 12 %; the flow varies by 1/30 a step.
    """
    x, y = (np.arange(27) - 13.0) * DX, -(np.arange(12) + 1.5) * DX
    s = np.full((12, 27), 1e-6)
    edge = (13.0 + 2.0 + 0.6) * DX
    box = {"top": 0.0, "bottom": y[-1] - 2.6 * DX, "left": -edge, "right": edge}
    slope = 1.0 / (30.0 * DX)
    flat = momentum(np.full(s.shape, -V), x, y, s, s > 0, **box, **M, correlation_length=4.0)
    whole = 570.0 * math.pi * edge**2 * -box["bottom"] * V
    assert flat.covered == pytest.approx(1.0)
    assert flat.value == pytest.approx(whole, rel=1e-9)
    v = -V * (1.0 + slope * y)[:, None] * (1.0 - slope * np.abs(x))
    got = momentum(v, x, y, s, s > 0, **box, **M, correlation_length=4.0)
    height, down = -box["bottom"], box["bottom"] ** 2 / 2.0
    true = 570.0 * 2.0 * math.pi * V * (height - slope * down) * (edge**2 / 2.0 - slope * edge**3 / 3.0)
    assert abs(got.value - true) < 2.0 * got.sigma and got.sigma < 0.05 * true


def test_errors_alike_over_more_than_a_window_widen_the_sigma_and_not_the_value():
    """As after adaptive smoothing: the window says how far cells reach, error_length how far errors are alike."""
    rng, z = np.random.default_rng(8), []
    x, y = (np.arange(40) - 19.5) * DX, -(np.arange(30) + 0.5) * DX
    s = np.full((30, 40), 0.01)
    keys = M | {"top": 0.0, "bottom": -0.03, "left": -0.02, "right": 0.02, "disc": "half", "correlation_length": 3.0}
    whole = momentum(-np.ones((30, 40)), x, y, s, s > 0, **keys)
    for _ in range(150):
        noisy = -1.0 + 0.01 * window_noise(rng, 30, 40, 7)
        p = momentum(noisy, x, y, s, s > 0, error_length=7.0, **keys)
        z.append((p.value - whole.value) / p.sigma)
    assert p.sigma > 1.5 * whole.sigma
    assert abs(np.std(z) - 1.0) < 0.25  # 150 draws: 3 * 0.058; the sigma also holds what the border may drift
