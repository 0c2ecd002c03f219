"""Resistive forces on a body of any shape: closed forms, symmetries, the published plates, tables, STL files."""

import json
import math
import struct
import tomllib

import numpy as np
import pandas as pd
import pytest
from conftest import SAMPLES

from jumpvision.cli import main
from jumpvision.jumper.mechanisms.own import parameters_with, read_own
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.rft import Grains, cut, faces, generic_2d, generic_3d, of_plane, push
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.jumper.physics.shapes import box, cone, disc, read_stl, sphere, tilted, volume
from jumpvision.laboratory.jumper import Law, Robot, motion_of
from jumpvision.thesis.studies.sand.feet import plate_stress
from jumpvision.thesis.studies.sand.mantle import mantle_shares
from jumpvision.thesis.studies.study import Call, run

DOWN = (0.0, 0.0, -1.0)
PLANE = of_plane(generic_2d)


def around(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def plates(step=5):
    """Normals and directions over plate and motion [rad], in the plane y = 0."""
    b, g = np.meshgrid(*(np.radians(np.arange(-90, 90 + step, step)),) * 2, indexing="ij")
    n = np.stack([np.sin(b), 0 * b, -np.cos(b)], axis=-1).reshape(-1, 3)
    v = np.stack([np.cos(g), 0 * g, -np.sin(g)], axis=-1).reshape(-1, 3)
    return b.ravel(), g.ravel(), n, v


@pytest.mark.parametrize("law, level", [(PLANE, 1.0), (generic_3d, 0.87504)])
def test_a_disc_going_down_feels_scale_times_depth_times_area(law, level):
    """1.000 is the sum of Li's coefficients, 0.87504 of Agarwal's."""
    p = push(disc(0.03, 0.01) - [0.0, 0.0, 0.04], DOWN, grains=Grains(4e5, stress=law))
    assert p.force == pytest.approx([0.0, 0.0, level * 4e5 * 0.04 * math.pi * 0.03**2], rel=1e-9, abs=1e-9)
    assert p.torque == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_the_plates_of_li_are_those_published():
    """a_x, a_z of their Fourier sum at four plates, added up by hand from the coefficients."""
    for plate, motion, a_x, a_z in (
        (0, 90, 0.0, 1.0),
        (45, 90, 0.124 + 0.007 + 0.088, 0.206 + 0.358),
        (90, 0, 0.124 + 0.253 - 0.007, 0.206 - 0.169),
        (0, 0, -0.124 + 0.253 + 0.007, 0.206 + 0.169),
    ):
        found = generic_2d(np.radians(plate), np.radians(motion))
        assert [float(x) for x in found] == pytest.approx([a_x, a_z], abs=1e-12)
    b, g, n, v = plates()
    a = PLANE(n, v)
    x, z = generic_2d(b, g)
    assert -a[:, 0] == pytest.approx(x, abs=1e-12) and a[:, 2] == pytest.approx(z, abs=1e-12)
    assert np.abs(a[:, 1]).max() < 1e-12


def test_three_dimensions_are_two_where_the_motion_is_in_the_plane():
    """Two fits to plates in two media: 0.07 and 0.12 rms (of 1), correlated 0.8 and 0.9: no tighter than that."""
    b, g, n, v = plates()
    x, z = generic_2d(b, g)
    a = generic_3d(n, v)
    for ours, theirs, rms, alike in ((-a[:, 0], x, 0.09, 0.8), (a[:, 2], z, 0.14, 0.9)):
        assert np.sqrt(np.mean((ours - theirs) ** 2)) < rms
        assert np.corrcoef(ours, theirs)[0, 1] > alike


@pytest.mark.parametrize("law", [PLANE, generic_3d])
def test_forces_turn_with_the_body_and_are_mirrored_with_it(law):
    body = cut(tilted(box(0.04, 0.02, 0.01), 0.4), 0.003) - [0.01, 0.0, 0.05]
    grains, v, w = Grains(4e5, 0.3, 600.0, 1.1, stress=law), np.array([0.3, 0.2, -0.5]), np.array([0.5, -1.0, 2.0])
    p = push(body, v, w, grains=grains)
    turn = around(0.7)
    q = push(body @ turn.T, turn @ v, turn @ w, grains=grains)
    assert q.force == pytest.approx(turn @ p.force) and q.torque == pytest.approx(turn @ p.torque)
    mirror = np.array([1.0, -1.0, 1.0])
    m = push((body * mirror)[:, ::-1], v * mirror, -w * mirror, grains=grains)
    assert m.force == pytest.approx(p.force * mirror) and m.torque == pytest.approx(-p.torque * mirror)
    assert float(p.force @ v + p.torque @ w) < 0.0  # grains take energy


def test_a_cone_half_in_the_grains_is_the_integral_over_its_mantle():
    """F = scale a_z int depth dA over the wet mantle, rings of 2 pi r slant ds: pi r slant h^2 / 3."""
    R, H, h = 0.03, 0.03 * math.sqrt(3.0), 0.02
    p = push(cut(cone(R, H), 2e-4 * 10) - [0.0, 0.0, h], DOWN, grains=Grains(4e5, friction=9.0, stress=PLANE))
    a_z = float(generic_2d(math.pi / 3, math.pi / 2)[1])
    r, slant = h * R / H, math.hypot(R, H) / H
    wet = math.pi * r * slant * h * h / 3.0  # int of 2 pi r(s) (h - s) slant ds over the wet part
    assert p.force[2] == pytest.approx(4e5 * a_z * wet, rel=0.01)


def test_friction_inertia_rise_and_spin():
    body = disc(0.03, 0.01)
    quiet = push(body - [0, 0, 0.04], (0.1, 0.0, -0.1), grains=Grains(4e5, friction=0.0))
    normal = faces(body)[1]
    assert np.abs(np.cross(quiet.traction, normal)).max() < 1e-9 * np.abs(quiet.traction).max()  # no tangential part
    slow, fast = (push(body - [0, 0, 0.04], (0, 0, -1.5), grains=Grains(4e5, density=600, inertia=i)) for i in (0, 1.1))
    assert fast.force[2] - slow.force[2] == pytest.approx(1.1 * 600 * 1.5**2 * math.pi * 0.03**2)
    risen = push(body - [0, 0, 0.03], DOWN, grains=Grains(4e5, rise=0.01))
    assert risen.force[2] == pytest.approx(push(body - [0, 0, 0.04], DOWN, grains=Grains(4e5)).force[2])
    above = push(body - [0, 0, -0.001], DOWN, grains=Grains(4e5))
    assert not above.force.any() and not above.torque.any()
    rocking = push(cut(body, 0.002) - [0, 0, 0.04], (0, 0, 0), (0.0, 1.0, 0.0), grains=Grains(4e5))
    assert rocking.torque[1] < 0.0 and abs(rocking.torque[0]) < 1e-3 * abs(rocking.torque[1])


@pytest.mark.parametrize("body, true", [
    (box(0.02, 0.03, 0.04), 2.4e-5), (disc(0.03, 0.01), math.pi * 0.03**2 * 0.01),
    (cone(0.03, 0.05), math.pi * 0.03**2 * 0.05 / 3), (sphere(0.03), 4 / 3 * math.pi * 0.03**3),
])  # fmt: skip
def test_primitives_and_their_cuts_hold_what_they_hold(body, true):
    assert volume(body) == pytest.approx(true, rel=2e-3)
    fine = cut(body, 0.004)
    assert volume(fine) == pytest.approx(volume(body), rel=1e-9)
    assert faces(fine)[2].sum() == pytest.approx(faces(body)[2].sum(), rel=1e-9)
    assert np.linalg.norm(fine - np.roll(fine, -1, axis=1), axis=2).max() <= 0.004
    assert body[..., 2].min() == pytest.approx(0.0, abs=1e-15)


def stl(triangles, *, text):
    if text:
        facets = ["facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in t)
                  + "endloop\nendfacet\n" for t in triangles]  # fmt: skip
        return ("solid foot\n" + "".join(facets) + "endsolid foot\n").encode()
    head = b"made by a test".ljust(80) + struct.pack("<I", len(triangles))
    return head + b"".join(struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0) for t in triangles)


@pytest.mark.parametrize("text", [True, False])
def test_stl_files_of_both_kinds_are_read_inside_out_too(tmp_path, text):
    body = cone(0.03, 0.05)
    for name, corners in (("right", body), ("inside-out", body[:, ::-1])):
        file = tmp_path / f"{name}.stl"
        file.write_bytes(stl(1e3 * corners, text=text))
        read = read_stl(file, 1e-3)
        assert volume(read) == pytest.approx(volume(body), rel=1e-5)
        assert np.sort(read.reshape(-1, 3), axis=0) == pytest.approx(np.sort(body.reshape(-1, 3), axis=0), abs=1e-7)


@pytest.mark.parametrize(
    "content, words",
    [
        (stl(cone(3.0, 5.0), text=False)[:-20], ("no whole STL", "export it again")),
        (b"PK not an stl" * 30, ("no whole STL",)),
        (stl(cone(3.0, 5.0)[:40], text=True), ("enclose no volume", "close it")),
        (stl(cone(3.0, 5.0), text=True).replace(b"vertex 3", b"vertex x", 1), ("vertex",)),
    ],
)
def test_a_damaged_stl_is_one_clear_error(tmp_path, capsys, content, words):
    file = tmp_path / "foot.stl"
    file.write_bytes(content)
    assert main(["rft", "--stl", str(file), "--results", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert all(w in said for w in ("foot.stl", *words)), said
    assert not (tmp_path / "r").exists()


def table_of(step=10):
    b, g, _, _ = plates(step)
    x, z = generic_2d(b, g)
    named = {"plate [deg]": np.degrees(b), "motion [deg]": np.degrees(g)}
    return pd.DataFrame(named | {"alpha_x [N/cm^3]": 0.46 * x, "alpha_z [N/cm^3]": 0.46 * z})


def test_a_table_of_stresses_gives_what_its_law_gives(tmp_path):
    """Ten degrees apart: linear between, off by h^2/8 of the curvature, 0.8 % of the scale at most."""
    table_of().sample(frac=1.0, random_state=0).to_csv(tmp_path / "t.csv", index=False)
    args = ["rft", "--shape", "cone", "--height", "0.05", "--attack", "30:90:3", "--tilt", "0:20:2", "--no-pictures"]
    found = {}
    for name, more in (("table", ["--table", str(tmp_path / "t.csv")]), ("law", ["--law", "2d", "--scale", "4.6e5"])):
        assert main([*args, *more, "--depth", "0:0.06:4", "--results", str(tmp_path / name)]) == 0
        found[name] = pd.read_csv(tmp_path / name / "rft.csv")
    forces = [f"F{k}_N" for k in "xyz"]
    top = np.abs(found["law"][forces]).to_numpy().max()
    assert np.abs(found["table"][forces] - found["law"][forces]).to_numpy().max() < 0.02 * top
    told = [json.loads((tmp_path / n / "rft.json").read_text()) for n in found]
    sigma = [t["numbers"]["sigma_cone_N_m3"] for t in told]
    assert sigma[1] == pytest.approx(4.6e5 * 0.346, rel=2e-3)
    assert sigma[0] == pytest.approx(sigma[1], rel=0.02)
    assert list(told[0]["inputs"]) == [str(tmp_path / "t.csv")] and told[0]["versions"]["jumpvision"]


@pytest.mark.parametrize(
    "change, words",
    [
        (lambda d: d.rename(columns={"alpha_z [N/cm^3]": "alpha_z"}), ("alpha_z", "unit", "N/cm^3")),
        (lambda d: d.drop(columns="motion [deg]"), ("motion", "missing", "[deg]")),
        (lambda d: d[1:], ("every pair is needed once", "0 times")),
        (lambda d: pd.concat([d, d[:1]]), ("2 times",)),
        (lambda d: d.assign(**{"plate [deg]": 2 * d["plate [deg]"]}), ("plate", "90 degrees")),
        (lambda d: d.assign(**{"alpha_x [N/cm^3]": np.nan}), ("alpha_x", "row 1", "finite")),
    ],
)
def test_a_bad_table_is_one_clear_error(tmp_path, capsys, change, words):
    change(table_of()).to_csv(tmp_path / "t.csv", index=False)
    assert main(["rft", "--table", str(tmp_path / "t.csv"), "--results", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert all(w in said for w in ("t.csv", *words)), said
    assert not (tmp_path / "r").exists()


def test_the_command_draws_the_foot(tmp_path):
    (tmp_path / "foot.stl").write_bytes(stl(1e3 * sphere(0.02), text=False))
    args = ["rft", "--stl", str(tmp_path / "foot.stl"), "--depth", "0:0.03:4", "--tilt", "0:20:2"]
    assert main([*args, "--results", str(tmp_path / "r")]) == 0
    assert (tmp_path / "r" / "rft.png").stat().st_size > 10_000
    d = pd.read_csv(tmp_path / "r" / "rft.csv")
    assert len(d) == 8 and d.Fz_N[d.depth_m == 0.0].abs().max() < 1e-9
    level, tilt = (d.Fz_N[(d.tilt_deg == t) & (d.depth_m == 0.03)].item() for t in (0.0, 20.0))
    assert tilt == pytest.approx(level, rel=0.01)  # a sphere has no tilt


# -- the foot as the ground of a jumper ------------------------------------------------------------------------------
ROBOT = {
    "motor_mass": 1.125, "rod_mass": 0.175, "foot_mass": 0.04, "spring_stiffness": 3300.0, "spring_damping": 1.2,
    "gravity": 9.81, "foot_radius": 0.0381,
}  # fmt: skip


def on_foot(folder, *words):
    """The model of the robot on the foot of `jumpvision rft WORDS`, and the values of its law."""
    asked = ["rft", *words, "--depth", "0:0.06:3", "--results", str(folder), "--no-pictures", "--workers", "1"]
    assert main(asked) == 0
    table = tomllib.loads((folder / "model.toml").read_text())
    own, problems = read_own(table["mechanism"], "model.toml [mechanism]")
    assert problems == []
    values = {n: v for n, v in table["model"].items() if n != "terms"}
    laws = tuple(own.values())
    return Model("granular", tuple(table["model"]["terms"]), parameters_with(laws)(**values), own=laws, **ROBOT)


def test_a_cone_as_ground_law_is_the_integral_over_its_mantle(tmp_path):
    """sigma_z of the mantle times the integral of depth over it, to 1 % of the force at the cone's height."""
    height, radius = 0.066, 0.0381
    m = on_foot(tmp_path, "--shape", "cone", "--height", str(height), "--inertia", "0", "--scale", "4e5")
    law, t = m.acting(Body.STATIC)[0], math.atan2(height, radius)
    for z in (0.01, 0.03, 0.06, 0.066, 0.1):
        h = (np.arange(20000) + 0.5) / 20000 * min(z, height)  # of rings of the mantle above the tip
        ring = 2.0 * math.pi * (h / math.tan(t)) / math.sin(t) * (h[1] - h[0])
        force = plate_stress(Grains(4e5), t) * float(np.sum(ring * (z - h)))
        full = plate_stress(Grains(4e5), t) * math.pi * radius * math.hypot(radius, height) * height / 3.0
        assert m.force(law, z=z) == pytest.approx(force, abs=0.01 * full), z


def test_a_flat_foot_jumps_as_on_a_linear_ground_by_the_laboratory_s_own_integrator(tmp_path):
    """RFT of a level disc is k z, k = 0.87504 scale pi R^2, its drag inertia density pi R^2 v^2; heights to 0.1 mm."""
    m = on_foot(tmp_path)
    k, alpha = 0.87504 * 4.6e5 * math.pi * 0.0381**2, 1.1 * 570.0 * math.pi * 0.0381**2
    assert m.parameters.alpha == pytest.approx(alpha, rel=1e-6)
    for f, phase in ((6.0, 1.5 * math.pi), (5.0, 0.5 * math.pi)):
        ours = simulate(m, sinusoid(f, 0.01875, phase), t=[0.0, 0.8], rtol=1e-8, atol=1e-11).jump_height
        robot = Robot(**ROBOT)
        truth = motion_of(
            robot, Law(f, 0.01875, phase, 0.0), ["linear_penetration", "inertial_drag"], {"k": k, "alpha": alpha},
            ground="granular", duration=0.8, dt=2e-6, every=50,
        )  # fmt: skip
        assert ours == pytest.approx(truth.jump_height, abs=1e-4)


def test_simulate_sweep_and_plan_take_any_foot(tmp_path):
    """A tilted box goes through all three; the plan's apex is that of the events' own simulation."""
    pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")
    on_foot(tmp_path / "foot", "--shape", "box", "--tilt", "20")
    model = str(tmp_path / "foot" / "model.toml")
    asked = ["sweep", "granular", "--frequency", "6", "--phase", "4.712", "--model", model, "--no-pictures"]
    assert main([*asked, "--results", str(tmp_path / "sweep"), "--workers", "1"]) == 0
    assert (
        main(["plan", "--apex", "0.03", "--ground", "granular", "--model", model, "--results", str(tmp_path / "p")])
        == 0
    )
    told = json.loads((tmp_path / "p" / "plan.json").read_text())
    assert told["status"] == "solved" and told["resimulated_apex_m"] == pytest.approx(0.03, abs=1e-4)
    sample = SAMPLES / "loose_sand" / "stutter-5.0Hz-1"
    assert main(["simulate", str(sample), "--model", model, "--results", str(tmp_path / "s"), "--no-pictures"]) == 0
    assert (tmp_path / "s" / "simulation.csv").exists()


def test_k2_predicted_from_published_stresses():
    """By hand from Li's coefficients at 60 degrees: (0.206 - 0.169/2 - 0.212/2 + 0.358 - 0.055/2) / cos 60 = 0.692."""
    shares = mantle_shares()
    assert shares["Li et al. 2013"][1] == pytest.approx(0.692, abs=1e-6)
    data, rows = run(Call("granular", {"phi": "0.57:0.63:3"}, "mantle", say=lambda text: None))
    area = math.pi * 0.0381**2
    np.testing.assert_allclose(data.k2_per_area.sel(k2="own") * area, [2100.0, 3300.0, 4500.0], rtol=1e-9)
    assert (data.k2_per_area.sel(k2="least") < data.k2_per_area.sel(k2="greatest")).all()
    h = data.jump_height_m.sel(phi=0.57)
    assert h.sel(k2="least") < h.sel(k2="mean") < h.sel(k2="greatest") and len(rows) == 4
