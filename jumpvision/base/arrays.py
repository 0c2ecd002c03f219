"""Array types, and the constants of a normal distribution that robust estimates use."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

MAD = 0.6745  # median absolute deviation of a normal distribution over its standard deviation
FROM_MAD = 1.4826  # the other way round
