"""What the tests of hidden effects share."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DT, K, TAU = 0.05, 20.0, 0.25
