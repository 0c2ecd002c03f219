"""What jumps: the robot of an experiment, or that of the thesis."""

from __future__ import annotations

import dataclasses
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from jumpvision.base.schema import InputError, Toml, closest, read
from jumpvision.experiment.inputs.experiment import Experiment, merged, open_experiment
from jumpvision.experiment.inputs.model import ModelSpec, model_tables, read_model
from jumpvision.experiment.inputs.sections import Actuation, Bed, Header, Motor, Robot
from jumpvision.experiment.results.values import BedHeight
from jumpvision.experiment.stages.bed.height import packing
from jumpvision.experiment.stages.simulate import build_model
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.jumper.mechanisms.record import Body
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.packing import Laws
from jumpvision.jumper.robots import THESIS_ROBOT

Say = Callable[[str], None]
Tables = Mapping[str, Toml]  # values by section: {section: {key: value}}


@dataclass(frozen=True)
class Setup:
    """A robot on its ground with the law of its motor where no axis says otherwise.

    values: every name of physics.batch VALUES_OF_ROBOT, LAW and, on granular ground, VALUES_OF_BED [SI]. laws: of the
    bed's parameters against its volume fraction. phi_sigma: standard uncertainty of a measured volume fraction.
    """

    name: str
    model: Model
    values: Mapping[str, float]
    laws: Laws | None = None
    motor: Motor | None = None
    phi_sigma: float = 0.0

    @property
    def exact(self) -> bool:
        """Whether the closed-form flow of hard ground holds."""
        return self.model.exact


def setup_of(
    ground: str,
    experiment: Path | None,
    overrides: Mapping[str, Toml],
    *,
    model_file: Path | None = None,
    laws: Laws | None = None,
    bed_seen: BedHeight | None = None,
) -> Setup:
    """That of an experiment.toml (or its folder) or the thesis', with --set values in their place.

    bed_seen: the bed's record where it is at hand; else an experiment's picture of the bed is measured where [bed]
    gives no volume fraction. model_file: a TOML file whose [model] replaces the other; its [robot], as a diagnosis
    fitted it, goes over the robot's.
    """
    overrides = {name: table for name, table in overrides.items() if table}  # "params" is always there
    if model_file is not None and (fitted := model_tables(model_file).get("robot")):
        overrides["robot"] = {**fitted, **overrides.get("robot", {})}
    if experiment is not None:
        folder = experiment.parent if experiment.name == "experiment.toml" else experiment
        e = open_experiment(folder, overrides=overrides)
        if e.ground != ground:
            raise InputError(
                [f"sweep {ground} --experiment {experiment}: its ground is '{e.ground}'; sweep {e.ground} instead"]
            )
        if (robot := e.section(Robot)) is None:
            raise InputError([f"{folder / 'experiment.toml'}: [robot]: missing; a sweep needs the robot's values"])
        motor, bed, name = e.section(Motor), e.section(Bed), e.name
        if bed_seen is None and (bed is None or bed.volume_fraction is None) and ground == "granular":
            bed_seen = _bed_of(e)
        law = e.section(Actuation) or Actuation()
        spec = e.section(ModelSpec) or ModelSpec(() if ground == "hard" else ("two_resistance", "inertial_drag"))
    else:
        robot, law, motor, bed, spec = _thesis(ground, overrides)
        name = f"thesis robot, {ground} ground"
        e = Experiment(Path("--set"), name, Header(ground=ground), {}, {})
    if model_file is not None:
        given = read_model(model_file)
        own = {**given.parameters, **overrides.get("model", {})}
        spec = dataclasses.replace(
            given, terms=tuple(own.pop("terms", given.terms)), parameters=own, sigma={}, laws=None
        )
        name += f", model of {model_file.name}"
    try:
        model = plain_model(build_model(e, robot, spec, bed, bed_seen))
    except InputError as error:
        at = f"{e.path / 'experiment.toml'}: "
        raise InputError([p.replace(at, f"{model_file}: ") if model_file else p for p in error.problems]) from None
    usual = THESIS_ROBOT[ground]["actuation"]  # where the experiment has no [actuation] or lacks these
    if not law.moves:
        law = dataclasses.replace(law, kind="stutter")
    frequency: float = law.frequency or usual["frequency"]
    amplitude: float = law.amplitude or usual["amplitude"]
    values = {
        "motor_mass": model.m_m,
        "rod_mass": model.rod_mass,
        "stiffness": model.k_s,
        "damping": model.c_s,
        "gravity": model.g,
        "landing_loss": (model.parameters.e or 0.0) if "landing_loss" in model else 0.0,
        "frequency": frequency,
        "frequency2": frequency,
        "amplitude": amplitude,
        "phase": law.start_phase,
        "cycles": law.cycles,
        "delay": law.delay,
        "dwell_gain": law.dwell_gain,
    }
    if motor and motor.kp:
        values |= {"kp": motor.kp, "kd": motor.kd or 0.0}
        values |= {"max_force": motor.max_force or math.inf, "max_speed": motor.max_speed or math.inf}
    laws = laws or (spec.laws and spec.laws.without(overrides.get("model", {})))
    values["phi"], values["foot_radius"] = model.volume_fraction or math.nan, model.foot_radius or math.nan
    phi, phi_sigma = packing(bed, bed_seen)
    if phi is not None and phi_sigma:
        name += f", volume fraction {phi:.4f} ± {phi_sigma:.2g} as measured"
    return Setup(name, model, values, laws, motor, phi_sigma or 0.0)


def _bed_of(e: Experiment) -> BedHeight | None:
    """What the picture of the bed of an experiment shows; None where it has none."""
    with tempfile.TemporaryDirectory() as folder:
        workspace = Workspace(e, Path(folder) / "results", Path(folder) / "cache")
        return None if workspace.missing(BedHeight) else workspace.make(BedHeight)


def plain_model(model: Model) -> Model:
    """The model with its corrections of the robot's values applied, so that an axis sets the true value.

    What only a film shows otherwise is left out.
    """
    gone = model.acting(Body.ROBOT, Body.HEIGHT, Body.TIME)
    return dataclasses.replace(
        model,
        terms=tuple(t for t in model.terms if model.mechanism(t) not in gone),
        motor_mass=model.m_m,
        foot_mass=model.m_f,
        spring_stiffness=model.k_s,
        spring_damping=model.c_s,
        gravity=model.g,
    )


def _thesis(ground: str, overrides: Mapping[str, Toml]) -> tuple[Robot, Actuation, Motor, Bed, ModelSpec]:
    tables = THESIS_ROBOT[ground]
    problems = [
        f"--set {name}: unknown section of the thesis' robot{closest(name, tables)}"
        for name in overrides
        if name not in tables
    ]
    tables = merged(tables, {n: t for n, t in overrides.items() if n in tables})
    found = []
    for name, cls in (("robot", Robot), ("actuation", Actuation), ("motor", Motor), ("bed", Bed)):
        section, more = read(cls, tables[name], f"--set [{name}]")
        found.append(section)
        problems += more
    terms = tuple(tables["model"].get("terms", ()))
    values = {k: v for k, v in tables["model"].items() if k != "terms"}
    _, more = read(ModelParameters, values, "--set [model]")
    if problems + more:
        raise InputError(problems + more)
    return (*found, ModelSpec(terms, values))
