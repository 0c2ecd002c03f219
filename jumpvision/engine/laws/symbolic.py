"""The namespace of a law over CasADi's symbols, its `xp` (of a law by `tree.smooth`, for derivatives at 0)."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca

NAMESPACE = SimpleNamespace(
    exp=ca.exp,
    log=ca.log,
    sqrt=ca.sqrt,
    tan=ca.tan,
    sin=ca.sin,
    cos=ca.cos,
    tanh=ca.tanh,
    abs=ca.fabs,
    sign=ca.sign,
    minimum=ca.fmin,
    maximum=ca.fmax,
    where=ca.if_else,
)
