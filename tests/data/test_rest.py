"""The rest at the head of a log: noise about a level is one, a reading that still moves is none."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.data.record import Record
from sysid.data.rest import Rest, rest_head
from sysid.estimation.pem import fit
from sysid.structures.registry import structure_class

LEVEL = 100.0


def head(
    seed: int, samples: int, drift: float = 0.0, lasting: float = 1.0, memory: float = 0.0
) -> Record:
    """A log whose input is held for some samples, while the output nears LEVEL.

    Args:
        seed: of noise of standard deviation one and of the commands after the head.
        samples: length of the head.
        drift: distance from LEVEL at the start.
        lasting: time constant with which it falls, in lengths of the head.
        memory: correlation of neighbouring readings' noise.
    """
    rng = np.random.default_rng([seed, samples])
    white = rng.standard_normal(samples + 500)
    noise = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white)[300:]
    u = np.concatenate([np.zeros(samples), rng.choice([1.0, 2.0, 3.0], 20).repeat(10)])
    y = 30.0 * lfilter([0.1], [1.0, -0.9], u)
    y[:samples] += drift * np.exp(-np.arange(samples) / (lasting * samples))
    return Record(u + 2.0, y + LEVEL + noise, 0.1)


def taken(samples: int, count: int = 60, **shape: float) -> list[Rest]:
    """The rests that are taken among the heads of so many logs."""
    found = [rest_head(head(seed, samples, **shape)) for seed in range(count)]
    return [f for f in found if f is not None]


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("samples", [5, 12, 50, 300])
def test_noise_about_a_level_is_a_rest(samples: int, memory: float) -> None:
    """However short the head is and however alike neighbouring readings are."""
    found = taken(samples, memory=memory)
    # five shapes of drift are looked for, each with one chance in a hundred; a few samples do not
    # tell a memory from a drift
    assert len(found) >= (56 if memory == 0.0 else 45)
    if samples >= 50:
        z = [(f.y[0] - LEVEL) / f.y_error[0] for f in found]
        # fifty readings of a memory of ten samples hold it with a fifth of error
        assert np.sqrt(np.mean(np.square(z))) < 1.6


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("lasting", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("samples", [20, 50, 300])
def test_a_reading_that_still_settles_is_no_rest(samples: int, lasting: float, sign: float) -> None:
    """Rising or falling, early or throughout: ten standard deviations hardly ever pass."""
    assert len(taken(samples, drift=sign * 10.0, lasting=lasting)) <= 1


@pytest.mark.parametrize("lasting", [0.1, 0.3, 1.0, 3.0])
def test_a_long_head_shows_a_small_drift(lasting: float) -> None:
    """Twice the noise, seen in 300 samples where it is over soon, and more where it is slow."""
    assert len(taken(300, drift=2.0 if lasting <= 1.0 else 5.0, lasting=lasting)) <= 3


@pytest.mark.parametrize("damping", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("periods", [1.0, 1.5, 2.0])
def test_a_reading_that_rings_is_no_rest(periods: float, damping: float) -> None:
    """A belt that is set going by a command held from the first sample on, 15 samples of it."""
    w = 2.0 * np.pi * periods / 15.0
    poles = np.exp(-damping * w) * np.exp(1j * w * np.sqrt(1.0 - damping**2))
    a = [1.0, -2.0 * poles.real, abs(poles) ** 2]
    for seed in range(6):
        rng = np.random.default_rng(seed)
        u = np.concatenate([np.full(15, 1.7), rng.uniform(-1.5, 1.5, 20).repeat(20)])
        y = lfilter([0.0, sum(a)], a, u) + 0.01 * rng.standard_normal(len(u))
        assert rest_head(Record(u, y, 0.02)) is None


def test_the_level_is_not_that_of_a_head_that_still_rises() -> None:
    """A fan that spins up while its command is held: the level is estimated, not read off."""
    for seed in range(6):
        u = head(seed, 60).u[:, 0]
        rng = np.random.default_rng(seed)
        y = LEVEL + lfilter([0.0, 3.0], [1.0, -0.97], u - 2.0)
        y += -30.0 * 0.97 ** np.arange(len(u)) + rng.standard_normal(len(u))
        r = Record(u, y, 0.1)
        assert rest_head(r) is None
        m = fit(structure_class("oe").from_orders({"nb": 1, "nf": 1, "nk": 1}, 1, 1), [r])
        gain = float(m.structure.transfer(m.theta).static_gain()[0, 0])  # type: ignore[attr-defined]
        level = float(m.detrend.y_offset[0] + gain * (2.0 - m.detrend.u_offset[0]))
        # the mean of these 60 readings is 13 lower; a constant at one end of the inputs is known
        # from 260 readings of noise one to about 0.2
        assert level == pytest.approx(LEVEL, abs=1.0)
