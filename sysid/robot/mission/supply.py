"""The power supply of a mission's vehicle: battery and H-bridge between command and plant.

The laws are the catalogue's own effects: each parameter that a bench measures says under which key
its value stands here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from sysid.data.record import PWM_FULL_SCALE
from sysid.effects.base import Context, Effect
from sysid.effects.catalogue import chain_effects
from sysid.robot.mission.settings import Positive, Settings
from sysid.vehicle.kinematics import Real

Share = Annotated[float, Field(ge=0.0, le=0.9)]


class Supply(Settings):
    """Battery and H-bridge, as a bench measures them; shares are of full drive.

    Attributes:
        voltage: at the motors at full drive without load [V]: full drive of plants whose input is
            a voltage.
        sag: share that is lost while both tracks are at full drive.
        loss: share that is lost each second as the battery empties [1/s].
        dead_band_forward, dead_band_backward: commands up to these do nothing.
        dead_band_jump: beyond them the drive begins with this.
    """

    voltage: Positive | None = None
    sag: Share = 0.0
    loss: Annotated[float, Field(ge=0.0, le=0.02)] = 0.0
    dead_band_forward: Share = 0.0
    dead_band_backward: Share = 0.0
    dead_band_jump: Share = 0.0

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Those that a key which is not 0 says something of, in the order in which they act."""
        return tuple(e for e in chain_effects() if any(v > 0.0 for v in self._measured(e).values()))

    def numbers(self, effect: Effect) -> dict[str, float]:
        """Parameters of an effect, null values where no key says them, and what follows of them."""
        parameters = {p.name: p.null for p in effect.parameters} | self._measured(effect)
        return parameters | (
            effect.constants(np, parameters, 0.0, np.ones(1)) if effect.constants else {}
        )

    def _measured(self, effect: Effect) -> dict[str, float]:
        return {
            p.name: float(getattr(self, p.measured_as))
            for p in effect.parameters
            if p.measured_as in type(self).model_fields
        }


@dataclass(frozen=True)
class Feed:
    """From the PWM that control gives to the PWM that acts.

    Attributes:
        effects: in the order in which they act, with their numbers.
    """

    effects: tuple[tuple[Effect, Mapping[str, float]], ...]

    def __call__(self, pwm: tuple[Real, Real], t: Real, xp: Any) -> tuple[Real, Real]:
        """PWM of both tracks [µs] that acts at time ``t`` [s]."""
        given = xp.array(pwm) / PWM_FULL_SCALE
        none = 0.0 * given
        context = Context(0.0, t, w=none, torque=none, torque_other=none, drive=given)
        acting = given
        for effect, numbers in self.effects:
            acting, _ = effect.step(xp, acting, (), numbers, context)
        return PWM_FULL_SCALE * acting[0], PWM_FULL_SCALE * acting[1]


def feed_of(supply: Supply | None, identified: Sequence[str]) -> Feed | None:
    """What acts between command and plant; None where nothing does.

    Args:
        identified: effects that the plant was identified with: these it has itself.
    """
    if supply is None:
        return None
    acting = tuple((e, supply.numbers(e)) for e in supply.effects if e.id not in identified)
    return Feed(acting) if acting else None


def supply_notes(
    supply: Supply | None, identified: Sequence[str], by_voltage: bool
) -> tuple[str, ...]:
    """What is done with a mission's ``vehicle.supply``, in sentences."""
    if supply is None:
        return ()
    said = []
    acting = [e.id for e in supply.effects if e.id not in identified]
    doubled = [e.id for e in supply.effects if e.id in identified]
    if acting:
        said.append(f"Between command and plant act, as vehicle.supply says: {', '.join(acting)}.")
    if acting and not by_voltage:
        said.append(
            "The plant was identified from PWM, so the effect of supply and bridge counts twice. A "
            "motor of the test bench, driven by voltage, avoids that."
        )
    if doubled:
        said.append(
            "Omitted from vehicle.supply, because the plant already contains it: "
            f"{', '.join(doubled)}."
        )
    if supply.voltage is not None and not by_voltage:
        said.append(
            "vehicle.supply.voltage is not used, because the plant's inputs are not voltages."
        )
    return tuple(said)
