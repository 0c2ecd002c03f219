"""Many experiments: several at a time in other processes, films first; then their pictures. Nothing is lost."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from jumpvision.base.progress import ready, worker_pool
from jumpvision.experiment.inputs.experiment import Campaign, Experiment

from .run import Outcome, Plan, no_leftovers, run_experiment
from .stage import modules
from .workspace import NotCached

Report = Callable[[Outcome], None]


class Job(NamedTuple):
    """What is to be done of an experiment. before: what became of it, where only its pictures are left."""

    experiment: Experiment
    plan: Plan
    results: Path
    before: Outcome | None = None


def run_campaign(campaign: Campaign, plan: Plan, *, workers: int, done: Report) -> list[Outcome]:
    """Every experiment, `workers` at a time; `done` is called as each one ends. Outcomes in the campaign's order.

    Pictures are drawn only where all else is in the cache; `undrawn` says of an outcome that they are left to `draw`.
    """
    jobs = {e.name: Job(e, plan, plan.results / e.name) for e in campaign.experiments}
    outcomes: dict[str, Outcome] = {}

    def ended(name: str, outcome: Outcome) -> None:
        outcomes[name] = outcome
        done(outcome)

    with no_leftovers(plan):
        # what is all in the cache is done here, faster than a worker process starts
        for name, job in jobs.items():
            with contextlib.suppress(NotCached):
                ended(name, run_experiment(*job[:3], only_cached=True))
        bare = replace(plan, drawn={})
        left = {n: job._replace(plan=bare) for n, job in jobs.items() if n not in outcomes}
        _all(
            _longest_first(left),
            workers,
            lambda name, o: ended(name, replace(o, undrawn=plan.to_draw(name) != ())),
        )
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


Ended = Callable[[str, Outcome], None]


def _longest_first(jobs: Mapping[str, Job]) -> dict[str, Job]:
    """Films first: the longest jobs must not start last."""
    films = {n: sum(hasattr(s, "frame_rate") for s in job.experiment.sections.values()) for n, job in jobs.items()}
    return {n: jobs[n] for n in sorted(jobs, key=lambda n: -films[n])}


def _all(jobs: Mapping[str, Job], workers: int, report: Ended) -> None:
    """Jobs by name, in other processes where several run at a time; one whose process dies is tried again alone."""
    left = dict(jobs)

    def ended(name: str, outcome: Outcome) -> None:
        del left[name]
        report(name, outcome)

    if workers <= 1 or len(jobs) <= 1:
        for name, job in jobs.items():
            ended(name, _run(*job))
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


def _in_processes(jobs: Mapping[str, Job], workers: int, ended: Ended) -> list[str]:
    """Jobs by name, `workers` at a time; [] when all are done, or the names under way when a worker process died."""
    prepare(next(iter(jobs.values())).plan)
    queue = deque(jobs.items())
    under_way: dict[Future[Outcome], str] = {}
    with worker_pool(workers) as pool:
        try:
            while queue or under_way:
                while queue and len(under_way) <= workers:  # one more than there are workers, so that none waits
                    name, job = queue.popleft()
                    under_way[pool.submit(_run, *job)] = name
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    outcome = future.result()
                    ended(under_way.pop(future), outcome)
        except BrokenProcessPool:
            return [*under_way.values()]
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise
    return []
