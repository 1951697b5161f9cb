"""The constants that the thesis prints, and which of them follow from its data."""

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.testbench.motor.equations import PUBLISHED, steady_state
from sysid.testbench.motor.experiments import Kind, SteadyTest

FIRST_ROW = (3.0, 85.3476 * np.pi / 30.0)
"""Voltage [V] and speed [rad/s] of the first no-load measurement of the thesis: nobody else's motor
turns at this speed to six digits."""


PRINTED: Mapping[str, tuple[bool, str]] = {
    "R": (False, "printed as a value: neither voltage nor current of the blocked rotor is printed"),
    "Kem": (
        True,
        "mean of (V - R i)/ωm over the no-load measurements: 0.002311, printed with two digits",
    ),
    "Kc": (
        True,
        "mean of the stall torque over V/R - i0 is 8.648e-4, 0.2 % below what is printed as an "
        "interpolation; the stall torque over the whole stall current gives 7.34e-4",
    ),
    "f": (
        False,
        "comes from speeds under external loads, which are not printed; the no-load measurements "
        "alone give 4.3e-8",
    ),
    "C0": (
        False,
        "comes from speeds under external loads, which are not printed; the no-load measurements "
        "alone give 1.0e-4",
    ),
    "J": (False, "printed as a value from geometry, without dimensions; no transient was measured"),
}
"""Of each printed constant whether the printed tables give it, and why, or why not."""


def is_the_thesis(tests: Sequence[SteadyTest]) -> bool:
    """Whether the measurements are those of the thesis."""
    voltage, speed = FIRST_ROW
    return any(
        bool(np.any(np.isclose(t.voltage, voltage) & np.isclose(t.of("speed"), speed, rtol=1e-7)))
        for t in tests
        if t.kind is Kind.NO_LOAD
    )


def printed_against(tests: Sequence[SteadyTest]) -> tuple[float, ...]:
    """Error of the speeds without load that the printed constants predict, in parts of each."""
    deviations: list[float] = []
    for t in tests:
        if t.kind is Kind.NO_LOAD and t.has("speed"):
            deviations += (steady_state(PUBLISHED, t.voltage)[0] / t.of("speed") - 1.0).tolist()
    return tuple(deviations)
