"""The record of `granular.CONSTANTS` as kernels see it: its fields and their types, for whoever reads or checks."""

from __future__ import annotations

from typing import Protocol

from jumpvision.base.arrays import Array


class Packed(Protocol):
    """One jumper and where its run is; what each field means stands at `granular.CONSTANTS`."""

    sand: int
    massless: int
    linear: int
    dry: int
    ages: int
    led: int
    lost: int
    # addresses of routines
    prepare: int
    ground: int
    kinks: int
    left: int
    rail: int
    spring: int
    spring_slope: int
    drive: int
    inner: int
    losses: int
    # the robot, its loop
    m_m: float
    m_r: float
    M: float
    per_M: float
    ratio: float
    m_f: float
    k_s: float
    c_s: float
    g: float
    slack: float
    tau: float
    e: float
    kp: float
    kd: float
    max_force: float
    max_speed: float
    low: float
    high: float
    rest: float
    # its laws, and what the ledger asks and is told
    number: Array
    bends: Array
    asked: Array
    losses_W: Array
    # the run
    kind: int
    row: Array
    memory: Array
    arc: Array
    ahead: Array
    mode: int
    next: int
    slip: int
    exact: int
    fresh: int
    watched: int
    events: int
    sampled: int
    t: float
    h: float
    after: float
    taken: float
    longest: float
    held: float
    v_old: float
    height: float
    deep: float
    rod_before: float
    rod_after: float
    com: float
    lowest: float
    now: Array
    here: Array
    force: Array
    pace: Array
