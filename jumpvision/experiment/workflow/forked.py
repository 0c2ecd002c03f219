"""What each worker would do for itself: done once, by the process from which they are forked, after its imports."""

from __future__ import annotations

import gc

import scipy.interpolate
import scipy.ndimage
import scipy.optimize  # noqa: F401
from numba.core.registry import cpu_target

from jumpvision.base.compiling import GARBAGE_EVERY

cpu_target.target_context.refresh()  # what numba imports before it loads its first function

# what is imported stays: the garbage collector of a worker need not look at it, nor write into its shared memory
gc.collect()
gc.freeze()
gc.set_threshold(GARBAGE_EVERY)
