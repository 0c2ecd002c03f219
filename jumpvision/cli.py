"""The command line: arguments to stages. No science, and nothing heavy imported before a command runs."""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter

from . import __version__

DONE, FAILED, BAD_CALL = 0, 1, 2
FIGURES = ("pictures", "grains", "craters", "air", "intrusions", "overlay", "overlays")
PICTURES = tuple(f"jumpvision.report.{m}" for m in FIGURES)  # register figures

app = App(
    name="jumpvision",
    help="From films of a jumping robot on hard ground and sand to tracks, fields, forces and tested models.\n\n"
    "Start with: jumpvision run data_samples/loose_sand",
    version=__version__,
)


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class Options:
    """Options of every command that works on a folder."""

    results: Annotated[Path | None, Parameter(help="Folder for results; default: results/NAME beside PATH.")] = None
    cache: Annotated[Path | None, Parameter(help="Folder for intermediate results; default: RESULTS/.cache.")] = None
    set: Annotated[
        tuple[str, ...],
        Parameter(name="--set", negative="", help="Override a value: stage.key=value or section.key=value."),
    ] = ()
    model: Annotated[
        Path | None, Parameter(help="model.toml, e.g. of diagnose: its [model] and [robot] over the folder's.")
    ] = None
    json: Annotated[bool, Parameter(negative="", help="Machine-readable result on stdout.")] = False
    workers: Annotated[int | None, Parameter(help="Processes for a campaign; default: the cores.")] = None
    verify: Annotated[bool, Parameter(negative="", help="Hash every input again, whatever its date says.")] = False
    pictures: Annotated[bool, Parameter(help="Draw figures beside the results.")] = True
    debug: Annotated[bool, Parameter(negative="", help="Show the traceback of an unexpected error.")] = False


OPTIONS = Options()


@app.command
def run(
    path: Path,
    /,
    *,
    pipeline: Path | None = None,
    profile: str | None = None,
    report: bool = True,
    options: Options = OPTIONS,
) -> int:
    """Every stage that has inputs, for one experiment or a whole campaign, then report.html.

    Example: jumpvision run data_samples/loose_sand

    Parameters
    ----------
    path
        An experiment folder (with experiment.toml) or a folder of them.
    pipeline
        TOML file with the stages to run and their parameters, e.g. pipelines/granular.toml.
    profile
        Hand a campaign to Snakemake: local, slurm, or a folder with config.yaml (docs/scale.md); --workers is then
        the number of jobs at a time.
    report
        Write report.html.
    """
    return _work(path, None, options, pipeline=pipeline, page=report, profile=profile)


def _stage_command(name: str, text: str) -> None:
    def command(path: Path, /, *, options: Options = OPTIONS) -> int:
        return _work(path, (name,), options)

    command.__doc__ = f"{text}\n\nExample: jumpvision {name} data_samples/hard_ground"
    command.__name__ = name
    app.command(command, name=name)


for _name, _text in {
    "track": "Ball on the rod: position, height and uncertainty in every frame (track.csv).",
    "bed": "Height of the bed and its volume fraction (bed.json).",
    "crater": "Volume change of a crater from a laser line or a depth map (crater.json).",
    "piv": "Velocity field of the grains (piv.nc).",
    "flow": "Shear rate, vorticity, divergence, momentum and added mass (flow.nc).",
    "intrusion": "Slow intrusion: two resistances, overshoots after pauses and withdrawals (intrusion.json).",
    "fit": "Ring-down, flights, column profile, jammed front and the other fits (fits.json).",
    "simulate": "The model driven by the measured motor (simulation.csv).",
}.items():
    _stage_command(_name, _text)


@app.command
def check(path: Path, /, *, options: Options = OPTIONS) -> int:
    """Validate a folder: every problem with file, section, key, value and remedy; walls, floor and air of the bed.

    Example: jumpvision check data_samples/loose_sand
    """
    from . import show

    campaign = _open(path, options)
    rows = [{"experiment": e.name, "ground": e.ground, "sections": ", ".join(e.sections)} for e in campaign.experiments]
    rows += [{"experiment": n, "ground": "", "sections": f"excluded: {why}"} for n, why in campaign.excluded.items()]
    from .checks import check_geometry

    found = {e.name: check_geometry(e) for e in campaign.experiments}
    data = {
        "path": str(path), "problems": [], "experiments": rows,
        "geometry": (numbers := {n: values for n, (values, _) in found.items() if values is not None}),
        "warnings": [f"{n}: {text}" for n, (_, texts) in found.items() for text in texts],
    }  # fmt: skip
    show.result(data, rows, as_json=options.json)
    if not options.json:
        show.geometry(numbers)
    for text in data["warnings"]:
        show.line(f"warning: {text}")
    return DONE


@app.command
def diagnose(path: Path, /, *, options: Options = OPTIONS) -> int:
    """What the simulation gets wrong, why, the extended model and what it gains (diagnosis.json, model.toml).

    Example: jumpvision diagnose data_samples/loose_sand
    """
    from . import show
    from .experiment import folder_of, is_campaign
    from .schema import InputError

    if not is_campaign(folder_of(path)):
        raise InputError([f"{path}: one experiment; give the campaign (the folder of experiments) to be questioned"])
    campaign, outcomes, plan, _ = _outcomes(path, ("rod", "bed"), options)
    made: list[Path] = []
    data = _question(campaign, outcomes, plan, options, made)
    show.diagnosis(data, made, as_json=options.json)
    return FAILED if any(o.errors for o in outcomes) else DONE


@app.command
def report(path: Path, /, *, options: Options = OPTIONS) -> int:
    """One self-contained HTML page with the figures, from the results (computing what is missing).

    Example: jumpvision report data_samples/hard_ground
    """
    return _work(path, None, options, page=True)


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
    from . import show

    if kind == "reveal":
        from .lab.seal import reveal

        score = reveal(out)
        show.result(score, [{"what": k, "value": v} for k, v in score.items()], as_json=False)
        return DONE
    show.line(f"writing {kind} to {out} ...")
    if kind.endswith(".toml") or kind == "blind":
        from .progress import HOOK

        with show.Progress(1) as progress:
            token = HOOK.set(progress.frames)
            try:
                if kind == "blind":
                    from .lab.seal import write_blind

                    write_blind(out, seed=seed, ground=ground, workers=workers or cores())
                else:
                    from .dem.under_foot import discs_under_foot
                    from .lab.campaign import write_campaign

                    write_campaign(Path(kind), out, seed=seed, workers=workers or cores(), discs=discs_under_foot)
            finally:
                HOOK.reset(token)
        show.line(f"wrote {out}")
        return DONE
    from .lab import samples

    folders = samples.write_samples(kind, out, seed=seed)
    show.line(f"wrote {', '.join(str(f) for f in folders)}")
    return DONE


def _axis(text: str) -> Parameter:
    return Parameter(help=text, group="Axes: LO:HI:N, or one value; SI units")


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class SweepAxes:
    """The axes of a sweep, in the order of its dimensions; what they mean is checked in sweep.axes."""

    frequency: Annotated[str | None, _axis("Forcing frequency [Hz].")] = None
    phase: Annotated[str | None, _axis("Start phase [rad]; pi/2 is a stutter jump, 3 pi/2 a single jump.")] = None
    amplitude: Annotated[str | None, _axis("Forcing amplitude A [m].")] = None
    delay: Annotated[str | None, _axis("Pause between the two half cycles [s].")] = None
    frequency2: Annotated[str | None, _axis("Frequency of the second half cycle [Hz].")] = None
    cycles: Annotated[str | None, _axis("Number of forcing cycles.")] = None
    alpha: Annotated[str | None, _axis("M g/(k A): sets the amplitude, or gravity with --amplitude.")] = None
    gravity: Annotated[str | None, _axis("Gravity along the rail [m/s^2].")] = None
    rod_mass: Annotated[str | None, _axis("Mass of the rod [kg]; the total mass is kept.")] = None
    motor_mass: Annotated[str | None, _axis("Mass of the motor [kg].")] = None
    stiffness: Annotated[str | None, _axis("Stiffness of the spring [N/m].")] = None
    zeta: Annotated[str | None, _axis("Damping ratio c / (2 sqrt(k M)).")] = None
    phi: Annotated[str | None, _axis("Volume fraction of the bed (granular).")] = None
    foot_radius: Annotated[str | None, _axis("Radius of the foot [m] (granular).")] = None


@app.command
def sweep(
    ground: str,
    /,
    *,
    axes: SweepAxes = SweepAxes(),
    analysis: str = "map",
    experiment: Path | None = None,
    campaign: Path | None = None,
    model: Path | None = None,
    laws: Path | None = None,
    results: Path | None = None,
    settings: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
    json: bool = False,
    workers: int | None = None,
    pictures: bool = True,
) -> int:
    """Jumps over any axes, or a named analysis of thesis chapters II and III: sweep.nc and sweep.png (or comparison.*).

    Example: jumpvision sweep hard --frequency 4:18:200 --phase 0:6.283:200

    Parameters
    ----------
    ground
        hard or granular.
    analysis
        map, or on hard ground minimum-amplitude, lift-off-time, alpha, scatter, bifurcation, traces, estimates,
        animals, two-frequency, comparison (of the measured jumps of --campaign with their simulation); on granular
        ground height-phi, jump-types, delay, alpha-fit, force-models, drag-scale, foot-radius.
    experiment
        An experiment.toml, or its folder, that gives robot, law and model; default: the thesis' robot.
    campaign
        Folder of hard-ground experiments for --analysis comparison.
    model
        A TOML file whose [model] replaces the model, e.g. model.toml.
    laws
        A TOML file of the bed's parameters against volume fraction; named analyses on granular ground default to an
        example (docs/granular.md).
    results
        Folder for the files; default: results/sweep, or results/NAME beside the campaign.
    settings
        Override a value: section.key=value, e.g. robot.gravity=9.81.
    json
        Machine-readable result on stdout.
    workers
        Processes of a granular sweep; default: the cores.
    pictures
        Draw the figure.
    """
    from dataclasses import asdict

    from . import show
    from .experiment import folder_of
    from .overrides import parse
    from .progress import HOOK
    from .sweep.dataset import write
    from .sweep.run import run as run_sweep

    given = {name: text for name, text in asdict(axes).items() if text is not None}
    results = results or (_results_of(folder_of(campaign)) if campaign else Path("results/sweep"))
    with show.Progress(1) as progress:
        token = HOOK.set(progress.frames)
        try:
            data, rows = run_sweep(
                ground, given, analysis=analysis, experiment=experiment, overrides=parse(settings),
                workers=workers or cores(), say=show.line, model=model, laws=laws, campaign=campaign,
                results=results,
            )  # fmt: skip
        finally:
            HOOK.reset(token)
    stem = "comparison" if campaign else "sweep"
    files = [write(data, results, f"{stem}.nc")]
    if pictures:
        from .report.sweeps import picture

        files.append(results / f"{stem}.png")
        files[1].write_bytes(picture(data))
    show.result({"results": str(results), "files": [str(f) for f in files], "numbers": rows}, rows, as_json=json)
    show.line(f"results in {results}: {', '.join(f.name for f in files)}")
    return DONE


def _limit(text: str) -> Parameter:
    return Parameter(help=text, group="Limits, in place of those of [motor]")


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class PlanLimits:
    """Limits of a plan; what is not given is the motor's."""

    max_force: Annotated[float | None, _limit("Greatest motor force [N].")] = None
    max_speed: Annotated[float | None, _limit("Greatest speed of the motor on the rod [m/s].")] = None
    stroke: Annotated[float | None, _limit("Travel of the motor on the rod [m].")] = None
    max_power: Annotated[float | None, _limit("Greatest motor power [W].")] = None
    by: Annotated[float | None, _limit("Latest time of the apex after the start [s].")] = None


@app.command
def plan(
    *,
    ground: str,
    apex: float | None = None,
    experiment: Path | None = None,
    model: Path | None = None,
    objective: str = "effort",
    motion: str = "single",
    limits: PlanLimits = PlanLimits(),
    results: Path = Path("results/plan"),
    settings: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
    json: bool = False,
    pictures: bool = True,
) -> int:
    """Motor trajectory for a jump to a given apex: plan.csv, plan.json, plan.png and an animation plan.html.

    Example: jumpvision plan --apex 0.04 --ground granular

    Parameters
    ----------
    ground
        hard or granular.
    apex
        Height of the rod over rest to reach [m]; without it the highest jump.
    experiment
        An experiment.toml, or its folder, that gives robot, motor and model; default: the thesis' robot.
    model
        A TOML file whose [model] replaces the model, e.g. model.toml of a diagnosis.
    objective
        What is least: effort (motor force squared over time), power (its peak) or energy.
    motion
        single (one push-off), hop (a preliminary hop), stop-go (a pause in the sand), stick (land and stand still).
    results
        Folder for the files.
    settings
        Override a value: section.key=value, e.g. motor.kp=30000.
    json
        Machine-readable result on stdout.
    pictures
        Draw the figure and the animation.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # the solver's small matrices: threads cost three times the time
    from dataclasses import asdict

    from . import show
    from .overrides import parse
    from .plans import check_call, make_plan, message, planned_robot, seeded, write

    given = {name: value for name, value in asdict(limits).items() if value is not None}
    check_call(ground, apex, given)
    robot = planned_robot(ground, experiment, model, {n: t for n, t in parse(settings).items() if t})
    show.line(f"planning for {robot.name} ...")
    found, planner, numbers = make_plan(
        robot, apex, objective=objective, motion=motion, limits=given, say=show.line, rng=seeded()
    )
    files = write(found, numbers, results)
    if pictures:
        from .report.plan import plan_animation, plan_picture

        files += [results / "plan.png", results / "plan.html"]
        files[-2].write_bytes(plan_picture(found, planner, numbers))
        files[-1].write_text(plan_animation(found, planner, numbers), encoding="utf-8")
    rows = [{"what": k, "value": v} for k, v in numbers.items() if not isinstance(v, dict)]
    show.result(numbers | {"files": [str(f) for f in files]}, rows, as_json=json)
    if numbers["status"] != "solved":
        show.line(message(numbers))
        return FAILED
    show.line(f"results in {results}: {', '.join(f.name for f in files)}")
    return DONE


@app.command
def demo(*, port: int = 8765, browser: bool = True) -> int:
    """The interactive jumper: a page in the browser, computed on this machine; Ctrl-C stops it.

    Example: jumpvision demo --port 8765

    Parameters
    ----------
    port
        Of http://127.0.0.1; 0 takes a free one.
    browser
        Open the page in the browser.
    """
    from . import show
    from .demo.jumper import warm_up
    from .demo.server import Server

    with Server(port) as server:
        show.line("compiling the solvers (the first time up to a minute) ...")
        warm_up()
        print(server.address, flush=True)
        show.line("Ctrl-C stops the server")
        if browser:
            import webbrowser

            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            show.line("stopped")
    return DONE


@app.command
def params(stage: str | None = None, *, json: bool = False) -> int:
    """Tables of all parameters: default, unit, allowed values and meaning.

    Example: jumpvision params piv
    """
    from . import show
    from .params import PARAMS
    from .schema import InputError, closest, table_of

    if stage is not None and stage not in PARAMS:
        raise InputError([f"params {stage}: unknown stage{closest(stage, PARAMS)}"])
    rows = [{"stage": s, **row} for s, cls in PARAMS.items() if stage in (None, s) for row in table_of(cls)]
    show.result(rows, rows, as_json=json)
    return DONE


@app.command
def cache(
    path: Path = Path("results"),
    /,
    *,
    older_than: str | None = None,
    keep: str | None = None,
    all: bool = False,
    json: bool = False,
) -> int:
    """Size of the cache by stage; with an option, make it smaller. Safe beside a running run.

    Example: jumpvision cache results/loose_sand --older-than 30d

    Parameters
    ----------
    path
        A results folder, a folder of them, or a cache folder.
    older_than
        Delete what was not used for so long, e.g. 12h, 30d.
    keep
        Delete the longest unused until so much is left, e.g. 500MB, 5GB.
    all
        Delete everything; a later run computes it again.
    json
        Machine-readable result on stdout.
    """
    from . import cache as store
    from . import show

    age = store.quantity(older_than, store.SECONDS, "--older-than") if older_than is not None else None
    size = store.quantity(keep, store.BYTES, "--keep") if keep is not None else None
    caches = store.caches_of(path)
    entries = [e for c in caches for e in store.entries_of(c)]
    out = entries if all else store.to_prune(entries, older_than=age, keep=size)
    store.prune(out)
    if all or age is not None or size is not None:
        for folder in caches:
            store.tidy(folder)
    rows = store.table(entries, out)
    data = {"caches": [str(c) for c in caches], "stages": rows, "freed_bytes": sum(e.nbytes for e in out)}
    show.result(data, rows, as_json=json)
    return DONE


@app.command
def doctor(*, json: bool = False) -> int:
    """Versions, codecs and cores, for a report of a problem.

    Example: jumpvision doctor
    """
    from . import show

    facts = show.doctor()
    show.result(facts, [{"what": k, "found": v} for k, v in facts.items()], as_json=json)
    return DONE


def _open(path: Path, options: Options, pipeline: dict[str, Any] | None = None) -> Any:
    """The campaign at `path`; a single experiment is a campaign of one."""
    from .experiment import Campaign, folder_of, is_campaign, merged, model_tables, open_campaign, open_experiment
    from .overrides import parse

    path = folder_of(path)
    overrides = parse(options.set)
    if options.model:
        overrides = merged(model_tables(options.model), overrides)
    given: dict[str, Any] = {"overrides": overrides, "pipeline": pipeline}
    if path.is_dir() and is_campaign(path):
        return open_campaign(path, **given)
    experiment = open_experiment(path, **given)
    if experiment.header.exclude:
        return Campaign(path, (), {experiment.name: experiment.header.exclude})
    return Campaign(path, (experiment,))


def _results_of(path: Path) -> Path:
    """Where results lie by default: results/NAME beside the folder."""
    return path.absolute().parent / "results" / path.absolute().name


def _work(
    path: Path,
    stages: tuple[str, ...] | None,
    options: Options,
    *,
    pipeline: Path | None = None,
    page: bool = False,
    profile: str | None = None,
) -> int:
    from . import show
    from .campaign import jumps_table, write_jumps
    from .schema import InputError

    campaign, outcomes, plan, single = _outcomes(path, stages, options, pipeline, profile)
    if stages and not any(o.steps or o.errors for o in outcomes):  # nothing there for the one stage asked for
        raise InputError(list(dict.fromkeys(f"{path}: {why}" for o in outcomes for why in o.not_run)))
    rows = jumps_table(campaign, outcomes)
    made: list[Path] = []
    diagnosis = None
    if not single and stages is None:
        write_jumps(rows, plan.results)
        from .question.jumps import worth_asking

        if plan.stages is None and worth_asking(campaign):
            diagnosis = _question(campaign, outcomes, plan, options, made)
    if not single:
        from .across import write_actuator, write_intrusions

        write_intrusions(campaign, outcomes, plan.results)
        write_actuator(campaign, outcomes, plan.results)
    if not single and (stages is None or "crater" in stages):
        from .craters import craters_table, write_craters, zero_crossing

        craters = craters_table({o.name: o.results for o in outcomes})
        made += write_craters(craters, zero_crossing(craters), plan.results)
    if page and any(o.steps for o in outcomes):
        from .report.page import write_report

        made.append(write_report(campaign, outcomes, rows, plan.results, single=single, diagnosis=diagnosis))
    show.outcome(campaign, outcomes, rows, plan.results, made, as_json=options.json, single=single, diagnosis=diagnosis)
    return FAILED if any(o.errors for o in outcomes) else DONE


def _outcomes(
    path: Path,
    stages: tuple[str, ...] | None,
    options: Options,
    pipeline: Path | None = None,
    profile: str | None = None,
) -> Any:
    """Run the stages; (campaign, outcomes, plan, whether it is a single experiment)."""
    from . import show
    from .campaign import Plan, run_campaign, run_single
    from .experiment import folder_of, is_campaign
    from .overrides import read_pipeline

    path = folder_of(path)
    definition = read_pipeline(pipeline) if pipeline else {}
    campaign = _open(path, options, definition.get("params"))
    results = options.results or _results_of(path)
    plan = Plan(
        results=results,
        cache=options.cache or results / ".cache",
        stages=stages or definition.get("stages"),
        modules=("jumpvision.stages", *(PICTURES if options.pictures else ())),
        verify=options.verify,
        debug=options.debug,
        command="jumpvision " + shlex.join(sys.argv[1:]),
    )
    single = not is_campaign(path)
    elsewhere = _hand_over(campaign, plan, profile, options, pipeline, single=single) if profile else None
    with show.Progress(len(campaign.experiments)) as progress:
        if single and campaign.experiments:
            outcomes = [run_single(campaign.experiments[0], plan, hook=progress.frames)]
        else:
            outcomes = run_campaign(
                campaign, plan, workers=options.workers or cores(), done=progress.experiment, elsewhere=elsewhere
            )
    return campaign, outcomes, plan, single


def _hand_over(
    campaign: Any, plan: Any, profile: str, options: Options, pipeline: Path | None, *, single: bool
) -> dict[str, list[str]]:
    """Let Snakemake compute the experiments; the reasons of those that failed, by name."""
    from .cluster import hand_over
    from .schema import InputError

    if single:
        raise InputError([f"--profile {profile}: {campaign.path} is one experiment; give a campaign, or leave it out"])
    passed = [x for text in options.set for x in ("--set", text)]
    passed += ["--pipeline", str(pipeline.absolute())] if pipeline else []
    passed += ([] if options.pictures else ["--no-pictures"]) + (["--verify"] if options.verify else [])
    return hand_over(campaign, plan, profile, options=passed, jobs=options.workers)


def _question(campaign: Any, outcomes: Any, plan: Any, options: Options, made: list[Path]) -> dict[str, Any]:
    """Diagnose a campaign whose tracks are there; adds the files written to `made`."""
    from . import show
    from .question.run import question
    from .report.diagnosis import diagnosis_picture

    data, files = question(
        campaign, {o.name: o for o in outcomes}, plan.results, plan.cache, workers=options.workers or cores(),
        draw=diagnosis_picture if options.pictures else None, say=lambda text: show.line(f"diagnose: {text}"),
    )  # fmt: skip
    made += files
    return data


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def main(argv: list[str] | None = None) -> int:
    """Entry point: 0 done, 1 something failed, 2 wrong call or bad input."""
    from .schema import InputError

    try:
        return int(app(argv, exit_on_error=False, print_error=False, result_action="return_value") or DONE)
    except InputError as e:
        print("\n".join(f"jumpvision: {p}" for p in e.problems), file=sys.stderr)
        return BAD_CALL
    except CycloptsError as e:
        print(f"jumpvision: {e}; see jumpvision --help", file=sys.stderr)
        return BAD_CALL
    except BrokenPipeError:
        return FAILED
    except OSError as e:  # a full disk, a folder that may not be written
        where = f": {e.filename}" if e.filename else ""
        print(
            f"jumpvision: {e.strerror or e}{where}; free or change it and run the same command again", file=sys.stderr
        )
        return FAILED
    except KeyboardInterrupt:
        print("jumpvision: interrupted; run the same command again to resume", file=sys.stderr)
        return 130
