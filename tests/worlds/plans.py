"""The robot, bed and motor for which jumps are planned: docs/physics.md section 3, kp 20 kN/m, 100 N, 3 m/s, 50 mm."""

from __future__ import annotations

import math

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.planning.jumper import Drive
from jumpvision.jumper.planning.transcription import Limits

from .sand import ROBOT

P = ModelParameters(k1=2100.0, k2=2100.0, delta=0.01, C=2.7, mu=2.0, theta=math.pi / 3, b=17.2)
SAND = Model("granular", ("two_resistance", "depth_drag", "added_mass"), P, **ROBOT)
LOOP, LIMITS = Drive(20000.0, 120.0), Limits(max_force=100.0, max_speed=3.0, stroke=0.05)
