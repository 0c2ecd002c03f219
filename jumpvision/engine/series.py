"""Recordings in the order in which they were made."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime


def seconds(at: datetime) -> float:
    """Since 1970 [s]; a time without an offset from UTC is taken as one at UTC: only differences count."""
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def places(times: Mapping[str, float]) -> dict[str, float]:
    """1, 2, ... in the order of time; one place for equal times."""
    at = {t: float(k) for k, t in enumerate(sorted(set(times.values())), 1)}
    return {name: at[t] for name, t in times.items()}
