"""A ramp much slower than the machine behind it: a belt that is sped up in half a minute."""

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.diagnose import diagnose

DT, TAU, RATE = 0.05, 0.25, 1.1


def belt(seed: int, rows: int = 4000, fall: float = RATE) -> Record:
    """A set speed of 1 to 16 km/h, followed by at most 1.1 km/h a second and a lag of 0.25 s.

    Args:
        fall: how fast it slows down [km/h/s].
    """
    rng = np.random.default_rng(seed)
    held = rng.integers(120, 500, rows // 120 + 1)
    u = np.repeat(rng.uniform(1.0, 16.0, len(held)), held)[:rows]
    ramp = speed = u[0]
    y = np.zeros(rows)
    for k, wanted in enumerate(u):
        y[k] = speed
        ramp += np.clip(wanted - ramp, -fall * DT, RATE * DT)
        speed += (1.0 - np.exp(-DT / TAU)) * (ramp - speed)
    y += 0.03 * rng.standard_normal(rows)
    channels = (Channel("v_set", "km/h"),), (Channel("v_belt", "km/h"),)
    return Record(u[:, None], y[:, None], DT, *channels, name=f"{seed}.csv", sha256=f"b{seed}")


@pytest.mark.slow
def test_it_is_a_rate_limit_whatever_its_rate() -> None:
    found = diagnose([belt(1)], [belt(2)]).to_json()["effects"]
    (entry,) = found
    assert entry["id"] == "rate-limit"
    rate = next(p for p in entry["parameters"] if p["name"].startswith("rate"))
    full = max(belt(1).u.max(), 1e-9)
    assert rate["value"] * full == pytest.approx(RATE, rel=0.03)


@pytest.mark.parametrize("fall", [0.5, 2.5])
def test_a_frequency_converter_has_a_ramp_up_and_another_down(fall: float) -> None:
    """With one rate alone a current limit, a delay and a sag came out beside it."""
    log = belt(3, fall=fall)
    (entry,) = diagnose([log]).to_json()["effects"]
    assert entry["id"] == "rate-limit"
    found = {p["name"].split("[")[0]: p["value"] * log.u.max() for p in entry["parameters"]}
    # where ramps end within a sample decides a per cent
    assert found["rate"] == pytest.approx(RATE, rel=0.02)
    assert found["fall"] == pytest.approx(fall, rel=0.02)
