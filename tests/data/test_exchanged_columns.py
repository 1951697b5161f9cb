"""An answer that was taken as the input, and its cause as the output."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.data.facts import LogFacts
from sysid.data.inspection import inspect_records
from sysid.data.record import Channel, Record
from sysid.diagnosis.diagnose import diagnose


def stirred_tank(seed: int, kind: str, rows: int = 2000) -> Record:
    """Dosing and what a probe reads, two lags of 12 and 3 samples behind it."""
    rng = np.random.default_rng(seed)
    dose = np.repeat(rng.uniform(0.0, 5.0, rows // 20 + 1), 20)[:rows]
    if kind == "noise":
        dose = 2.5 + np.convolve(rng.normal(0.0, 3.0, rows + 8), np.ones(8) / 8.0, "valid")[:rows]
    mixed = probe = 0.0
    read = np.zeros(rows)
    for k in range(rows):
        read[k] = probe + rng.normal(0.0, 0.02)
        mixed += (2.0 * dose[k] - mixed) / 12.0
        probe += (mixed - probe) / 3.0
    dose = dose + rng.normal(0.0, 0.01, rows)
    names = (Channel("column_1"),), (Channel("column_2"),)
    return Record(dose[:, None], read[:, None], 1.0, *names)


@pytest.mark.parametrize("kind", ["steps", "noise"])
@pytest.mark.parametrize("seed", range(3))
def test_only_the_way_round_is_said(seed: int, kind: str) -> None:
    log = stirred_tank(seed, kind)
    (right,) = LogFacts.of([log]).feedback or ()
    assert not right.exchanged
    assert not right.seen
    back = replace(log, u=log.y, y=log.u, inputs=log.outputs, outputs=log.inputs)
    (wrong,) = LogFacts.of([back]).feedback or ()
    assert wrong.seen
    assert wrong.exchanged


@pytest.mark.parametrize("seed", range(5))
def test_a_loop_whose_set_point_moves_is_no_exchange(seed: int) -> None:
    """The dose follows the probe, but the probe the dose as well."""
    rng = np.random.default_rng(seed)
    mixed = probe = total = 0.0
    rows = np.zeros((2000, 2))
    for k in range(2000):
        rows[k, 1] = probe + rng.normal(0.0, 0.02)
        error = 4.0 + 2.0 * ((k // 100) % 3) - rows[k, 1]
        total += 0.01 * error
        rows[k, 0] = total + 0.5 * error + rng.normal(0.0, 0.01)
        mixed += (2.0 * rows[k, 0] - mixed + rng.normal(0.0, 0.2)) / 12.0
        probe += (mixed - probe) / 3.0
    (test,) = LogFacts.of([Record(rows[:, :1], rows[:, 1:], 1.0)]).feedback or ()
    assert test.seen
    assert not test.exchanged


def test_nothing_is_named_on_a_cause() -> None:
    log = stirred_tank(0, "steps")
    back = replace(log, u=log.y, y=log.u, inputs=log.outputs, outputs=log.inputs)
    found = diagnose([back])
    assert not found.effects
    assert not found.shapes
    assert any("or the two are exchanged" in w for w in found.warnings)


def test_the_advice_exchanges_them() -> None:
    log = stirred_tank(0, "steps")
    back = LogFacts.of([replace(log, u=log.y, y=log.u, inputs=log.outputs, outputs=log.inputs)])
    (said,) = (f for f in inspect_records(back) if f.code == "feedback")
    assert "column_2 follows column_1" in said.text
    assert "exchanged" in said.text
    assert "`inputs=['column_1']" in said.advice
