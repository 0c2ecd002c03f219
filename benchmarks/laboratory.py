"""The virtual laboratory: processor time of one core for grain films, rod films and blind campaigns."""

from __future__ import annotations

import math
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from jumpvision.laboratory import blind
from jumpvision.laboratory.campaign import jump_of, write_campaign
from jumpvision.laboratory.dem.motion import discs_under_foot
from jumpvision.laboratory.films.flow import Flow
from jumpvision.laboratory.films.grains import GrainScene, QuickGrainScene, View
from jumpvision.laboratory.films.optics import Camera, record, record_bright
from jumpvision.laboratory.films.rod import write_rod_film
from jumpvision.laboratory.protocol_keys import RodFilm


def grain_rate(quick: bool, *, frames: int = 30) -> float:
    """Frames of 512 x 512 px a second of processor time, foot at 0.5 m/s, noise included."""
    view = View((512, 512), 3e-4, 47.0, 255.5)
    flow = Flow(0.0381, 2.0, math.pi / 3, 2.7, math.radians(45.0), 0.008, (0.006, 0.05))
    rng = np.random.default_rng(1)
    kind, expose = (QuickGrainScene, record_bright) if quick else (GrainScene, record)
    camera = kind(view, flow, 0.006, diameter=0.001, spread=0.15, rng=rng)
    camera.frame(np.array([0.0061]))
    began = time.process_time()
    for i in range(frames):
        depths = 0.0062 + 1e-3 * i + 0.25e-3 * (np.arange(4) + 0.5) / 4
        expose(camera.frame(depths), electrons_per_grey=60.0, read_noise=1.0, rng=rng)
    return frames / (time.process_time() - began)


def campaign_seconds(ground: str) -> float:
    """Seconds of processor time for 24 jumps as tracks and motor logs."""
    rng = np.random.default_rng(2)
    setting = blind.draw(rng, ground=ground, hidden=())
    blind.campaign(setting, rng)
    began = time.process_time()
    blind.campaign(setting, rng)
    return time.process_time() - began


def film_seconds() -> float:
    """Seconds of processor time for one jump of 1.8 s with its rod film, written."""
    rng = np.random.default_rng(3)
    protocol = blind.draw(rng, hidden=()).protocol
    with TemporaryDirectory() as folder:
        for name in "ab":
            began = time.process_time()
            motion, _, _ = jump_of(protocol, protocol.jumps[0], rng)
            (Path(folder) / name).mkdir()
            write_rod_film(Path(folder) / name, motion, RodFilm(file="rod.mkv"), Camera(), rng)
            seconds = time.process_time() - began
    return seconds


PROTOCOL = """
duration = 1.2
[robot]
motor_mass = 1.125
rod_mass = 0.175
foot_mass = 0.04
spring_stiffness = 3300.0
spring_damping = 1.2
[truth]
terms = ["two_resistance", "inertial_drag"]
k1 = 2100.0
k2 = 2100.0
delta = 0.012
alpha = 73.0
[[jumps]]
kind = "stutter"
frequency = [6.0, 7.0]
[record]
rod_film = {}
motor_log = {}
contact_log = {}
bed_image = {}
"""


def protocol_seconds(grain_film: str) -> float:
    """Seconds of processor time for an experiment of a protocol with all its films, the mean of two, on one core."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "two.toml"
        file.write_text(PROTOCOL + f"grain_film = {{ {grain_film} }}\n")
        began = time.process_time()
        write_campaign(file, Path(folder) / "out", seed=1, discs=discs_under_foot)
        return (time.process_time() - began) / 2.0


def main() -> None:
    """Print a markdown table."""
    cv2.setNumThreads(1)
    print("| what, on one core | processor time |\n|---|---|")
    print(f"| grain film, 512 x 512 px, foot at 0.5 m/s | {grain_rate(True):.1f} frames/s |")
    print(f"| the same by the reference renderer of the samples | {grain_rate(False, frames=8):.1f} frames/s |")
    for ground in ("granular", "hard"):
        print(f"| blind campaign, {ground}, 24 jumps as tracks and motor logs | {campaign_seconds(ground):.2f} s |")
    seconds = film_seconds()
    for source in ("flow", "discs"):
        size = 'source = "discs", frames = 20, scale = 2.5e-4' if source == "discs" else "frames = 58"
        each = protocol_seconds(size)
        what = f"a jump with rod film, bed image and {size.split('frames = ')[1][:2]} frames of grains ({source})"
        print(f"| {what}, written | {each:.1f} s (60 jumps: {each:.0f} min on one core) |")
    print(f"| one jump with its rod film | {seconds:.2f} s (60 jumps: {seconds:.1f} min) |")


if __name__ == "__main__":
    main()
