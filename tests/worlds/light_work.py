"""A part of work for other processes, in a file of its own: they import what it needs and no more."""

from __future__ import annotations

import os
import time


def doubled(part: int, wait: float) -> tuple[int, int]:
    if part < 0:
        raise ValueError(f"part {part}")
    time.sleep(wait if part % 2 else 0.0)
    return 2 * part, os.getpid()
