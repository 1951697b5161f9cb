"""A set point that never moves beside sure feedback: nothing but the controller moves the input."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from written_logs import lines, point, put

from sysid.data.facts import LogFacts
from sysid.data.inspection import inspect_records
from sysid.data.io import read_file
from sysid.data.record import Channel, Record
from sysid.diagnosis.diagnose import diagnose
from sysid.estimation.identify import Request, identify

STILL = ("p_setpoint",)


def air_receiver(seed: int, still: tuple[str, ...] = STILL, rows: int = 1500) -> Record:
    """A compressor that holds a receiver at 7 bar while air is drawn; its controller has a gauge of
    its own, so that the logged pressure does not decide the speed to the last digit."""
    rng = np.random.default_rng(seed)
    pressure, total, drawn, data = 7.0, 40.0, 0.0, np.zeros((rows, 2))
    for k in range(rows):
        error = 7.0 - pressure - rng.normal(0.0, 0.02)
        total += 0.4 * error
        data[k] = total + 15.0 * error, pressure + rng.normal(0.0, 0.02)
        drawn = 0.95 * drawn + rng.normal(0.0, 0.6)
        pressure += 0.02 * (0.175 * data[k, 0] - pressure - 0.3 * drawn)
    channels = (Channel("speed", "%"),), (Channel("pressure", "bar"),)
    return Record(data[:, :1], data[:, 1:], 0.5, *channels, still_references=still)


def test_what_never_moves_is_known_to_the_record(tmp_path: Path) -> None:
    log = air_receiver(1)
    t, still = 0.5 * np.arange(len(log)), np.full(len(log), 7.0)
    body = lines([point(t), point(still), point(log.u[:, 0]), point(log.y[:, 0])])
    read = read_file(put(tmp_path, "t,p_setpoint,speed_cmd,p_bar\n" + body)).records[0]
    assert read.still_references == STILL
    assert read.input_names == ("speed_cmd",)


def test_no_errors_are_stated_where_only_a_controller_moves_the_input() -> None:
    facts = LogFacts.of([air_receiver(1)])
    assert [t.law for t in facts.laws_alone] == [None]
    (said,) = (f for f in inspect_records(facts) if f.code == "feedback")
    assert "No set point moves it within the log" in said.text
    assert not LogFacts.of([air_receiver(1, ())]).laws_alone
    found = identify(facts, (), Request(("arx",)), inspect=True)
    assert np.isinf(np.diag(found.assessments[0].model.covariance)).all()


def test_open_loop_beside_a_still_set_point_is_judged_as_ever() -> None:
    """The set point of another loop: the speed was stepped by hand."""
    rng = np.random.default_rng(2)
    log = air_receiver(1)
    u, y = np.repeat(rng.uniform(20.0, 90.0, 50), 30), np.zeros(1500)
    for k in range(1499):
        y[k + 1] = y[k] + 0.02 * (0.175 * u[k] - y[k])
    stepped = replace(log, u=u[:, None], y=(y + rng.normal(0.0, 0.02, 1500))[:, None])
    assert not LogFacts.of([stepped]).laws_alone


@pytest.mark.slow
def test_nothing_is_named_where_only_a_controller_moves_the_input() -> None:
    found = diagnose([air_receiver(1)])
    assert not found.effects
    assert not found.shapes
    assert any("moves its input through a controller" in w for w in found.warnings)
