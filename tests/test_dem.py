"""Discs: closed forms, balances, the order of the integrator, and LAMMPS' forces on the same configuration."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jumpvision.base.threads import at_most
from jumpvision.laboratory.dem import motion
from jumpvision.laboratory.dem.discs import Block, Box, Discs, Law, Plate
from jumpvision.laboratory.dem.motion import forces, integrate, packed, time_step
from jumpvision.laboratory.dem.neighbours import neighbours
from jumpvision.laboratory.dem.packing import pack, sizes

D = 1e-3  # m, mean diameter
BOX = Box(-0.012, 0.012, -0.010, 0.0)
OPEN = Box(BOX.left, BOX.right, BOX.bottom)


def bed(fraction=0.78, seed=0, **how):
    return pack(BOX, fraction, diameter=D, density=1.0, rng=np.random.default_rng(seed), **how)


def law_for(discs, restitution=0.5, **others):
    return Law.bouncing(restitution, 3e-5, 0.5 * float(discs.mass.min()), **others)


def row(x, vx, radius=0.5 * D, mass=1e-6):
    """Discs on the x axis."""
    x, vx = np.asarray(x, float), np.asarray(vx, float)
    full = np.ones(x.shape)
    return Discs(x, 0 * x, radius * full, mass * full, vx, 0 * x)


# -- packing and neighbours -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["mono", "bi", "poly"])
def test_a_packing_has_its_fraction_and_no_overlaps(kind):
    d = bed(kind=kind)
    area = (BOX.right - BOX.left) * (BOX.top - BOX.bottom)
    assert math.pi * np.sum(d.radius**2) / area == pytest.approx(0.78, rel=1e-12)
    gap = np.hypot(np.subtract.outer(d.x, d.x), np.subtract.outer(d.y, d.y)) - np.add.outer(d.radius, d.radius)
    np.fill_diagonal(gap, 1.0)
    assert gap.min() >= -1e-3 * D  # the tolerance asked for
    assert np.all(np.abs(d.x) + d.radius <= BOX.right + 1e-3 * D)
    assert np.all(d.y + d.radius <= BOX.top + 1e-3 * D) and np.all(d.y - d.radius >= BOX.bottom - 1e-3 * D)
    ratio = {"mono": 1.0, "bi": 1.4}.get(kind)
    assert ratio is None or d.radius.max() / d.radius.min() == pytest.approx(ratio)


def test_a_fraction_beyond_jamming_is_refused():
    with pytest.raises(ValueError, match=r"still overlap .* 0\.88; give a smaller fraction"):
        bed(0.88, rounds=2000)


def test_sizes_have_the_mean_diameter():
    for kind in ("mono", "bi", "poly"):
        r = sizes(kind, 4000, D, 0.1, np.random.default_rng(2))
        assert 2 * r.mean() == pytest.approx(D, rel=4 * 0.1 / math.sqrt(4000))  # 4 sigma of the mean


@pytest.mark.parametrize("seed", range(3))
def test_the_cell_list_finds_what_the_double_loop_finds(seed):
    rng = np.random.default_rng(seed)
    n, n_free, reach = 300, 280, 4e-4
    p = np.zeros((n, 6))
    p[:, :2] = rng.uniform(-1, 1, (n, 2)) * (0.01, 0.03)
    p[:, 4] = rng.uniform(0.1, 1.0, n) * D
    start, partner = np.empty(n_free + 1, np.int64), np.empty(60 * n, np.int64)
    count = neighbours(p, n_free, reach, start, partner)
    found = {(i, int(j)) for i in range(n_free) for j in partner[start[i] : start[i + 1]]}
    near = np.hypot(np.subtract.outer(p[:, 0], p[:, 0]), np.subtract.outer(p[:, 1], p[:, 1]))
    truth = {(i, j) for i, j in np.argwhere(near < np.add.outer(p[:, 4], p[:, 4]) + reach) if i < j and i < n_free}
    assert found == truth and count == len(truth)


# -- one contact, one grain -------------------------------------------------------------------------------------------


def test_restitution_of_two_unequal_discs_is_the_closed_form():
    """e = exp(-gamma t_c/2). The time of touch falls anywhere in a step h: an error of gamma h at most."""
    d = replace(row([-0.6 * D, 0.6 * D], [0.5, -0.3]), mass=np.array([1e-6, 3e-6]))
    m_eff = 0.75e-6
    law = Law.bouncing(0.4, 3e-5, m_eff)
    assert law.contact_time(m_eff) == pytest.approx(3e-5)
    h = 3e-5 / 3000
    m = integrate(d, law, Box(), times=[0.0, 1e-3], dt=h)
    assert (m.vx[-1, 1] - m.vx[-1, 0]) / 0.8 == pytest.approx(0.4, abs=law.damping * h)
    assert np.sum(d.mass * m.vx[-1]) == pytest.approx(np.sum(d.mass * d.vx), rel=1e-12)


@pytest.mark.parametrize("side", ["left", "right", "bottom", "top", "plate"])
def test_a_wall_returns_the_same_share(side):
    away = {"left": (-1, 0), "right": (1, 0), "bottom": (0, -1), "top": (0, 1), "plate": (0, 1)}[side]
    d = Discs(*(np.array([a]) for a in (0.0, 0.0, 0.5 * D, 1e-6, 0.5 * away[0], 0.5 * away[1])))
    law = Law.bouncing(0.4, 3e-5, 1e-6)
    wall = {} if side == "plate" else {side: D if side in ("right", "top") else -D}
    foot = {"foot": Plate(D, D), "foot_t": [0, 1], "foot_y": [D, D]} if side == "plate" else {}
    h = 1e-8
    m = integrate(d, law, Box(**wall), times=[0.0, 2e-3], dt=h, **foot)
    speed = -(m.vx[-1, 0] * away[0] + m.vy[-1, 0] * away[1])
    assert speed == pytest.approx(0.2, abs=0.5 * law.damping * h)
    push = m.foot_force if side == "plate" else m.wall_force
    assert push[-1] * 2e-3 == pytest.approx(1e-6 * 0.7 * -np.array(away), rel=1e-3, abs=1e-12)


def test_viscous_drag_is_exact_and_coulomb_drag_stops_where_it_must():
    d = row([0.0], [0.4])
    v = integrate(d, Law(1e3, viscous=50.0), Box(), times=[0.0, 0.02], dt=1e-3).vx[-1, 0]
    assert v == pytest.approx(0.4 * math.exp(-1.0), rel=1e-12)
    m = integrate(d, Law(1e3, coulomb=5.0), Box(), times=[0.0, 0.04, 0.2], dt=1e-4)
    assert m.vx[1, 0] == pytest.approx(0.4 - 5.0 * 0.04, rel=1e-12)
    assert m.x[-1, 0] == pytest.approx(0.4**2 / (2 * 5.0), abs=5.0 * 1e-4**2)  # v^2/2a, within the last step
    assert m.vx[-1, 0] == 0.0


def test_a_grain_pushed_by_less_than_its_friction_does_not_creep():
    m = integrate(row([0.0], [0.0]), Law(1e3, coulomb=5.0, gravity=4.99), Box(), times=[0.0, 0.1], dt=1e-4)
    assert m.y[-1, 0] == 0.0
    m = integrate(row([0.0], [0.0]), Law(1e3, coulomb=5.0, gravity=6.0), Box(), times=[0.0, 0.1], dt=1e-4)
    assert m.y[-1, 0] == pytest.approx(-0.5 * 1.0 * 0.1**2, rel=1e-9)


# -- many grains ------------------------------------------------------------------------------------------------------


def test_elastic_collisions_conserve_energy_and_momentum():
    """Kinetic energy between collisions; 60 steps a contact conserve it within (pi/60)^2/8 = 3e-4 a collision."""
    rng = np.random.default_rng(3)
    d = bed(0.4)
    d = replace(d, vx=rng.normal(0, 0.3, len(d.x)), vy=rng.normal(0, 0.3, len(d.x)))
    law = law_for(d, restitution=1.0)
    m = integrate(d, law, Box(), times=[0.0, 0.02, 0.2], dt=0.5 * time_step(d, law))
    px, py = (np.sum(d.mass * a, axis=1) for a in (m.vx, m.vy))
    scale = np.sum(d.mass * np.hypot(d.vx, d.vy))
    assert np.ptp(px) < 1e-12 * scale and np.ptp(py) < 1e-12 * scale
    energy = np.sum(d.mass * (m.vx**2 + m.vy**2), axis=1)
    turned = np.mean(np.hypot(m.vx[-1] - d.vx, m.vy[-1] - d.vy) > 1e-6)
    assert turned > 0.9  # nearly all have collided
    assert energy[-1] == pytest.approx(energy[0], rel=1e-3)


@pytest.mark.parametrize("foot", [Plate(0.004, 0.01), Block.row(0.004, 0.5 * D)], ids=["plate", "grains"])
def test_momentum_balance_with_foot_walls_gravity_and_drag(foot):
    """dP = J_foot + J_walls - M g T - c sum m dx, the last the exact impulse of viscous drag.

    The trapezoidal impulses and the drag's sum err by second order in h while contacts last and by one step's force at
    each opening and closing; bound: halving h must leave less than 1 % of the foot's impulse.
    """
    d = bed()
    law = law_for(d, viscous=30.0, gravity=2.0)
    t = np.linspace(0.0, 8e-3, 9)
    m = integrate(d, law, OPEN, times=t, dt=0.5 * time_step(d, law), foot=foot, foot_t=t, foot_y=-0.3 * t)
    dt = np.diff(t)[:, None]
    pushed = np.sum((m.foot_force + m.wall_force)[1:] * dt, axis=0)
    weight = np.array([0.0, -np.sum(d.mass) * law.gravity * t[-1]])
    drag = -law.viscous * np.array([np.sum(d.mass * (a[-1] - a[0])) for a in (m.x, m.y)])
    change = np.array([np.sum(d.mass * (a[-1] - a[0])) for a in (m.vx, m.vy)])
    foot_impulse = float(np.sum(m.foot_force[1:, 1] * dt[:, 0]))
    assert foot_impulse < 0.0
    assert pushed + weight + drag == pytest.approx(change, abs=0.01 * abs(foot_impulse))


def test_trajectories_converge_at_second_order_with_all_terms_on():
    """Discs pressed together, so that no contact opens; errors against a run of 16 times the steps."""
    n = 6
    i, j = np.divmod(np.arange(n * n), n)
    rng = np.random.default_rng(4)
    step = 0.97 * D  # 3 % overlap everywhere
    box = Box(-0.5 * n * step, 0.5 * n * step, -n * step, 0.0)
    d = Discs.at_rest((j + 0.5) * step + box.left, -(i + 0.5) * step, np.full(n * n, 0.5 * D), density=1.0)
    d = replace(d, mass=d.mass * rng.uniform(0.7, 1.3, n * n), vx=rng.normal(0, 0.01, n * n))
    law = law_for(d, restitution=0.7, viscous=2000.0, gravity=30.0)
    t = np.linspace(0.0, 1e-4, 21)
    foot = {"foot": Plate(1.0, 0.01), "foot_t": t, "foot_y": -3e-6 * np.sin(6e4 * t) ** 2}

    def end(steps):
        m = integrate(d, law, box, times=[0.0, 1e-4], dt=1e-4 / steps, **foot)
        return np.concatenate([m.x[-1] - d.x, m.y[-1] - d.y, 1e-5 * m.vx[-1], 1e-5 * m.vy[-1]])

    truth = end(64 * 40)
    errors = [np.linalg.norm(end(k * 40) - truth) for k in (1, 2, 4)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2.0) < 0.1), orders


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_the_result_is_the_same_bit_for_bit_in_any_number_of_threads(friction, monkeypatch):
    """Five bands, in one thread, in all there are, and in two runs at once that share them; and, within rounding, one
    band."""

    def run(_):
        out = []
        d = bed(seed=5)
        law = law_for(d, coulomb=5.0, friction=friction)
        t = np.linspace(0.0, 2e-3, 5)
        for foot in (Plate(0.004, 0.01), Block.row(0.004, 0.5 * D)):
            m = integrate(d, law, OPEN, times=t, dt=time_step(d, law), foot=foot, foot_t=t, foot_y=-0.3 * t)
            out += [m.x[-1], m.y[-1], m.vx[-1], m.vy[-1], m.spin[-1], m.foot_force[-1], m.friction_power[-1:]]
        return np.concatenate(out)

    whole = run(0)
    monkeypatch.setattr(motion, "BAND", len(bed(seed=5).x) // 5)
    with at_most(1):
        alone = run(0)
    assert alone == pytest.approx(whole, rel=1e-6, abs=1e-9)
    assert np.array_equal(run(0), alone)
    with ThreadPoolExecutor(2) as pool:
        for other in pool.map(run, range(2)):
            assert np.array_equal(other, alone)


def test_a_run_in_pieces_is_the_whole_run():
    """A piece starts with the true velocity where the run goes on with the foreseen one: less than the step's error."""
    d = bed()
    law = law_for(d, viscous=50.0)
    how = {"foot": Plate(0.004, 0.01), "foot_t": [0.0, 1e-3], "foot_y": [0.0, -3e-4]}
    h = time_step(d, law)
    whole, half = (integrate(d, law, OPEN, times=[0.0, 1e-3], dt=x, **how) for x in (h, 0.5 * h))
    first = integrate(d, law, OPEN, times=[0.0, 4e-4], dt=h, **how)
    second = integrate(first.last(d), law, OPEN, times=[4e-4, 1e-3], dt=h, **how)
    assert np.linalg.norm(second.x[-1] - whole.x[-1]) < 0.3 * np.linalg.norm(half.x[-1] - whole.x[-1])


def test_wrong_calls_say_what_is_wrong():
    d = row([0.0], [0.0])
    with pytest.raises(ValueError, match="mass must be finite and positive"):
        row([0.0], [0.0], mass=0.0)
    with pytest.raises(ValueError, match="stiffness = 0"):
        Law(0.0)
    with pytest.raises(ValueError, match="at or above the critical"):
        Law(1.0, 1e9).contact_time(1e-6)
    with pytest.raises(ValueError, match=r"known over 0\.\.1 s, asked is 0\.\.2 s"):
        integrate(d, Law(1.0), Box(), times=[0, 2], dt=1e-3, foot=Plate(1, 1), foot_t=[0, 1], foot_y=[0, 0])
    with pytest.raises(ValueError, match="increasing"):
        integrate(d, Law(1.0), Box(), times=[0, 0], dt=1e-3)


# -- beside LAMMPS ----------------------------------------------------------------------------------------------------


def test_forces_are_those_of_lammps(lammps_peer):
    rng = np.random.default_rng(6)
    d = bed(0.8)
    n = len(d.x)
    d = replace(d, radius=1.03 * d.radius, vx=rng.normal(0, 0.2, n), vy=rng.normal(0, 0.2, n))
    law = law_for(d)
    lmp = lammps_peer.start(d, law, BOX, dt=1e-6, skin=3e-4)
    lmp.command("run 0 post no")
    theirs = lammps_peer.by_id(lmp, "f", n)[:, :2]
    lmp.close()
    ours = forces(d, law, BOX)
    assert np.count_nonzero(np.any(theirs != 0.0, axis=1)) > 0.9 * n
    # LAMMPS shifts places by its box: eps * box/overlap = 2e-16 * 24/0.03, over a few contacts
    assert ours == pytest.approx(theirs, abs=1e-12 * np.abs(theirs).max())


def test_discs_lie_in_memory_by_rows_and_come_back_in_the_callers_order():
    d = bed()
    order, state, _, n = packed(d, None, 0.0, 0.0)
    assert n == len(d.x) and np.array_equal(np.sort(order), np.arange(n)) and np.array_equal(state[0], d.x[order])
    m = integrate(d, law_for(d), BOX, times=[0.0, 1e-9], dt=1e-9)
    assert m.x[-1] == pytest.approx(d.x, abs=1e-9)
