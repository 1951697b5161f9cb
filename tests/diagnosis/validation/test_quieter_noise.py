"""The noise is read off what a model leaves, where that is the lower estimate."""

import numpy as np

from sysid.diagnosis.validation.noise import NoiseFloor


def test_of_two_estimates_each_output_takes_the_lower_with_its_interval() -> None:
    base = NoiseFloor(np.array([0.3, 0.1]), np.array([0.2, 0.09]), np.array([0.4, 0.11]))
    model = NoiseFloor(np.array([0.14, 0.2]), np.array([0.13, 0.18]), np.array([0.15, 0.22]))
    least = base.or_less(model)
    np.testing.assert_array_equal(least.value, [0.14, 0.1])
    np.testing.assert_array_equal(least.low, [0.13, 0.09])
    np.testing.assert_array_equal(least.high, [0.15, 0.11])
