"""The virtual laboratory: `jumpvision synth`."""

from __future__ import annotations

from pathlib import Path

from .app import DONE, app, cores


@app.command
def synth(
    kind: str, out: Path, /, *, seed: int = 20140630, workers: int | None = None, ground: str = "granular"
) -> int:
    """Virtual laboratory: write experiment folders whose truth is known (truth.json), or play the hidden-effect game.

    Example: jumpvision synth samples my_samples

    Parameters
    ----------
    kind
        hard_ground, loose_sand, samples (both), intrusion, or a protocol.toml of your own; blind writes a campaign
        with a hidden effect, reveal opens its answer and scores results/OUT/diagnosis.json.
    out
        Folder to write into; what is there already is not overwritten (an interrupted protocol is taken up).
    seed
        Of the random numbers; the same seed gives the same recordings, however many workers.
    workers
        Processes of a protocol; default: the cores.
    ground
        Of a blind campaign: hard or granular.
    """
    from .. import show

    if kind == "reveal":
        from ..lab.seal import reveal

        score = reveal(out)
        show.result(score, [{"what": k, "value": v} for k, v in score.items()], as_json=False)
        return DONE
    show.line(f"writing {kind} to {out} ...")
    if kind.endswith(".toml") or kind == "blind":
        from ..progress import HOOK

        with show.Progress(1) as progress:
            token = HOOK.set(progress.frames)
            try:
                if kind == "blind":
                    from ..lab.seal import write_blind

                    write_blind(out, seed=seed, ground=ground, workers=workers or cores())
                else:
                    from ..dem.under_foot import discs_under_foot
                    from ..lab.campaign import write_campaign

                    write_campaign(Path(kind), out, seed=seed, workers=workers or cores(), discs=discs_under_foot)
            finally:
                HOOK.reset(token)
        show.line(f"wrote {out}")
        return DONE
    from ..lab import samples

    folders = samples.write_samples(kind, out, seed=seed)
    show.line(f"wrote {', '.join(str(f) for f in folders)}")
    return DONE
