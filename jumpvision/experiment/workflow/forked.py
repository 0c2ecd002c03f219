"""What each worker would do for itself: done once, by the process from which they are forked, after its imports."""

from __future__ import annotations

import gc

import scipy.interpolate
import scipy.ndimage
import scipy.optimize  # noqa: F401
from numba.core.registry import cpu_target

from jumpvision.base.compiling import GARBAGE_EVERY

cpu_target.target_context.refresh()  # what numba imports before it loads its first function

# what is imported stays: workers need not search it for garbage, nor copy the memory in which that search writes
gc.collect()
gc.freeze()
gc.set_threshold(GARBAGE_EVERY)
