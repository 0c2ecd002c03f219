"""Friction between discs: closed forms of oblique impacts and of rolling, balances, order, and LAMMPS beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jumpvision.laboratory.dem.discs import Block, Box, Discs, Law, Plate
from jumpvision.laboratory.dem.motion import integrate, time_step
from jumpvision.laboratory.dem.packing import pack

D = 1e-3  # m, mean diameter
BOX = Box(-0.012, 0.012, -0.010, 0.0)
OPEN = Box(BOX.left, BOX.right, BOX.bottom)


def bed(fraction=0.78, seed=0):
    return pack(BOX, fraction, diameter=D, density=1.0, rng=np.random.default_rng(seed))


def law_for(discs, restitution=0.5, **others):
    return Law.bouncing(restitution, 3e-5, 0.5 * float(discs.mass.min()), **others)


def inertia(d):
    return 0.5 * d.mass * d.radius**2


# -- one contact ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["left", "right", "bottom", "top", "plate"])
def test_a_disc_that_slides_along_a_wall_gets_the_coulomb_impulse(side):
    """J_t = mu J_n = 2 mu m v_n; levers shorter by the overlap v_n t_c/pi, 4e-4 of the radius here."""
    away = {"left": (-1, 0), "right": (1, 0), "bottom": (0, -1), "top": (0, 1), "plate": (0, 1)}[side]
    along = (away[1], -away[0])
    vn, vt, mu, m, r = 0.02, 0.06, 0.3, 1e-6, 0.5 * D
    v = [vn * a + vt * b for a, b in zip(away, along)]
    d = Discs(*(np.array([a]) for a in (0.0, 0.0, r, m, v[0], v[1])))
    wall = {} if side == "plate" else {side: 0.6 * D if side in ("right", "top") else -0.6 * D}
    foot = {"foot": Plate(D, D), "foot_t": [0, 1], "foot_y": [0.6 * D, 0.6 * D]} if side == "plate" else {}
    got = integrate(d, Law.bouncing(1.0, 3e-5, m, friction=mu), Box(**wall), times=[0.0, 0.01], dt=1e-8, **foot)
    out = np.array([got.vx[-1, 0], got.vy[-1, 0]])
    assert out @ along == pytest.approx(vt - 2.0 * mu * vn, rel=1e-4)
    assert out @ away == pytest.approx(-vn, rel=1e-4)
    spin = 2.0 * mu * vn * m * r / (0.5 * m * r * r)  # the wall lies ahead: J_t against `along` turns it anticlockwise
    assert got.spin[-1, 0] == pytest.approx(-spin * (away[0] * along[1] - away[1] * along[0]), rel=1e-3)


def test_two_unequal_discs_that_slide_past_each_other_obey_walton():
    """Walton 1993: in gross sliding J_t = mu (1 + e) m_eff v_n whatever the slip; both spins change by J_t r/I.

    Friction works J_t times the mean of the slip before and after. The contact turns by 0.2 m/s t_c/D = 2e-4 rad, which
    is 0.2/0.03 times as much of the normal velocity: 0.14 %. The overlap is 1e-5 of the levers.
    """
    d = Discs(np.array([-0.405 * D, 0.605 * D]), np.zeros(2), np.array([0.4, 0.6]) * D, np.array([1e-6, 3e-6]),
              np.array([0.02, -0.01]), np.array([0.15, -0.05]), np.array([20.0, -10.0]))  # fmt: skip
    mu, m_eff, gap = 0.4, 0.75e-6, 0.01 * D
    d = replace(d, y=-d.vy * gap / 0.03)  # level when they touch
    law = Law.bouncing(1.0, 1e-6, m_eff, friction=mu)
    got = integrate(d, law, Box(), times=[0.0, gap / 0.03 + 1e-5], dt=2e-9)
    slip = 0.15 + 0.05 + 20.0 * 0.4 * D - 10.0 * 0.6 * D  # of disc 0's surface past disc 1's, up
    push = mu * 2.0 * m_eff * 0.03
    assert got.vy[-1] - d.vy == pytest.approx([-push / 1e-6, push / 3e-6], rel=2e-3)
    turned = -push * d.radius / inertia(d)
    assert got.spin[-1] - d.spin == pytest.approx(turned, rel=2e-3)
    after = got.vy[-1, 0] - got.vy[-1, 1] + got.spin[-1] @ d.radius
    assert 0.0 < after < slip  # it slid throughout
    work = got.friction_power[-1] * got.t[-1]
    assert work == pytest.approx(-push * 0.5 * (slip + after), rel=2e-3)
    energy = [0.5 * np.sum(d.mass * (a.vx**2 + a.vy**2) + inertia(d) * a.spin**2) for a in (d, got.last(d))]
    assert energy[1] - energy[0] == pytest.approx(work, rel=2e-3)


def test_a_disc_that_slides_on_a_floor_comes_to_roll_at_two_thirds_of_its_speed():
    """Angular momentum about the floor: v = v_0/(1 + I/(m r^2)), reached at v_0/(3 mu g)."""
    r, m, g, mu, v0 = 0.5 * D, 1e-6, 9.81, 0.3, 0.3
    law = Law.bouncing(0.5, 3e-5, m, gravity=g, friction=mu)
    sunk = m * g / law.stiffness
    d = Discs(*(np.array([a]) for a in (0.0, r - sunk, r, m, v0, 0.0)))
    stop = v0 / (3.0 * mu * g)
    got = integrate(d, law, Box(bottom=0.0), times=[0.0, 0.5 * stop, 2.0 * stop, 4.0 * stop], dt=1e-6)
    assert got.vx[1, 0] == pytest.approx(v0 - mu * g * 0.5 * stop, rel=1e-6)
    assert got.spin[1, 0] == pytest.approx(-2.0 * mu * g / r * 0.5 * stop, rel=2.0 * sunk / r + 1e-6)
    # the spring's last stretch, mu m g/k_t, may still swing: its speed is 1e-5 m/s
    assert got.vx[2:, 0] == pytest.approx(2.0 / 3.0 * v0, abs=2e-5)
    assert got.spin[2:, 0] == pytest.approx(-2.0 / 3.0 * v0 / r, rel=1e-4)


# -- many discs -------------------------------------------------------------------------------------------------------


def test_linear_and_angular_momentum_of_free_discs_are_kept():
    rng = np.random.default_rng(3)
    d = bed(0.5)
    d = replace(d, vx=rng.normal(0, 0.3, len(d.x)), vy=rng.normal(0, 0.3, len(d.x)), spin=rng.normal(0, 500, len(d.x)))
    law = law_for(d, friction=0.5)
    m = integrate(d, law, Box(), times=[0.0, 0.005, 0.02], dt=time_step(d, law))
    assert np.mean(np.abs(m.spin[-1] - d.spin) > 1.0) > 0.8  # nearly all have rubbed
    scale = np.sum(d.mass * np.hypot(d.vx, d.vy))
    for p in (d.mass * m.vx, d.mass * m.vy):
        assert np.ptp(p.sum(axis=1)) < 1e-12 * scale
    turning = np.sum(d.mass * (m.x * m.vy - m.y * m.vx) + inertia(d) * m.spin, axis=1)
    assert np.ptp(turning) < 1e-11 * scale * 0.012


@pytest.mark.parametrize("foot", [Plate(0.004, 0.01), Block.row(0.004, 0.5 * D)], ids=["plate", "grains"])
def test_energy_balance_with_the_work_of_friction_and_foot(foot):
    """Elastic along the normals: dE = foot's work + friction's. Errors come from steps in which contacts open or close:
    at half the step no more than 1 % of friction's work may be missing."""
    d = bed(0.8)
    law = law_for(d, restitution=1.0, gravity=9.81, friction=0.4)
    t = np.linspace(0.0, 8e-3, 9)
    m = integrate(d, law, OPEN, times=t, dt=0.25 * time_step(d, law), foot=foot, foot_t=t, foot_y=-0.3 * t)
    speed = m.foot_v[0]
    work = (m.foot_force[1:, 1] * speed + m.friction_power[1:]) @ np.diff(t)

    def energy(k):
        x, y = m.x[k], m.y[k]
        overlap = np.add.outer(d.radius, d.radius) - np.hypot(np.subtract.outer(x, x), np.subtract.outer(y, y))
        np.fill_diagonal(overlap, 0.0)
        squares = 0.5 * np.sum(np.maximum(overlap, 0.0) ** 2)
        for gap in (x - d.radius - OPEN.left, OPEN.right - x - d.radius, y - d.radius - OPEN.bottom):
            squares += np.sum(np.minimum(gap, 0.0) ** 2)
        if isinstance(foot, Plate):
            dx, dy = x - np.clip(x, -foot.half_width, foot.half_width), y - np.maximum(y, m.foot_y[k])
            touch = d.radius - np.hypot(dx, dy)
        else:
            feet = np.hypot(np.subtract.outer(x, foot.x), np.subtract.outer(y, foot.y + m.foot_y[k]))
            touch = np.add.outer(d.radius, foot.radius) - feet
        squares += np.sum(np.maximum(touch, 0.0) ** 2)
        kinetic = 0.5 * np.sum(d.mass * (m.vx[k] ** 2 + m.vy[k] ** 2) + inertia(d) * m.spin[k] ** 2)
        return kinetic + law.gravity * np.sum(d.mass * y) + 0.5 * law.stiffness * squares

    rubbed = m.friction_power[1:] @ np.diff(t)
    assert rubbed < -0.1 * abs(work - rubbed)
    assert energy(-1) - energy(0) == pytest.approx(work, abs=0.01 * abs(rubbed))


def test_trajectories_converge_at_second_order_while_contacts_stick():
    """Discs pressed together that turn and shear, friction never at its limit; errors against 16 times the steps."""
    n = 6
    i, j = np.divmod(np.arange(n * n), n)
    rng = np.random.default_rng(4)
    step = 0.97 * D
    box = Box(-0.5 * n * step, 0.5 * n * step, -n * step, 0.0)
    d = Discs.at_rest((j + 0.5) * step + box.left, -(i + 0.5) * step, np.full(n * n, 0.5 * D), density=1.0)
    d = replace(
        d, mass=d.mass * rng.uniform(0.7, 1.3, n * n), vx=rng.normal(0, 0.01, n * n), spin=rng.normal(0, 30, n * n)
    )
    law = law_for(d, restitution=0.7, viscous=2000.0, gravity=30.0, friction=5.0)
    t = np.linspace(0.0, 1e-4, 21)
    foot = {"foot": Plate(1.0, 0.01), "foot_t": t, "foot_y": -3e-6 * np.sin(6e4 * t) ** 2}

    def end(steps):
        m = integrate(d, law, box, times=[0.0, 1e-4], dt=1e-4 / steps, **foot)
        return np.concatenate([m.x[-1] - d.x, m.y[-1] - d.y, 1e-5 * m.vx[-1], 1e-5 * m.vy[-1], 5e-9 * m.spin[-1]])

    truth = end(64 * 40)
    errors = [np.linalg.norm(end(k * 40) - truth) for k in (1, 2, 4)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2.0) < 0.1), orders


def test_the_stretch_of_a_contact_outlives_list_and_interval():
    """A pair that sticks, in 1 and in 20 intervals: each begins with a new list and the true in place of the foreseen
    velocity, within the error of a step; a lost stretch would change the spin by its own size."""
    law, r = Law.bouncing(0.5, 3e-5, 0.5e-6, friction=5.0), 0.5 * D
    d = Discs(*(np.array(a) for a in ([-r, r], [0.0] * 2, [r] * 2, [1e-6] * 2, [0.1, -0.1], [0.0, 0.05])))
    whole = integrate(d, law, Box(), times=[0.0, 2e-5], dt=1e-8)
    parts = integrate(d, law, Box(), times=np.linspace(0.0, 2e-5, 21), dt=1e-8)
    assert parts.spin[-1] == pytest.approx(whole.spin[-1], rel=1e-4)


# -- beside LAMMPS ----------------------------------------------------------------------------------------------------


def test_motion_is_that_of_lammps(lammps_peer):
    """Half a contact time of gran/hooke/history in a bed in motion: velocities and spins.

    LAMMPS takes the radii as levers (overlap/diameter = 0.5 % here). The walls are out of reach: in that of its version
    22 Jul 2025 the tangential spring of a disc that sticks does not act, only its dashpot.
    """
    rng = np.random.default_rng(6)
    d = bed(0.8)
    n = len(d.x)
    d = replace(d, radius=1.005 * d.radius, vx=rng.normal(0, 0.05, n), vy=rng.normal(0, 0.05, n))
    law = law_for(d, friction=0.5)
    steps, dt = 150, 1e-7
    box = Box(2.0 * BOX.left, 2.0 * BOX.right, 2.0 * BOX.bottom, -BOX.bottom)
    lmp = lammps_peer.start(d, law, box, dt=dt, skin=3e-4)
    lmp.command(f"run {steps} post no")
    theirs = [lammps_peer.by_id(lmp, name, n) for name in ("v", "omega")]
    lmp.close()
    m = integrate(d, law, box, times=[0.0, steps * dt], dt=dt)
    ours = np.stack([m.vx[-1] - d.vx, m.vy[-1] - d.vy], axis=1)
    change = theirs[0][:, :2] - np.stack([d.vx, d.vy], axis=1)
    assert np.linalg.norm(ours - change) < 0.01 * np.linalg.norm(change)
    assert np.linalg.norm(m.spin[-1] - theirs[1][:, 2]) < 0.01 * np.linalg.norm(theirs[1][:, 2])
