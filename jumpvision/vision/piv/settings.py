"""How image pairs are matched."""

from __future__ import annotations

from dataclasses import dataclass

from jumpvision.vision.piv.backend import backend

SMOOTHING = ("none", "adaptive")
TIMES = {"default": 3, "fast": 2}  # Gauss-Newton steps


@dataclass(frozen=True)
class Settings:
    """How a pair is matched; the keywords of `piv_pair` and `piv_film`. ValueError says what does not fit."""

    window: int  # px, side of the matched window (even sizes one more), under a Gaussian weight
    step: int  # px, distance of the vectors
    passes: tuple[int, ...]  # px, windows of the correlations that give other starts, large to small; the first must
    # exceed twice the largest displacement
    min_correlation: float  # matches below it are replaced
    min_texture: float  # grey, standard deviation below which a window is empty
    outlier: float  # limit of the normalised median test, about 2
    smooth: str = "none"  # or "adaptive": see `smooth`
    preset: str = "default"  # or "fast": spline on whole pixels, two steps
    backend: str = "numpy"  # or "cupy", "torch": where the correlations are computed

    def __post_init__(self) -> None:
        for name, value, low in (("window", self.window, 7), ("step", self.step, 1)):
            if value < low:
                raise ValueError(f"{name} = {value}: must be at least {low}")
        if not self.passes or min(self.passes) < 8:
            raise ValueError(
                f"passes = {self.passes}: must be window sizes of at least 8 px, large to small, as (64, 32)"
            )
        if self.smooth not in SMOOTHING:
            raise ValueError(f"smooth = {self.smooth!r}: must be one of {', '.join(SMOOTHING)}")
        if self.preset not in TIMES:
            raise ValueError(f"preset = {self.preset!r}: must be one of {', '.join(TIMES)}")
        backend(self.backend)
