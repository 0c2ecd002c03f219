"""What a person sees in the terminal: results on stdout, progress and messages on stderr."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jumpvision.base.numbers import between, said
from jumpvision.base.progress import HOOK, setting
from jumpvision.base.record import plain
from jumpvision.base.schema import harmless

from .progress import Progress
from .progress import line as line

if TYPE_CHECKING:
    from jumpvision.base.local_page import LocalServer
    from jumpvision.engine.document.diagnosis import Diagnosis
    from jumpvision.experiment.campaign.folder import Run
    from jumpvision.experiment.inputs.experiment import Campaign
    from jumpvision.experiment.results.values import GeometryValues
    from jumpvision.experiment.workflow.run import Outcome


def compiling() -> None:
    """Said as numba begins: else a minute and more passes without a word."""
    line("compiling for this machine, this once: a minute or two on an idle machine, longer on a busy one")


@contextlib.contextmanager
def progress() -> Iterator[None]:
    """Within, long work of one thing is shown."""
    with Progress() as shown, setting(HOOK, shown.frames):
        yield


def written(
    facts: Mapping[str, object], rows: Sequence[Mapping[str, object]], files: Sequence[Path], *, as_json: bool
) -> None:
    """A result that lies in files of one folder."""
    result({**facts, "files": [str(f) for f in files]}, rows, as_json=as_json)
    line(f"results in {files[0].parent}: {', '.join(f.name for f in files)}")


def result(data: Any, rows: Sequence[Mapping[str, object]], *, as_json: bool) -> None:
    """A result as JSON or as a table."""
    if as_json:
        print(json.dumps(plain(data), indent=1))
    elif rows:
        table(rows)


UNBROKEN = 10**6  # columns of what is no terminal: a row is one line, for grep


def table(rows: Sequence[Mapping[str, object]]) -> None:
    """Print rows with the same keys as a table, folded to the width of a terminal where it is one."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    out = Table(header_style="bold", box=None, pad_edge=False)
    for key in rows[0]:
        numeric = all(_is_number(r[key]) for r in rows if r[key] not in (None, ""))
        out.add_column(Text(key), justify="right" if numeric else "left", no_wrap=numeric, overflow="fold")
    for row in rows:
        out.add_row(*(Text("" if v is None else harmless(str(v))) for v in row.values()))
    terminal = sys.stdout.isatty()
    Console(force_terminal=terminal, width=None if terminal else UNBROKEN).print(out)


def _is_number(value: Any) -> bool:
    text = str(value).split(" ")[0]
    try:
        float(text)
    except ValueError:
        return False
    return True


def beside_truth(diagnosis: Diagnosis, campaign: Campaign) -> None:
    """The parameters of the named mechanisms, and what films or tests measure of them, each beside the truth."""
    from jumpvision.experiment.campaign.truth import confirmation_rows, parameter_rows

    for title, rows in (
        ("parameters of the named mechanisms", parameter_rows(diagnosis, campaign)),
        ("measured by films or tests, and by the jumps alone", confirmation_rows(diagnosis, campaign)),
    ):
        if rows:
            print("\n" + title)
            table(rows)


def sure(found: Diagnosis) -> list[str]:
    """How sure a verdict is, in lines: by the test, by the models tried, on what was held out."""
    from jumpvision.engine.document.diagnosis import chance

    lines = []
    if not found.adequate:
        lines.append(f"probability of so large a misfit by noise alone: {chance(found.p_value)}")
        named = next((c for c in found.models if found.names(c)), None)
        if named:
            lines.append(f"probability of the named causes, among all that were tried: {chance(named.probability)}")
    if (g := found.gain) and found.unit:
        unit = {"1": "", "noise": " noise"}.get(found.unit, f" {found.unit}")
        held = f"{said(g.rmse_track_before_m)} -> {said(g.rmse_track_after_m)}{unit} rms"
    elif g:
        tracks = f"{said(g.rmse_track_before_m, '.3f', 1e3)} -> {said(g.rmse_track_after_m, '.3f', 1e3)} mm"
        heights = f"{said(g.rmse_height_before_m, '.2f', 1e3)} -> {said(g.rmse_height_after_m, '.2f', 1e3)} mm rms"
        held = f"track {tracks}, heights {heights}"
    if g:
        lines.append(f"held-out error: {held}; ratio {said(g.ratio, '.1f')}{between(*g.ratio_ci95, '.1f')}")
    return lines


def verdict(found: Diagnosis, campaign: Campaign) -> None:
    """On stdout, in this order: the sentence, what would mend it, the parameters beside the truth, how sure it is."""
    print(harmless("\n".join(text for text in (found.sentence, found.confirmed) if text)))
    if found.suggested:
        lines = [f"  {s.file}: {s.line}" for s in found.suggested]
        print(harmless("\n".join(["to correct it (jumpvision diagnose --accept writes this):", *lines])))
    if found.unit is None:
        beside_truth(found, campaign)
    if lines := sure(found):
        print(harmless("\n".join(["\nhow sure:", *(f"  {text}" for text in lines)])))


def diagnosis(
    found: Diagnosis,
    campaign: Campaign,
    made: list[Path],
    *,
    as_json: bool,
    outcomes: Sequence[Outcome] = (),
    whole: bool = False,
) -> None:
    """What `diagnose` found: the verdict, the experiments that stand out, the models tried, where to look.

    whole: every experiment, every model.
    """
    from jumpvision.engine.document.diagnosis import chance

    if as_json:
        print(json.dumps(found.values, indent=1))
        return
    verdict(found, campaign)
    _experiments(campaign, outcomes, found, whole=whole)
    rows = [
        {
            "mechanism": " + ".join(c.mechanisms),
            "probability": chance(c.probability),
            "held-out gain": said(c.delta_score, ".0f"),
            "parameters (90 %)": c.words,
        }
        for c in found.models
    ]
    if rows:
        print()
        shown = rows if whole else rows[:MODELS]
        table(shown)
        _left(len(rows) - len(shown), "less likely models")
    sys.stdout.flush()
    if found.runs:
        line(f"simulations: {found.runs.made} made, {found.runs.kept} kept from before, {said(found.runs.seconds)} s")
    if found.could_hide:
        line(found.could_hide)
    _next(found)
    look_at(made)


def _next(found: Diagnosis) -> None:
    """The next experiment, where there is one."""
    if n := found.next_experiment:
        far = n.expected_log10_odds >= 6.0  # larger odds than 10^6 say nothing more
        odds = "odds above 10^6 expected" if far else f"odds of {said(10**n.expected_log10_odds, '.2g')} expected"
        line(f"next experiment: {n.words} separates {' from '.join(n.separates)} ({odds})")


SHOWS = {
    ".html": "the page with the figures",
    ".png": "the picture of it",
    ".toml": "the extended model, for --model",
    ".json": "all numbers",
}


def look_at(made: Sequence[Path]) -> None:
    """Where to look: the page first."""
    order = list(SHOWS)
    for f in sorted(made, key=lambda f: order.index(f.suffix) if f.suffix in order else len(order)):
        line(f"look at {f}" + (f"  ({SHOWS[f.suffix]})" if f.suffix in SHOWS else ""))


def outcome(done: Run, *, as_json: bool, whole: bool = False) -> None:
    """The end of a command: tables on stdout, if not told before; what was done, skipped and failed on stderr."""
    campaign, outcomes, diagnosis = done.campaign, done.outcomes, done.diagnosis
    if as_json:
        data = {
            "results": str(done.plan.results),
            "experiments": [
                {
                    "name": o.name,
                    "results": str(o.results),
                    "stages": [{"stage": s.stage, "state": s.state, "seconds": s.seconds} for s in o.steps],
                    "summary": o.summary.values if o.summary else {},
                    "warnings": o.warnings,
                    "errors": o.errors,
                    "not_run": o.not_run,
                }
                for o in outcomes
            ],
            "excluded": dict(campaign.excluded),
            "diagnosis": diagnosis and diagnosis.values,
        }
        print(json.dumps(plain(data), indent=1))
    elif not done.shown:
        tables(campaign, outcomes, diagnosis, whole=whole)
    warned(outcomes)
    older = {o.name: o.older for o in outcomes if o.older}
    if older:
        of = "; ".join(dict.fromkeys(text for texts in older.values() for text in texts))
        line(
            f"note: results of {len(older)} of {len(outcomes)} experiments were made with other versions ({of}); "
            "--fresh-if-versions-differ computes them again"
        )
    for name, why in campaign.excluded.items():
        line(f"excluded: {name}: {why}")
    if done.single and not as_json:
        for o in outcomes:
            for text in o.not_run:
                line(f"not run: {text}")
    for o in outcomes:
        for text in o.errors:
            line(f"error: {text}")
    computed, failed = sum(o.computed for o in outcomes), sum(bool(o.errors) for o in outcomes)
    cached = sum(len(o.steps) for o in outcomes) - computed
    what = (
        f"{computed} stage results computed, {cached} from the cache"
        if computed
        else f"nothing recomputed ({cached} from the cache)"
    )
    part = sum(bool(o.errors and o.steps) for o in outcomes)
    line(f"{len(outcomes) - failed} of {len(outcomes)} experiments done{f', {part} in part' * bool(part)}; {what}")
    if done.diagnosis and not as_json:
        _next(done.diagnosis)
    line(f"results in {done.plan.results}")
    look_at(done.files)


def warned(outcomes: list[Outcome]) -> None:
    """What is said of the experiments."""
    for o in outcomes:
        for text in o.said:
            line(f"warning: {o.name}: {text}")


FEW = 8  # rows that are not worth a cut
MODELS = 4  # models that are told beside the named one


def tables(campaign: Campaign, outcomes: list[Outcome], diagnosis: Diagnosis | None, *, whole: bool = False) -> None:
    """On stdout: the verdict; heights and details beside their truth, of those that stand out or (whole) of all."""
    if diagnosis:
        verdict(diagnosis, campaign)
    _experiments(campaign, outcomes, diagnosis, whole=whole)
    sys.stdout.flush()


def _experiments(campaign: Campaign, outcomes: Sequence[Outcome], diagnosis: Diagnosis | None, *, whole: bool) -> None:
    """Rows of the experiments that stand out, with the reason; whole: of all of them."""
    from jumpvision.experiment.campaign.odd import odd
    from jumpvision.experiment.campaign.truth import coverage_words, details, overview

    if not any(o.summary for o in outcomes):
        return
    why = odd(campaign, outcomes, diagnosis)
    whole = whole or diagnosis is None or len(outcomes) <= FEW  # without a verdict the table is what was found
    shown = [o for o in outcomes if whole or o.name in why]
    listed = [o for o in shown if o.summary or o.errors]
    if diagnosis:
        print()
    if listed and len((rows := overview(campaign, listed))[0]) > 1:
        table([{**row, "stands out": why.get(row["experiment"], "")} if why else row for row in rows])
    if shown:
        _left(len(outcomes) - len(shown), "experiments that do not stand out")
    else:
        print(f"none of {len(outcomes)} experiments stands out (--table shows all)")
    if rows := details(campaign, shown):
        print()
        table(rows)
    if text := coverage_words(campaign, list(outcomes)):
        print("\n" + text)


def _left(n: int, what: str) -> None:
    """How many rows a table is short of."""
    if n:
        print(f"(and {n} {what}; --table shows all)")


class _Check(NamedTuple):
    """One experiment's value of a check; nearness: less is nearer to the limit. None where nothing is asked of it."""

    nearness: float
    experiment: str
    value: float
    limit: float | None
    unit: str
    ok: bool | None


def geometry(found: Mapping[str, GeometryValues]) -> None:
    """The checks of walls, floor and air as a table: of each the experiment that is nearest to its limit."""
    checks: dict[str, list[_Check]] = {}
    for name, values in found.items():
        for f in values["findings"]:
            entry = _Check(f["value"] / f["limit"], name, f["value"], f["limit"], f["unit"], f["ok"])
            checks.setdefault(f["check"], []).append(entry)
        if air := values["fluidisation"]:
            for law, onset in (("Ergun", air["onset_ergun_m_s"]), ("Wu", air["onset_wu_m_s"])):
                entry = _Check(-onset, name, onset, None, "m/s", None)
                checks.setdefault(f"onset of fluidisation ({law})", []).append(entry)
    rows = []
    for check, entries in checks.items():
        worst = min(entries, key=lambda e: e.nearness)
        rows.append(
            {
                "check": check,
                "value": f"{worst.value:.3g}",
                "needs more than": worst.limit and f"{worst.limit:.3g}",
                "unit": worst.unit,
                "ok": {True: "yes", False: "NO", None: ""}[worst.ok],
                "experiment": worst.experiment
                if len(entries) == 1
                else f"{worst.experiment}, the worst of {len(entries)}",
            }
        )
    if rows:
        print()
        table(rows)


def served(server: LocalServer, *, browser: bool) -> None:
    """Serve a page until Ctrl-C: its address on stdout; opened in the browser where that is asked for."""
    print(server.address, flush=True)
    line("Ctrl-C stops the server")
    if browser:
        import webbrowser

        webbrowser.open(server.address)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        line("stopped")
