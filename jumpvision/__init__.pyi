# made by `python docs/reference.py`
from typing import Any, overload
import pandas as pd
import xarray as xr
from .api import Folder, PathLike
from .api import open as open
from .api import run as run
from .api import diagnose as diagnose
from .api import sweep as sweep
from .api import plan as plan
from .api import ringdown as ringdown
from .api import flights as flights
from .api import triangulate as triangulate
from .api import Recording as Recording
from .api import Study as Study
from .api import Parameter as Parameter
from .api import Mechanism as Mechanism
from .api import Channel as Channel
from jumpvision.results.values import BedHeight
from jumpvision.results.values import CraterShape
from jumpvision.results.values import Geometry
from jumpvision.results.values import Intrusion
from jumpvision.results.fields import Piv
from jumpvision.results.fields import Flow
from jumpvision.results.fields import Column
from jumpvision.results.tables import Paths
from jumpvision.results.fields import Statistics
from jumpvision.results.tables import Profiles
from jumpvision.results.values import SpringTest
from jumpvision.results.tables import Track
from jumpvision.results.tables import RodMotion
from jumpvision.results.values import Fits
from jumpvision.results.tables import Simulation
from jumpvision.results.values import Summary

__version__: str
__all__: list[str]
VERBS: tuple[str, ...]
TYPES: tuple[str, ...]

def geometry(experiment: Folder, *, results: PathLike | None = ...) -> Geometry: ...
def flow(experiment: Folder, *, results: PathLike | None = ...) -> Flow: ...
def column(experiment: Folder, *, results: PathLike | None = ...) -> Column: ...
def statistics(experiment: Folder, *, results: PathLike | None = ...) -> Statistics: ...
def profiles(experiment: Folder, *, results: PathLike | None = ...) -> Profiles: ...
def spring(experiment: Folder, *, results: PathLike | None = ...) -> SpringTest: ...
def rod(experiment: Folder, *, results: PathLike | None = ...) -> RodMotion: ...
def fit(experiment: Folder, *, results: PathLike | None = ...) -> Fits: ...
def summary(experiment: Folder, *, results: PathLike | None = ...) -> Summary: ...
@overload
def bed(experiment: Folder, *, results: PathLike | None = ...) -> BedHeight: ...
@overload
def bed(pictures: Any, *, floor_row: float, scale: float | None = None, saturation: float | None = None, **parameters: Any) -> pd.DataFrame: ...
@overload
def crater(experiment: Folder, *, results: PathLike | None = ...) -> CraterShape: ...
@overload
def crater(picture: Any, *, scale: float, laser_angle: float | None = None, axis: Any = None, **parameters: Any) -> pd.Series: ...
@overload
def intrusion(experiment: Folder, *, results: PathLike | None = ...) -> Intrusion: ...
@overload
def intrusion(depth_m: Any, force_N: Any, *, time_s: Any = None, foot_radius: float | None = None, **parameters: Any) -> pd.DataFrame: ...
@overload
def piv(experiment: Folder, *, results: PathLike | None = ...) -> Piv: ...
@overload
def piv(a: Any, b: Any = None, *, frame_rate: float = 1.0, scale: float | None = None, mask: Any = None, **parameters: Any) -> xr.Dataset: ...
@overload
def paths(experiment: Folder, *, results: PathLike | None = ...) -> Paths: ...
@overload
def paths(field: xr.Dataset, *, spacing: float = 16.0, **parameters: Any) -> pd.DataFrame: ...
@overload
def track(experiment: Folder, *, results: PathLike | None = ...) -> Track: ...
@overload
def track(frames: Any, *, frame_rate: float = 1.0, scale: float | None = None, exposure: float = 0.0, origin: tuple[float, float] | None = None, angle: float = 0.0, masses: tuple[float, ...] = (), window: int = 7, fields: str = 'together', **parameters: Any) -> pd.DataFrame: ...
@overload
def simulate(experiment: Folder, *, results: PathLike | None = ...) -> Simulation: ...
@overload
def simulate(tables: Any, time_s: Any = None, motor_m: Any = None) -> pd.DataFrame: ...
