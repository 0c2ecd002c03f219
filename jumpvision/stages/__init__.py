"""The stages: records in, record out. Importing this package registers all of them, in the order they run."""

from .track import track  # isort: skip
from .rod import rod  # isort: skip
from .bed.height import bed  # isort: skip
from .bed.geometry import geometry  # isort: skip
from .bed.crater import crater  # isort: skip
from .grains.piv import piv  # isort: skip
from .grains.flow import flow  # isort: skip
from .grains.column import column  # isort: skip
from .bed.intrusion import intrusion  # isort: skip
from .spring import spring  # isort: skip
from .fit import fit  # isort: skip
from .simulate import simulate  # isort: skip
from .summary import summary  # isort: skip

__all__ = [
    "bed",
    "column",
    "crater",
    "fit",
    "flow",
    "geometry",
    "intrusion",
    "piv",
    "rod",
    "simulate",
    "spring",
    "summary",
    "track",
]
