"""Effects visible in the samples themselves: they have no step and are in no model."""

from sysid.effects.base import (
    Effect,
    Hints,
    Place,
    Texts,
    nothing,
)
from sysid.effects.programmes import CRUISE, REVERSALS

QUANTISATION = Effect(
    "quantisation",
    "sensor",
    Place.SAMPLES,
    Texts(
        "y → q round(y/q)",
        "The measurements come in steps.",
        "All measurements lie on a grid that is coarser than their noise.",
        "Several constant speeds.",
    ),
    (),
    nothing,
    hints=Hints(
        programmes=(CRUISE,),
    ),
)
HELD_TELEMETRY = Effect(
    "held-telemetry",
    "sensor",
    Place.SAMPLES,
    Texts(
        "y(k) = y(k − 1) between refreshes",
        "The sensor is slower than the log.",
        "Measurements repeat until the next one comes.",
        "Fast reversals.",
    ),
    (),
    nothing,
    hints=Hints(
        programmes=(REVERSALS,),
    ),
)
DROPOUTS = Effect(
    "dropouts",
    "sensor",
    Place.SAMPLES,
    Texts(
        "y → 0, or the reading before, in bursts",
        "Some measurements are lost.",
        "Measurements jump to zero and back, or stay constant while the speed changes.",
        "Several constant speeds.",
    ),
    (),
    nothing,
    hints=Hints(
        programmes=(CRUISE,),
    ),
)
EFFECTS = (QUANTISATION, HELD_TELEMETRY, DROPOUTS)
