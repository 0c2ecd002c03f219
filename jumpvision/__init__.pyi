# made by `python docs/reference.py`
from .api import Folder, PathLike
from .api import open as open
from .api import run as run
from .api import diagnose as diagnose
from .api import sweep as sweep
from .api import plan as plan
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

def bed(experiment: Folder, *, results: PathLike | None = ...) -> BedHeight: ...
def crater(experiment: Folder, *, results: PathLike | None = ...) -> CraterShape: ...
def geometry(experiment: Folder, *, results: PathLike | None = ...) -> Geometry: ...
def intrusion(experiment: Folder, *, results: PathLike | None = ...) -> Intrusion: ...
def piv(experiment: Folder, *, results: PathLike | None = ...) -> Piv: ...
def flow(experiment: Folder, *, results: PathLike | None = ...) -> Flow: ...
def column(experiment: Folder, *, results: PathLike | None = ...) -> Column: ...
def spring(experiment: Folder, *, results: PathLike | None = ...) -> SpringTest: ...
def track(experiment: Folder, *, results: PathLike | None = ...) -> Track: ...
def rod(experiment: Folder, *, results: PathLike | None = ...) -> RodMotion: ...
def fit(experiment: Folder, *, results: PathLike | None = ...) -> Fits: ...
def simulate(experiment: Folder, *, results: PathLike | None = ...) -> Simulation: ...
def summary(experiment: Folder, *, results: PathLike | None = ...) -> Summary: ...
