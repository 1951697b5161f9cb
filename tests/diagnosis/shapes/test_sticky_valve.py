"""A valve that sticks is a play of its command, whatever else follows both of its directions."""

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.diagnose import diagnose

STICKS, SLIPS = 2.5, 1.0
"""Error at which the stem moves, and how far it jumps then [%]."""


@pytest.mark.slow
def test_a_sticky_valve_is_a_play_and_no_bridge() -> None:
    """The dead time of a bridge takes the sign of a current, as play takes that of a change: a law
    of three numbers, which a play of two explains better."""
    rng = np.random.default_rng(8)
    operator, level = np.zeros(0), 45.0
    while len(operator) < 4000:
        level = float(np.clip(level + rng.choice([-8, -5, -3, -2, 2, 3, 5, 8]), 22, 70))
        operator = np.append(operator, np.full(int(rng.uniform(25, 90)), level))
    operator = operator[:4000]
    stem, pressure, y = operator[0], 4.0, np.empty(4000)
    for k, asked in enumerate(operator):
        if abs(asked - stem) > STICKS:
            stem = asked - np.sign(asked - stem) * (STICKS - SLIPS)
        y[k] = round(pressure + 0.004 * rng.standard_normal(), 3)
        pressure += (0.09 * stem + 0.1 - pressure) / 14.0
    log = Record(operator[:, None], y[:, None], 1.0, (Channel("OP", ""),), (Channel("PV", ""),))
    found = diagnose([log])
    assert not found.effects
    (shape,) = found.shapes
    assert shape.place == "command"
    assert "play or hysteresis about 3 wide" in shape.sentence
