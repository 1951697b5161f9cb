"""Filters of scipy.signal, imported when the first signal is filtered.

Importing scipy.signal costs a second, more than most commands need for all they do; what only
describes a model never filters.
"""

from typing import Any

import numpy as np


def lfilter(b: Any, a: Any, x: Any, axis: int = -1, zi: Any = None) -> Any:
    """Filter along an axis by B(q)/A(q); see ``scipy.signal.lfilter``.

    Args:
        b, a: coefficients of numerator and denominator.
        zi: initial states; with them the final ones are returned too.
    """
    if zi is None and len(a) == 1 and np.ndim(x) == 1:
        # as SciPy does it, which takes five times as long to find out
        return np.convolve(np.divide(b, a[0]), x)[: len(x)]
    from scipy import signal

    return signal.lfilter(b, a, x, axis, zi)


def lfilter_zi(b: Any, a: Any) -> Any:
    """States in which a constant input of 1 has settled; see ``scipy.signal.lfilter_zi``."""
    from scipy import signal

    return signal.lfilter_zi(b, a)
