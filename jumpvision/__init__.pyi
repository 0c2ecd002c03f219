# made by `python docs/reference.py`
import os
from collections.abc import Callable, Iterable
from typing import Any, overload
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike
from .api import Folder, PathLike
from .api import open as open
from .api import run as run
from .api_study import diagnose as diagnose
from .api_study import isolable as isolable
from .api import sweep as sweep
from .api import plan as plan
from .api_fields import export as export
from .api_fields import plot as plot
from .estimate.oscillation import ringdown as ringdown
from .estimate.free_flight import flights as flights
from .films.arrays.space import triangulate as triangulate
from .engine import Recording as Recording
from .engine import Study as Study
from .engine import Parameter as Parameter
from .engine import Mechanism as Mechanism
from .engine import Channel as Channel
from .engine import Measured as Measured
from .engine import from_mujoco as from_mujoco
from .engine import from_fmu as from_fmu
from .engine import from_program as from_program
from jumpvision.experiment.results.values import BedHeight
from jumpvision.experiment.results.values import CraterShape
from jumpvision.experiment.results.values import Geometry
from jumpvision.experiment.results.values import Intrusion
from jumpvision.experiment.results.fields import Piv
from jumpvision.experiment.results.fields import Flow
from jumpvision.experiment.results.fields import Column
from jumpvision.experiment.results.fields import Statistics
from jumpvision.experiment.results.tables import Profiles
from jumpvision.experiment.results.values import SpringTest
from jumpvision.experiment.results.tables import Track
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.results.values import Doubts
from jumpvision.experiment.results.values import Fits
from jumpvision.experiment.results.tables import Simulation
from jumpvision.experiment.results.summary import Summary

__version__: str
__all__: list[str]
VERBS: dict[str, str]
TYPES: dict[str, str]
OF_ARRAYS: dict[str, str]
def of_arrays(name: str) -> Callable[..., Any]: ...

def geometry(experiment: Folder, *, results: PathLike | None = ...) -> Geometry: ...
def column(experiment: Folder, *, results: PathLike | None = ...) -> Column: ...
def profiles(experiment: Folder, *, results: PathLike | None = ...) -> Profiles: ...
def spring(experiment: Folder, *, results: PathLike | None = ...) -> SpringTest: ...
def rod(experiment: Folder, *, results: PathLike | None = ...) -> RodMotion: ...
def doubts(experiment: Folder, *, results: PathLike | None = ...) -> Doubts: ...
def fit(experiment: Folder, *, results: PathLike | None = ...) -> Fits: ...
def summary(experiment: Folder, *, results: PathLike | None = ...) -> Summary: ...
@overload
def bed(experiment: Folder, *, results: PathLike | None = ...) -> BedHeight: ...
@overload
def bed(pictures: ArrayLike | str | os.PathLike[str], *, floor_row: float, scale: float | None = None, saturation: float | None = None, **parameters: Any) -> pd.DataFrame: ...
@overload
def crater(experiment: Folder, *, results: PathLike | None = ...) -> CraterShape: ...
@overload
def crater(picture: ArrayLike, *, scale: float, laser_angle: float | None = None, axis: Any = None, **parameters: Any) -> pd.Series: ...
@overload
def intrusion(experiment: Folder, *, results: PathLike | None = ...) -> Intrusion: ...
@overload
def intrusion(depth_m: ArrayLike, force_N: ArrayLike, *, time_s: ArrayLike | None = None, foot_radius: float | None = None, **parameters: Any) -> pd.DataFrame: ...
@overload
def piv(experiment: Folder, *, results: PathLike | None = ...) -> Piv: ...
@overload
def piv(a: ArrayLike | str | os.PathLike[str], b: ArrayLike | str | os.PathLike[str] | None = None, *, frame_rate: float | None = None, scale: float | None = None, mask: ArrayLike | None = None, pairs: str = 'each', pair_time: float | None = None, **parameters: Any) -> xr.Dataset: ...
@overload
def flow(experiment: Folder, *, results: PathLike | None = ...) -> Flow: ...
@overload
def flow(field: xr.Dataset | str | os.PathLike[str], *, half_width: int = 1, **about: Any) -> xr.Dataset: ...
@overload
def statistics(experiment: Folder, *, results: PathLike | None = ...) -> Statistics: ...
@overload
def statistics(fields: xr.Dataset | str | os.PathLike[str] | Iterable[xr.Dataset | str | os.PathLike[str]], *, first: float | None = None, last: float | None = None, **about: Any) -> xr.Dataset: ...
@overload
def track(experiment: Folder, *, results: PathLike | None = ...) -> Track: ...
@overload
def track(frames: Iterable[ArrayLike] | str | os.PathLike[str], *, frame_rate: float | None = None, scale: float | None = None, exposure: float = 0.0, origin: tuple[float, float] | None = None, angle: float = 0.0, masses: tuple[float, ...] = (), window: int = 7, **parameters: Any) -> pd.DataFrame: ...
@overload
def simulate(experiment: Folder, *, results: PathLike | None = ...) -> Simulation: ...
@overload
def simulate(tables: Any, time_s: ArrayLike | None = None, motor_m: Any = None) -> pd.DataFrame: ...
