"""Derivatives that a user's function brings itself: used where differences agree, refused where they do not."""

from __future__ import annotations

import numpy as np
import pytest
from test_study_door import SIGMA, falls

import jumpvision as jv
from jumpvision.base.schema import InputError


def fall(p, r):
    return 0.5 * p["g"] * r.t**2 - p["c"] * r.t**3


def slopes(p, r):
    return {"g": 0.5 * r.t**2, "c": -(r.t**3)}


def wrong(p, r):
    return {"g": 0.4 * r.t**2, "c": -(r.t**3)}


def asked(simulate=fall, **more):
    drag = jv.Mechanism("drag", [jv.Parameter("c", 0.0, (-5, 5))], "the drag of the air")
    return jv.Study(
        simulate, [jv.Parameter("g", 9.8, (9, 11))], [drag], [jv.Channel("y", "m", noise=SIGMA, consider=())], **more
    )


def test_own_derivatives_take_the_place_of_differences():
    """The model is linear in both parameters: the same fit to rounding, from fewer runs."""
    recordings = falls(3, c=1.0)
    plain, own = jv.diagnose(recordings, asked()), jv.diagnose(recordings, asked(jacobian=slopes))
    assert own.named == plain.named == ("drag",) and not own.doubts and own.runs.made < plain.runs.made
    for n, x in own.fitted.items():
        assert x.value == pytest.approx(plain.fitted[n].value, abs=1e-3 * x.sigma)
        assert x.sigma == pytest.approx(plain.fitted[n].sigma, rel=1e-4)


def test_an_attribute_of_the_function_and_other_processes_do_as_well():
    recordings = falls(3, c=1.0)
    own = jv.diagnose(recordings, asked(jacobian=slopes))
    fall.jacobian = slopes
    try:
        assert jv.diagnose(recordings, asked()).runs.made == own.runs.made
    finally:
        del fall.jacobian
    there = jv.diagnose(recordings, asked(jacobian=slopes), workers=1)
    assert there.runs.made == own.runs.made and there.sentence == own.sentence


def test_a_wrong_derivative_is_said_with_its_place_and_not_used():
    """0.4 t^2 for 0.5 t^2: farthest apart at the end of the record, 0.395 s."""
    recordings = falls(3, c=1.0)
    found = jv.diagnose(recordings, asked(jacobian=wrong))
    (doubt,) = found.doubts
    assert doubt.kind == "wrong jacobian" and doubt.names == ("g",)
    end = recordings[0].t[-1] ** 2
    said = f"by 'g' is {0.4 * end:.4g}, a difference's {0.5 * end:.4g} (recording 'fall 0', t = 0.395 s, y)"
    assert said in doubt.words and doubt.words[4:] in found.sentence
    plain = jv.diagnose(recordings, asked())
    assert found.fitted["g"].value == pytest.approx(plain.fitted["g"].value, abs=1e-3 * plain.fitted["g"].sigma)


def test_what_cannot_have_derivatives_or_has_another_shape_is_refused():
    with pytest.raises(InputError, match="jacobian: it knows no laws"):
        asked(jacobian=slopes, symbols={"v": 1.0})
    with pytest.raises(InputError, match="jacobian of 'g' of shape"):
        jv.diagnose(falls(3), asked(jacobian=lambda p, r: {"g": np.zeros(3)}))


def test_a_jax_function_is_differentiated_by_jax():
    jax = pytest.importorskip("jax", reason="jax is not installed")
    jax.config.update("jax_enable_x64", True)

    def traced(p, r):
        t = jax.numpy.asarray(r.t)
        return 0.5 * p["g"] * t**2 - p["c"] * t**3

    def leaves(p, r):
        return jax.numpy.asarray(0.5 * float(p["g"]) * r.t**2 - float(p["c"]) * r.t**3)

    recordings = falls(3, c=1.0)
    plain, own = jv.diagnose(recordings, asked()), jv.diagnose(recordings, asked(traced))
    assert own.named == ("drag",) and own.runs.made < plain.runs.made and not own.doubts
    assert own.fitted["c"].value == pytest.approx(plain.fitted["c"].value, abs=1e-3 * plain.fitted["c"].sigma)
    assert jv.diagnose(recordings, asked(leaves)).runs.made == plain.runs.made  # what JAX cannot follow
