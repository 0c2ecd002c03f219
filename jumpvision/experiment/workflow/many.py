"""Many experiments: several at a time in other processes, films first; then their pictures. Nothing is lost."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from jumpvision.base.compiling import notice
from jumpvision.base.progress import ready, worker_pool
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.inputs.sections import GrainVideo, RodTrack, RodVideo

from .run import Outcome, Plan, no_leftovers, run_experiment
from .stage import modules
from .workspace import NotCached

Report = Callable[[Outcome], None]
Known = Callable[[Mapping[str, Outcome]], None]


class Job(NamedTuple):
    """What is to be done of an experiment. before: what became of it, where only its pictures are left."""

    experiment: Experiment
    plan: Plan
    results: Path
    before: Outcome | None = None

    @property
    def filmed(self) -> bool:
        """Whether it has a grain film, which takes longest."""
        return self.experiment.section(GrainVideo) is not None


TRACKED = ("rod", "bed")  # stages that tell of an experiment's jump


def run_campaign(
    campaign: Campaign,
    plan: Plan,
    *,
    workers: int,
    done: Report,
    elsewhere: Mapping[str, list[str]] | None = None,
    jumps: Known | None = None,
) -> list[Outcome]:
    """Every experiment, `workers` at a time; `done` is called as each one ends. Outcomes in the campaign's order.

    jumps: is called once, where several run at a time, with what is known when all tracks are: grain films, fits and
    doubts take far longer. When only grain films are left, where code has to be compiled (two processes that need the
    same function would both compile it) or tracks are found in films of the rod.

    Pictures are drawn only where all else is in the cache; `undrawn` says of an outcome that they are left to `draw`.
    elsewhere: the experiments were computed by others, with these failures by name; here they are only collected.
    """
    with no_leftovers(plan):
        return _run_campaign(campaign, plan, workers, done, elsewhere, jumps)


def _run_campaign(
    campaign: Campaign,
    plan: Plan,
    workers: int,
    done: Report,
    elsewhere: Mapping[str, list[str]] | None,
    jumps: Known | None,
) -> list[Outcome]:
    jobs = {e.name: Job(e, plan, plan.results / e.name) for e in campaign.experiments}
    outcomes: dict[str, Outcome] = {}
    # what is all in the cache is done here, faster than a worker process starts
    for name, job in list(jobs.items()):
        try:
            outcomes[name] = run_experiment(*job[:3], only_cached=True)
        except NotCached:
            if elsewhere is None:
                continue
            why = elsewhere.get(name, [f"{job.experiment.path}: it changed while it was computed; run again"])
            outcomes[name] = Outcome(name, job.results, errors=why)
        done(outcomes[name])

    bare = replace(plan, drawn={})
    left = {n: job._replace(plan=bare) for n, job in jobs.items() if n not in outcomes}
    # Their tracks first; not where these have to be found in films, which takes long: each experiment is then done when
    # it has its own. Tests of a spring or of the sand are done at once.
    quick = not any(job.experiment.section(RodVideo) for job in left.values() if not job.filmed)
    tracked = {n for n, job in left.items() if job.filmed or (quick and job.experiment.section(RodTrack))}
    early = tracked if jumps and workers > 1 else set[str]()
    unknown, unfilmed = {*left}, {n for n, job in left.items() if not job.filmed}
    tracks = replace(bare, stages=TRACKED, whole=False)
    first: dict[str, Outcome] = {}

    def report(name: str, outcome: Outcome) -> dict[str, Job]:
        track_only = name in early and name not in first
        unknown.discard(name)
        if track_only:
            first[name] = outcome
        else:
            before = first.get(name, Outcome(name, outcome.results))
            now = {s.stage: s for s in before.steps}  # of this run, too
            steps, seconds = [now.get(s.stage, s) for s in outcome.steps], before.seconds + outcome.seconds
            outcomes[name] = replace(outcome, steps=steps, seconds=seconds, undrawn=plan.to_draw(name) != ())
            done(outcomes[name])
            unfilmed.discard(name)
        if jumps and early and not unknown and len(outcomes) < len(jobs) and not (unfilmed and _compiles()):
            jumps(first | outcomes)
            early.clear()
        return {name: left[name]} if track_only else {}

    begin = {n: job._replace(plan=tracks) if n in early else job for n, job in _longest_first(left).items()}
    _all(begin, workers, report)
    return [outcomes[n] for n in jobs]


def draw(
    campaign: Campaign, plan: Plan, outcomes: list[Outcome], *, workers: int, done: Report | None = None
) -> list[Outcome]:
    """The outcomes of `run_campaign` with the pictures that it left, `workers` experiments at a time; done: is told of
    each, with the seconds of its pictures."""
    made, before = {o.name: o for o in outcomes}, {o.name: o.seconds for o in outcomes}

    def ended(name: str, outcome: Outcome) -> None:
        made[name] = outcome
        if done is not None:
            done(replace(outcome, seconds=outcome.seconds - before[name]))

    jobs = {e.name: Job(e, plan, plan.results / e.name, made[e.name]) for e in campaign.experiments}
    with no_leftovers(plan):
        _all(_longest_first({n: job for n, job in jobs.items() if made[n].undrawn}), workers, ended)
    return list(made.values())


Ended = Callable[[str, Outcome], Mapping[str, Job] | None]  # gives what is to be done next


def _longest_first(jobs: Mapping[str, Job]) -> dict[str, Job]:
    """Films first: the longest jobs must not start last."""
    films = {n: sum(hasattr(s, "frame_rate") for s in job.experiment.sections.values()) for n, job in jobs.items()}
    return {n: jobs[n] for n in sorted(jobs, key=lambda n: -films[n])}


def _compiles() -> bool:
    """Whether a process of this run has had to compile."""
    given = notice()
    return given is not None and not given.unsaid.exists()


def _film_next(job: Job) -> bool:
    """Whether a grain film is matched as soon as this is done."""
    return job.plan.stages == TRACKED and job.filmed


def _all(jobs: Mapping[str, Job], workers: int, report: Ended) -> None:
    """Jobs by name, in other processes where several run at a time; one whose process dies is tried again alone."""
    left = dict(jobs)

    def ended(name: str, outcome: Outcome) -> Mapping[str, Job]:
        del left[name]
        more = report(name, outcome) or {}
        left.update(more)
        return more

    while left and (workers <= 1 or len(jobs) <= 1):
        name = next(iter(left))
        ended(name, _run(*left[name]))
    while left:
        for name in _in_processes(left, min(workers, len(left)), ended):  # alone, so that the guilty one is known
            e, _, results, _ = left[name]
            if _in_processes({name: left[name]}, 1, ended):
                killed = f"{e.path}: its worker process was killed (out of memory?); run again to resume"
                ended(name, Outcome(name, results, errors=[killed]))


def _run(experiment: Experiment, plan: Plan, results: Path, before: Outcome | None = None) -> Outcome:
    return run_experiment(experiment, plan, results, before=before)


def prepare(plan: Plan) -> None:
    """Begins to import, beside this process, what workers need."""
    many = plan.pictures and (plan.drawn is None or len(plan.drawn) > 1)  # else the one is drawn in this process
    drawing = ["matplotlib.figure", "matplotlib.backends.backend_agg"] if many else []
    ready([__name__, *modules(), *plan.pictures, *drawing, f"{__package__}.forked"])


def _in_processes(
    jobs: Mapping[str, Job], workers: int, ended: Callable[[str, Outcome], Mapping[str, Job]]
) -> list[str]:
    """Jobs by name, `workers` at a time; [] when all are done, or the names under way when a worker process died."""
    prepare(next(iter(jobs.values())).plan)
    queue = deque([*jobs.items()][::-1])
    under_way: dict[Future[Outcome], tuple[str, Job]] = {}
    with worker_pool(workers) as pool:
        try:
            while queue or under_way:
                # one more than there are workers, so that none waits, except where a film is to come next
                films = any(_film_next(job) for _, job in under_way.values())
                while queue and len(under_way) < workers + (not films):
                    name, job = queue.pop()
                    under_way[pool.submit(_run, *job)] = name, job
                    films |= _film_next(job)
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    outcome, (name, job) = future.result(), under_way.pop(future)
                    more = (ended(name, outcome) or {}).items()
                    (queue.extend if _film_next(job) else queue.extendleft)(more)
        except BrokenProcessPool:
            return [name for name, _ in under_way.values()]
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise
    return []
