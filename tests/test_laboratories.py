"""Laboratories at fault (`worlds`): every fault changes what is recorded by what was meant."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from jumpvision.laboratory.jumper import Law
from tests.worlds import laboratories as worlds
from tests.worlds.faults import CASES, Entry, N, truth

FEW = (0, 1, 2)  # recordings that a quick test follows


def case(kind: str, ground: str = "granular", **changes):
    """The first truth of a kind on a ground, one trial, white noise, no log unless asked for."""
    every = (truth(i) for i in range(CASES))
    t = next(t for t in every if t.kind == kind and t.ground == ground and t.part in ("fault", "scatter"))
    return replace(t, **({"instrument": "white", "logged": False} | changes))


def films(t, size: float, which=FEW):
    """(recordings without noise without the fault, with it) of some shots."""
    t = replace(t, instrument="vibration")  # whose noise is added by `filmed` itself
    setting = worlds.setting_of(t, np.random.default_rng(1))
    clean = worlds.shots(setting)
    both = []
    with pytest.MonkeyPatch.context() as m:
        m.setattr(worlds, "NOISE", 0.0)
        for shots in (clean, worlds.put(t, clean, size)):
            lost = t if shots is not clean else replace(t, lost=())
            both.append([worlds.filmed(lost, setting, shots[i], i, np.random.default_rng(2)) for i in which])
    return both


def height(r) -> np.ndarray:
    y = r.track["height_m"]
    return y - y[r.track["time_s"] < 0.19].mean()


def test_the_own_command_is_the_laboratorys():
    law = Law(6.0, 0.01, math.pi / 2, 0.2, 1.0, 0.1)
    t = replace(case("play"), changes=None)
    setting = worlds.setting_of(t, np.random.default_rng(1))
    shot = replace(worlds.shots(setting)[0], law=law)
    motion = worlds.moved(setting, shot)
    assert np.max(np.abs(motion.motor - worlds.command(law)(motion.t))) < 1e-9


@pytest.mark.parametrize("slack", [0.0, 0.5])
def test_play_is_crossed_at_every_return(slack):
    law, width = Law(6.0, 0.01, 1.5 * math.pi, 0.2), 3e-4
    x = worlds.command(law)(0.2 + np.arange(3335) / worlds.PLAYED)
    y = worlds.played(law, width, slack).position[: x.size]
    behind = x - y
    assert behind.max() <= (1 - slack) * width + 1e-12 and behind.min() >= -slack * width - 1e-12
    assert np.ptp(behind) == pytest.approx(width)  # it went from one flank to the other
    still = np.diff(y) == 0.0
    assert np.all(np.isclose(behind[1:][~still], (1 - slack) * width) | np.isclose(behind[1:][~still], -slack * width))


def test_what_varies_by_day_label_or_frequency_varies_where_it_should():
    t = case("scale by day")
    clean = worlds.shots(worlds.setting_of(t, np.random.default_rng(1)))
    off = np.array([s.scale for s in worlds.put(t, clean, 0.04)]) - 1.0
    day = [c.session for c in t.known]
    assert set(np.abs(off[[d == "monday" for d in day]])) == {0.0}
    np.testing.assert_allclose(np.abs(off[[d == "tuesday" for d in day]]), 0.04)
    assert t.apart == {n for n, d in zip(t.names, day) if d == "tuesday"}

    t = case("weak motor")
    clean = worlds.shots(worlds.setting_of(t, np.random.default_rng(1)))
    got = {s.law.frequency: s.law.amplitude / s.jump.law.amplitude - 1.0 for s in worlds.put(t, clean, 0.04)}
    f = np.array(sorted(got))
    loss = np.array([got[x] for x in f])
    assert loss[0] == 0.0 and np.sum(loss < 0.0) >= 2
    np.testing.assert_allclose(np.diff(loss[loss < 0.0]), -0.04 * np.diff(f[loss < 0.0]))

    t = case("spring drift")
    setting = worlds.setting_of(t, np.random.default_rng(1))
    k = [s.robot.spring_stiffness + s.parameters["dk"] for s in worlds.put(t, worlds.shots(setting), 0.08)]
    np.testing.assert_allclose(np.array(k) / k[0], np.linspace(1.0, 0.92, N))


def test_a_scale_is_seen_as_a_scale_and_an_odd_drive_in_its_recording_only():
    t = replace(case("scale by day"), changes={"scale": (0.0, 1.0, 0.0) + (0.0,) * (N - 3)})
    before, after = films(t, 0.02)
    np.testing.assert_allclose(height(after[1]), 1.02 * height(before[1]), atol=1e-9)
    assert np.array_equal(height(after[0]), height(before[0]))

    t = replace(case("odd"), changes={"amplitude": (0.0, 1.0, 0.0) + (0.0,) * (N - 3)})
    before, after = films(t, 0.02)
    assert [np.ptp(height(a) - height(b)) > 1e-4 for a, b in zip(after, before)] == [False, True, False]


def test_lost_frames_make_what_follows_come_early():
    t = replace(case("lost frames"), lost=((1, 0.5, 2),))
    before, after = films(t, 0.0)
    y, z = height(before[1]), height(after[1])
    gap = int(np.flatnonzero(~np.isclose(y[: z.size], z, atol=1e-9))[0])
    assert z.size == y.size - 2 and before[1].track["time_s"][gap] > 0.2
    np.testing.assert_allclose(z[gap:], y[gap + 2 :], atol=1e-9)
    assert np.array_equal(after[1].track["time_s"], before[1].track["time_s"][:-2])


def test_exchanged_recordings_hold_each_others_motion():
    t = case("exchanged")
    (i, j), *_ = t.filed
    before, after = films(replace(t, filed=((i, j), (j, i))), 0.0, (i, j))
    np.testing.assert_allclose(height(after[0]), height(before[1]), atol=1e-9)
    np.testing.assert_allclose(height(after[1]), height(before[0]), atol=1e-9)
    assert after[0].jump == before[0].jump


def test_a_wrong_entry_changes_what_is_declared_not_what_happened():
    t = case("entry")
    setting = worlds.setting_of(t, np.random.default_rng(1))
    recorded, _ = films(replace(t, entry=None), 0.0, range(3))
    good = worlds.task_of(replace(t, entry=None), setting, recorded).jumps
    for quantity, factor in (
        ("motor_mass", 10.0),
        ("amplitude", 10.0),
        ("frequency", 2 * math.pi),
        ("frame_rate", 0.5),
    ):
        bad = worlds.task_of(replace(t, entry=Entry(1, quantity, factor)), setting, recorded).jumps
        a, b = good[1], bad[1]
        assert b.model.motor_mass / a.model.motor_mass == (10.0 if quantity == "motor_mass" else 1.0)
        assert np.ptp(b.t) / np.ptp(a.t) == pytest.approx(2.0 if quantity == "frame_rate" else 1.0)
        moved = [np.ptp(x.forcing(np.linspace(0, 1, 5000))[0]) for x in (a, b)]
        assert moved[1] / moved[0] == pytest.approx(10.0 if quantity == "amplitude" else 1.0, rel=1e-3)
        length = [x.forcing.stop - x.forcing.start for x in (a, b)]
        assert length[0] / length[1] == pytest.approx(2 * math.pi if quantity == "frequency" else 1.0)
        assert bad[0].name == "jump-01" and np.array_equal(bad[0].y, good[0].y)


def test_the_ringing_stand_has_the_noise_that_is_meant():
    e = worlds.ringing(200000, np.random.default_rng(1))
    assert e.std() == pytest.approx(1.0, abs=0.02)
    fresh = np.convolve(e, worlds.VIBRATION, "valid")
    assert fresh.std() == pytest.approx(worlds.fresh_share(worlds.VIBRATION), rel=0.02)
    assert abs(np.corrcoef(fresh[1:], fresh[:-1])[0, 1]) < 0.01


@pytest.mark.long
@pytest.mark.parametrize("kind", ["odd", "spring drift", "bed", "scale by day", "weak motor", "play", "label"])
def test_a_fault_of_size_f_lowers_chi2_by_30_f2(kind):
    """By the films at the fine step, at 3 times the detectable size, which is found to a tenth; the rest is not
    linear in the size."""
    t = case(kind)
    setting = worlds.setting_of(t, np.random.default_rng(1))
    ruler = worlds.Ruler.of(t, setting, worlds.shots(setting))
    before, after = films(t, 3.0 * worlds.detectable(ruler), range(N))
    pairs = zip(before, after, ruler.tracks)
    change = [worlds.whitened(t, (height(b) - height(a))[: y.size]) for a, b, y in pairs]
    assert ruler.rest(np.concatenate(change)) == pytest.approx(9.0 * worlds.THRESHOLD, rel=0.25)
