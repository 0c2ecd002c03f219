"""What planned recordings of a user's own machine could show of its causes, before they are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jumpvision.base.schema import InputError
from jumpvision.engine.worth.isolable import Isolable
from jumpvision.engine.worth.isolable import isolable as causes_shown

from .processes import How
from .question import problem_of, recordings_problems, studied
from .runs import Runs
from .study import Recording, Study

REMEDY = " (other inputs, another channel)"


def isolable(recordings: Sequence[Recording], study: Study, how: How | None = None) -> Isolable:
    """Linear about the study as it begins, its causes absent. Values may be NaN: then the noise must be stated. Raises
    InputError for what cannot be asked."""
    how = how or How()
    if problems := recordings_problems(recordings):
        raise InputError(problems)
    planned = [_filled(r, study) for r in recordings]
    runs = Runs(study, planned, how)
    try:
        return Isolable(causes_shown(problem_of(studied(study, planned, runs))), len(planned), remedy=REMEDY)
    finally:
        runs.close()


def _filled(r: Recording, study: Study) -> Recording:
    """A recording that is not made yet, with what the study says of it."""
    if np.isfinite(r.of_channels(r.values, study.channels)).any():
        return r
    unknown = [c.name for c in study.channels if c.noise is None and r.sigma is None]
    if unknown:
        raise InputError(
            [
                f"recording {r.name!r}: it has no readings, and the noise of {', '.join(unknown)} is not stated: give "
                f"Channel({unknown[0]!r}, noise=...)"
            ]
        )
    return replace(r, values=study.predict({}, r))
