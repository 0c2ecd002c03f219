"""Pictures of a ball by area sampling; nothing shared with the disc model."""

import numpy as np
from scipy.ndimage import gaussian_filter

from jumpvision.films.vision.ball.film import track_ball
from jumpvision.films.vision.ball.track import BallTrack

BACK, CONTRAST, PSF = 30.0, 150.0, 0.6


def ball_image(shape, x, y, d, *, streak=(0.0, 0.0), shade=(0.0, 0.0), psf=PSF, ss=8):
    """(part of each pixel and exposure that is ball, the same weighted with the shading): a disc sampled ss x ss times
    a pixel, many positions along the streak, Gaussian blur on the fine grid, mean over the pixel."""
    m = int(d / 2 + 5 + max(abs(streak[0]), abs(streak[1])) / 2)
    x0, y0, n = round(x) - m, round(y) - m, 2 * m + 1
    g = (np.arange(n * ss) + 0.5) / ss - 0.5
    n_t = max(1, int(3 * np.hypot(*streak)))
    part, lit = np.zeros((n * ss, n * ss)), np.zeros((n * ss, n * ss))
    for t in (np.arange(n_t) + 0.5) / n_t - 0.5:
        dx, dy = (g + x0 - x - t * streak[0])[None, :], (g + y0 - y - t * streak[1])[:, None]
        inside = np.clip((d / 2 - np.hypot(dx, dy)) * ss + 0.5, 0.0, 1.0)
        part += inside / n_t
        lit += inside / n_t * (shade[0] * dx + shade[1] * dy) / (d / 2)
    out = []
    for fine in (part, lit):
        coarse = gaussian_filter(fine, psf * ss).reshape(n, ss, n, ss).mean((1, 3))
        image = np.zeros(shape)
        rows, columns = np.arange(max(0, y0), min(shape[0], y0 + n)), np.arange(max(0, x0), min(shape[1], x0 + n))
        if len(rows) and len(columns):
            image[np.ix_(rows, columns)] = coarse[np.ix_(rows - y0, columns - x0)]
        out.append(image)
    return out


def camera(image, noise, rng):
    return np.clip(np.rint(image + rng.normal(0.0, noise, image.shape)), 0, 255).astype(np.uint8)


def track(images, d, **kw) -> BallTrack:
    options = {
        "diameter": d,
        "polarity": "bright",
        "method": "disc",
        "search": 2.0,
        "seed": None,
        "streak": False,
        "exposure_fraction": 0.0,
    }
    return track_ball(images, **(options | kw))
