"""A motor whose constant differs between the directions: one name, and what stands beside it."""

import numpy as np
import pytest

from sysid import diagnose
from sysid.data.record import Channel, Record

DT, NOISE = 0.05, 0.1
RESISTANCE, CONSTANT, INERTIA, LOSS = 2.0, 0.05, 2e-4, 1.5e-4


def log(seed: int, backward: float, drag: float = 0.0, samples: int = 2400) -> Record:
    """J ω̇ = k(V − k ω)/R − b ω − c ω|ω| with k smaller or larger while ω < 0; 50 steps a sample."""
    rng = np.random.default_rng(seed)
    volts = 6.0 * np.repeat(rng.uniform(-1.0, 1.0, samples // 20), 20)
    y, w, h = np.zeros(samples), 0.0, DT / 50
    for n in range(1, samples):
        for _ in range(50):
            k = CONSTANT * (backward if w < 0.0 else 1.0)
            torque = k * (volts[n - 1] - k * w) / RESISTANCE
            w += h / INERTIA * (torque - LOSS * w - drag * w * abs(w))
        y[n] = w
    y += rng.normal(0.0, NOISE, samples)
    names = (Channel("volts", "V"),), (Channel("omega", "rad/s"),)
    return Record(volts[:, None], y[:, None], DT, *names)


@pytest.mark.slow
@pytest.mark.parametrize("backward", [0.8, 1.2])
def test_brushes_off_the_neutral_are_one_effect(backward: float) -> None:
    found = diagnose(log(1, backward), log(2, backward))
    (named,) = found.effects
    assert {"viscous-asymmetry", "direction-asymmetry"} & {named.id, *named.indistinguishable}
    values = {p.name: p for p in named.parameters}
    ratio, emf = values["ratio[omega]"], values["emf[omega]"]
    # a third of a time constant a sample: that in which it turns has the direction of its middle
    assert ratio.value == pytest.approx(backward, rel=0.015)
    electric = CONSTANT**2 / RESISTANCE
    assert emf.value == pytest.approx(electric / (electric + LOSS), abs=0.04)
    assert found.gap is not None
    assert found.gap.closed_percent > 99.0


@pytest.mark.slow
def test_what_stands_beside_them_is_seen() -> None:
    found = diagnose(log(1, 0.8, drag=3e-6), log(2, 0.8, drag=3e-6))
    assert {e.id for e in found.effects} == {"viscous-asymmetry", "quadratic-drag"}
