"""The sums of the disc fit against plain numpy; how a fit is reached does not show in its result."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.films.vision.ball import disc
from tests.worlds.ball_pictures import BACK, CONTRAST, ball_image

NOISE = np.array([4.0, 4.0, 0.0])


def test_the_way_to_a_fit_does_not_show_in_it():
    """A large ball from 3 px off, by every fourth row at first, and from its own answer: a fit ends within 0.1 sigma
    of rest and the next step is some tenth of the last, so two of them differ by 0.1 sigma at most."""
    rng = np.random.default_rng(2)
    part = ball_image((100, 100), 49.7, 50.2, 66.0, ss=8)[0]
    image = BACK + CONTRAST * part + rng.normal(0.0, 2.0, part.shape)
    start = np.array([52.0, 47.5, 31.5, 1.2, BACK, BACK + CONTRAST, 0, 0, 0, 0, 0, 0])
    prior = {"noise": NOISE, "mean": start, "var": np.full(12, np.inf)}
    far = disc.fit_disc(image, start, streak=False, **prior)
    near = disc.fit_disc(image, far.p, streak=False, **prior)
    sigma = np.sqrt(np.diag(far.cov)[:3])
    assert far.converged and near.converged
    assert np.all(np.abs(far.p[:3] - near.p[:3]) < 0.1 * sigma)
    assert np.all(np.abs(far.p[:2] - (49.7, 50.2)) < 4.0 * sigma[:2])
    assert far.cov[:3, :3] == pytest.approx(near.cov[:3, :3], rel=0.01)


def test_the_noise_of_a_fit_is_that_of_its_pixels():
    """A fit takes its parameters out of what is left: the variance per freedom is that of the noise. Well inside a ball
    of 12 px lie some 20 pixels, whose level and gradient take up to three freedoms (the edge tells of them too): the
    mean of 1,000 frames is the noise or up to a fifth above it, to four times sqrt(2 / 20,000); it would be a tenth
    below it if no freedom were taken."""
    rng, found = np.random.default_rng(4), []
    for _ in range(1000):
        x, y = 14.0 + rng.uniform(-0.5, 0.5, 2)
        image = BACK + CONTRAST * ball_image((29, 30), x, y, 12.0, ss=4)[0]
        image += rng.normal(0.0, 2.0, image.shape)
        start = np.array([x, y, 6.0, 0.75, BACK, BACK + CONTRAST, 0, 0, 0, 0, 0, 0])
        fit = disc.fit_disc(image, start, streak=False, noise=NOISE, mean=start, var=np.full(12, np.inf))
        found.append(fit.noise[:2] / 4.0)
    assert np.all(np.mean(found, axis=0) > 1.0 - 0.04) and np.all(np.mean(found, axis=0) < 1.2 + 0.04)
