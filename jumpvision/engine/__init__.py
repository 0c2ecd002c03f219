"""Questions any simulator: learns the noise, fits, detects a misfit, names its cause, says what naming it is worth.

Whatever can predict a motion is a `system.System`: a pendulum, a ball or the jumper of this package; what a user hands
over is a `Study`. It imports `estimate` and `base` only, and knows no robot. Its names are loaded when first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .document.diagnosis import Diagnosis as Diagnosis
    from .priors import Measured as Measured
    from .simulators.fmu import from_fmu as from_fmu
    from .simulators.mujoco import from_mujoco as from_mujoco
    from .simulators.program import from_program as from_program
    from .study.processes import How as How
    from .study.question import diagnose as diagnose
    from .study.study import Channel as Channel
    from .study.study import Mechanism as Mechanism
    from .study.study import Parameter as Parameter
    from .study.study import Recording as Recording
    from .study.study import Study as Study
    from .system import System as System

PUBLIC = {
    **dict.fromkeys(("Channel", "Mechanism", "Parameter", "Recording", "Study"), "study.study"),
    "How": "study.processes",
    "diagnose": "study.question",
    "Diagnosis": "document.diagnosis",
    "Measured": "priors",
    "System": "system",
    "from_fmu": "simulators.fmu",
    "from_mujoco": "simulators.mujoco",
    "from_program": "simulators.program",
}


def __getattr__(name: str) -> Any:
    if name in PUBLIC:
        return getattr(import_module(f"{__name__}.{PUBLIC[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *PUBLIC})
