"""`jv.diagnose` and `jv.isolable`: a campaign's folder, or recordings with the study that simulates them.

Of recordings only the engine is loaded: what opens folders when a folder is given, what draws when a picture is shown.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from jumpvision.base.schema import InputError
from jumpvision.engine import Diagnosis, How, Recording, Study
from jumpvision.engine import diagnose as diagnose_study

if TYPE_CHECKING:
    import pandas as pd

    from jumpvision.engine.worth.isolable import Isolable
    from jumpvision.experiment.inputs.experiment import Campaign, Experiment

PathLike = str | os.PathLike[str]
RUNS = "runs.sqlite"  # in a folder of results: every run, for the next call


def diagnose(
    asked: Experiment | Campaign | PathLike | Sequence[Recording] | pd.DataFrame,
    study: Study | None = None,
    *,
    results: PathLike | None = None,
    workers: int | None = None,
    limit: float | None = None,
    budget: int | None = None,
    keep: PathLike | None = None,
    avoid: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """What a simulation gets wrong, where and why, and what a correction gains; `.values` is diagnosis.json.

    Without a study, asked is a campaign (folder) of jumps whose [model] is tested; the rest of the arguments but
    results and workers is not used then. With one, asked is recordings of anything, or a long table with the columns
    recording, time_s and a column a channel, and the study's own simulator is tested (docs/any_simulator.md):
    workers: other processes that simulate (none: this one). limit: seconds of a run (in another process). budget: most
    runs. keep: file that keeps every run, from which a later call goes on (default: beside the results, begun anew when
    a run comes out otherwise). avoid: go round parameters at which a run fails, instead of stopping. progress: called
    with how far it is, e.g. print. Ctrl-C ends it with what is known by then. Nothing is written unless results names a
    folder: diagnosis.json, samples.csv, diagnosis.png, report.html, runs.sqlite.

    Example: jv.diagnose("my_campaign").sentence
    """
    if study is not None:
        beside = Path(results) / RUNS if results is not None and keep is None else None
        kept = beside if keep is None else Path(keep)
        how = How(workers or 0, limit, budget, kept, avoid, progress, doubted=beside is not None)
        return _of_study(asked, study, how, None if results is None else Path(results))
    if not _is_folder(asked):
        raise InputError(["diagnose: recordings need the study that simulates them: jv.diagnose(recordings, study)"])
    from jumpvision.api import questioned

    return questioned(asked, results, workers)


def isolable(
    asked: Experiment | Campaign | PathLike | Sequence[Recording] | pd.DataFrame,
    study: Study | None = None,
    *,
    workers: int | None = None,
) -> Isolable:
    """Which causes recordings could show, from which strength, and not distinguish, before any is made.

    asked: a campaign (folder) of jumps as declared, or recordings (values NaN where they are not made yet; the noise of
    the channels then stated) with the study that simulates them. Also of every number that may drift in the order of
    the recordings. Linear about the model as it is declared. `.sentence`, `.table` (pandas).

    Example: jv.isolable([jv.Recording("slow", t, np.full(t.size, np.nan), {"start": 0.3})], study)
    """
    if study is not None:
        from jumpvision.engine.worth.isolable import weigh_planned

        return weigh_planned(_recordings(asked, study, "isolable"), study, How(workers or 0))
    if not _is_folder(asked):
        raise InputError(["isolable: recordings need the study that simulates them: jv.isolable(recordings, study)"])
    from jumpvision.api import open as opened
    from jumpvision.experiment.campaign.folder import as_campaign
    from jumpvision.experiment.campaign.offers import weigh_declared

    return weigh_declared(as_campaign(opened(asked) if isinstance(asked, str | os.PathLike) else asked), workers or 1)


def _is_folder(asked: Any) -> TypeGuard[Experiment | Campaign | PathLike]:
    """Whether it is a folder's path, or what `jv.open` gave."""
    return isinstance(asked, str | os.PathLike) or (hasattr(asked, "path") and not hasattr(asked, "columns"))


def _recordings(asked: Any, study: Study, verb: str) -> list[Recording]:
    """Recordings, or a table of them. Raises InputError for anything else."""
    if not isinstance(study, Study):
        raise InputError([f"{verb}: study is a {type(study).__name__}; make it with jv.Study(simulate, ...)"])
    if _is_folder(asked):
        raise InputError([f"{verb}: a folder and a study: use `jumpvision diagnose FOLDER --simulator MODULE:NAME`"])
    if hasattr(asked, "columns"):
        asked = Recording.of_table(asked, [c.name for c in study.channels])
    return list(asked)


def _of_study(asked: Any, study: Study, how: How, results: Path | None) -> Diagnosis:
    found = diagnose_study(_recordings(asked, study, "diagnose"), study, how)
    if results is not None:
        from jumpvision.report.pages.study import write_study

        write_study(found, results, study.name or "a study")
    for text in found.noise.warnings:
        warnings.warn(text, stacklevel=3)
    object.__setattr__(found, "pictures", _Pictures(found))
    return found


class _Pictures:
    """The figure of a diagnosis, drawn when it is shown; a pickle of the diagnosis leaves it."""

    def __init__(self, found: Diagnosis | None) -> None:
        self.found = found

    def __call__(self) -> list[bytes]:
        if self.found is None:
            return []
        from jumpvision.report.figures.diagnosis import study_picture

        return [study_picture(self.found)]

    def __reduce__(self) -> tuple[Any, ...]:
        return _Pictures, (None,)
