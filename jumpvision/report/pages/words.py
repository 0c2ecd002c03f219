"""The first screen of a page in words, and pictures and films inside it as data."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Image, measured
from jumpvision.base.numbers import between, format_count, said, times
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.values import Noise
from jumpvision.estimate.crater import ZeroCrossing
from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.experiment.results.summary import JumpRow, Summary
from jumpvision.experiment.results.values import Fits

from .quantities import HALF, WHOLE

Numbers = list[tuple[str, str, str]]  # value, unit, what it is


def campaign_words(
    rows: Sequence[JumpRow], diagnosis: Diagnosis | None, craters: ZeroCrossing | None, intruded: int
) -> tuple[str, Numbers]:
    """(sentence, numbers) of a campaign; the diagnosis' sentence where there is one."""
    jumped = [r for r in rows if math.isfinite(r.summary.jump_height.numbers[0])]
    h, s, _ = np.reshape([r.summary.jump_height.numbers for r in jumped], (-1, 3)).T * 1e3
    model = np.array([r.summary.simulated_height for r in jumped], float) * 1e3
    if diagnosis:
        facts = [(said(diagnosis.baseline.rmse_height_m, factor=1e3), "mm", "error of the simulated heights, rms")]
        if g := diagnosis.gain:
            what = "smaller track error on jumps held out, with the extended model"
            facts.append((times(g.ratio, mark="×"), "", what + between(*g.ratio_ci95)))
        else:
            facts.append((probability(diagnosis.p_value), "", "probability of such residuals by noise alone"))
        noise = f"tested, noise {said(diagnosis.noise.sigma_m, '.2g', 1e3)} mm a frame"
        facts.append((str(len(diagnosis.heights)), "jumps", noise))
        return diagnosis.sentence, facts
    if jumped:
        heights = " to ".join(dict.fromkeys(f"{x:.3g}" for x in (h.min(), h.max())))
        text = f"{format_count(len(jumped), 'jump')}, {heights} mm high"
        facts = [(f"{h.max():.4g}", "mm", f"highest jump: {jumped[int(h.argmax())].experiment}")]
        if np.isfinite(s).any():
            facts.append((f"{np.nanmedian(s):.2g}", "mm", "median standard uncertainty of a height"))
        if np.isfinite(model).any():
            off = float(np.nanmean(model - h))
            text += f"; the model is {abs(off):.2g} mm {'higher' if off > 0 else 'lower'} on average"
            facts.append((f"{np.sqrt(np.nanmean((model - h) ** 2)):.3g}", "mm", "model against measured, rms"))
        return text + ".", facts
    if craters is not None and craters.value is not None and np.isfinite(craters.value):
        value = measured(craters.value, craters.sigma)
        return f"Craters neither swell nor shrink at a volume fraction of {value}.", [
            (value, "", "critical packing φ_c")
        ]
    done = sum(not r.problem for r in rows)
    what = format_count(intruded, "slow intrusion") if intruded else format_count(done, "experiment")
    return f"{what} analysed.", []


def noise_words(noise: Noise) -> str:
    """What is known of the noise of a frame, and from which sources."""
    sources = "; ".join(
        f"{SOURCES[k]} {measured(s.sigma_m, s.sigma_m * s.log_sigma, 1e3)} mm (n = {s.n})"
        for k, s in noise.sources.items()
        if s
    )
    return f"Noise: {said(noise.sigma_m, factor=1e3)} mm a frame" + (f"; {sources}." if sources else ".")


SOURCES = {"stated": "stated", "rest": "at rest", "flight": "in flight", "repeats": "between repeats"}


def experiment_words(
    kind: Actuation | None, summary: Summary, fits: Fits, *, whole: bool = False
) -> tuple[str, Numbers]:
    """(sentence, numbers) of one experiment. kind: its [actuation], or None; whole: the film shows a whole foot."""
    (h, sigma, _), model = summary.jump_height, summary.simulated_height
    facts: Numbers = []
    text = ""
    if h is not None:
        height = measured(h, sigma, 1e3)
        what = f"{kind.kind.replace('_', ' ')} jump" if kind is not None and kind.moves else "jump"
        at = f" at {kind.frequency:g} Hz" if kind is not None and kind.frequency else ""
        text = f"A {what}{at} rose {height} mm"
        facts.append((height, "mm", "jump height above rest, measured"))
        if model is not None:
            off = 1e3 * (model - h)
            same = sigma is not None and abs(model - h) <= 2.0 * sigma
            far = f"{abs(off):.3g} mm too {'high' if off > 0 else 'low'}"
            text += f"; the model says {1e3 * model:.4g} mm, {'the same within 2σ' if same else far}"
            gap = measured(model - h, sigma, 1e3) if same else f"{off:+.3g}"
            facts.append((gap.replace("-", "−"), "mm", "model − measured"))
        text += "."
    for name, label, unit, factor in OTHERS:
        if fit := fits.determined(name):
            twice = f"{HALF}; the whole foot moves twice as much, {2.0 * fit.value * factor:.3g} {unit}"
            foot = f" ({WHOLE if whole else twice})" if name == "added_mass_kg" else ""
            facts.append((measured(fit.value, fit.sigma, factor), unit, label + foot))
    if (phi := summary.volume_fraction).value is not None:
        facts.append((measured(phi.value, phi.sigma), "", "volume fraction φ of the bed"))
    if not text and facts:
        value, unit, label = facts[0]
        text = f"{label[0].upper()}{label[1:]}: {value} {unit}".rstrip() + "."
    return text, facts[:3]


OTHERS = (  # name in fits.json or intrusion.json, what it is, unit, factor
    ("added_mass_kg", "grains that move with the foot, at most", "g", 1e3),
    ("mu", "μ, growth of the jammed front with depth", "", 1.0),
    ("k1", "k₁, resistance to the bend", "N/m", 1.0),
    ("k2", "k₂, below the bend", "N/m", 1.0),
    ("delta", "δ, depth of the bend", "mm", 1e3),
    ("volume_m3", "volume change of the crater", "cm³", 1e6),
    ("frequency_hz", "ring-down frequency", "Hz", 1.0),
    ("zeta", "damping ratio ζ", "", 1.0),
)


def probability(p: float) -> str:
    """0.034, or < 0.0001."""
    return "< 0.0001" if p < 1e-4 else said(p, ".2g")


PREVIEW = 640  # px wide


def inline(data: bytes, kind: str = "image/png") -> str:
    """A file as a data address."""
    return f"data:{kind};base64," + base64.b64encode(data).decode()


def film(file: Path) -> str:
    """Source of a film: inside the page, or the file's name where it is longer than a page should hold."""
    # the films made here stay under 3 MB
    return inline(file.read_bytes(), "video/webm") if file.stat().st_size <= 6_000_000 else file.name


def poster(file: Path) -> str:
    """What a film shows before it is played, and in print: its most colourful frame, where most is drawn over it."""
    import av
    import numpy as np

    best, most = None, -1.0
    with av.open(file) as film:
        for frame in film.decode(video=0):
            picture = frame.to_ndarray(format="bgr24")
            colour = float(np.ptp(picture[::4, ::4].astype(np.int16), axis=2).mean())
            if colour > most:
                best, most = picture, colour
    return small(best) if best is not None else ""


def preview(file: Path) -> str:
    """A picture made small."""
    import cv2
    import numpy as np

    picture = cv2.imdecode(np.frombuffer(file.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise ValueError(f"{file}: not a picture")
    return small(picture)


def small(picture: Image) -> str:
    """A picture (row, column, BGR) as WebP."""
    import cv2

    height = round(picture.shape[0] * PREVIEW / picture.shape[1])
    made = cv2.resize(picture, (PREVIEW, height), interpolation=cv2.INTER_AREA)
    return inline(cv2.imencode(".webp", made, [cv2.IMWRITE_WEBP_QUALITY, 82])[1].tobytes(), "image/webp")
