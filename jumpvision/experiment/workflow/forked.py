"""What each worker would import late, for itself: imported once, by the process from which they are forked."""

from __future__ import annotations

import scipy.interpolate
import scipy.ndimage
import scipy.optimize  # noqa: F401
from numba.core.registry import cpu_target

cpu_target.target_context.refresh()  # what numba imports before it loads its first function
