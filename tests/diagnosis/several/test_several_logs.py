"""Several logs of one machine: what is the same in all, what differs, which ties break."""

from dataclasses import replace

import numpy as np
import pytest
from pose_cases import driven, ground, wandering

from sysid.data.documents import plain
from sysid.data.record import Array, Channel, Record
from sysid.diagnosis.base_model import fit_baseline, full_drive
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.pose.diagnosis import diagnose_pose
from sysid.diagnosis.rules.ledger import confirmed
from sysid.diagnosis.search.admission import tied
from sysid.diagnosis.search.prepared import logs_of
from sysid.diagnosis.search.selection import CandidateModel
from sysid.diagnosis.session import DiagnosisSession, noise_of
from sysid.diagnosis.several.constancy import several_logs, with_ground
from sysid.diagnosis.several.results import (
    ABSENT,
    INCONCLUSIVE,
    SIGNIFICANT,
    LogView,
    SeveralLogs,
    sentences,
    table_of_logs,
)
from sysid.effects.catalogue import chain_effects
from sysid.errors import DataError
from sysid.fitting.holdout import Errors
from sysid.structures.augmented.structure import Augmented
from sysid.vehicle.kinematics import Geometry

NOISE, ZONE = 0.05, 0.15
FULL = (Channel("volts", "V"),), (Channel("omega", "rad/s"),)


def log(
    name: str, seed: int, gain: float = 20.0, zone: float = ZONE, least: float = -1.0
) -> Record:
    """A log of a first-order motor behind a dead zone; ``least`` is its smallest command."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(least, 1.0, 25), 20)[:, None]
    u[0], u[1] = 1.0, -least  # full drive is the same in all logs
    s = Augmented(1, 1, (1.0,), 0.05, ("dead-zone",))
    y = s.simulate(np.array([gain, -0.8, zone, zone, 0.0]), u)
    return Record(u, y + NOISE * rng.standard_normal(y.shape), 0.05, *FULL, name=name)


def found(records: list[Record], held: list[Record] | None = None) -> SeveralLogs:
    """What logs say together, of a dead zone and of their gain and load."""
    some = [e for e in chain_effects() if e.id == "dead-zone"]
    base = fit_baseline(records, held, some)
    study = DiagnosisSession(base, noise_of(base), full_drive(records), 0)
    outcome = study.searched(base.search.model.effects, lambda text, share: None)
    return several_logs(study, confirmed(study, outcome.selection)[0])


@pytest.fixture(scope="module")
def charged() -> SeveralLogs:
    """The same dead zone with a full and with an empty battery."""
    return found([log("full.csv", 1), log("empty.csv", 2, gain=17.0)])


def test_what_is_the_same_is_told_from_what_differs(charged: SeveralLogs) -> None:
    (battery,) = charged.differences
    assert battery.id == "gain-by-log"
    ((own,), (other,)) = (battery.logs[k] for k in ("full.csv", "empty.csv"))
    assert own.value == 1.0
    assert other.value == pytest.approx(17.0 / 20.0, abs=0.01)  # noise of 0.3 % of the speed
    assert [v.effects[0].state for v in charged.logs] == [SIGNIFICANT, SIGNIFICANT]
    tests = {c.name: c for c in charged.constancy}
    assert tests["plus[omega]"].same
    assert abs(tests["plus[omega]"].value - ZONE) < 5.0 * tests["plus[omega]"].std_error
    assert not tests["gain[omega]"].same


def test_the_document_and_the_table_say_the_same(charged: SeveralLogs) -> None:
    first = plain(charged)["logs"][0]
    assert first["name"] == "full.csv"
    assert first["effects"]["dead-zone"]["state"] == "significant"
    heads, rows = table_of_logs(charged)
    assert heads[1:3] == ["full.csv", "empty.csv"]
    assert ["dead-zone", "significant", "significant", ""] in rows
    said = " ".join(sentences(charged))
    assert "full.csv 1; empty.csv 0.85" in said
    assert "Estimates agree across logs: dead-zone plus[omega]" in said


@pytest.mark.slow
def test_a_short_log_without_the_effect_says_so() -> None:
    other = log("new driver.csv", 3, zone=0.0).rows(0, 120)
    said = found([log("a.csv", 1), log("b.csv", 2), replace(other, sha256="")])
    assert [v.effects[0].state for v in said.logs] == [SIGNIFICANT, SIGNIFICANT, ABSENT]
    assert any("plus[omega] differ between logs" in s for s in sentences(said))
    assert "dead-zone is absent in new driver.csv." in sentences(said)


@pytest.mark.slow
def test_a_log_of_one_speed_cannot_tell() -> None:
    still = log("still.csv", 3)
    u = np.full_like(still.u, 1.0)
    y = np.full_like(still.y, 17.0) + NOISE * np.random.default_rng(4).standard_normal(u.shape)
    said = found([log("a.csv", 1), log("b.csv", 2), replace(still, u=u, y=y, sha256="")])
    assert said.logs[2].effects[0].state == INCONCLUSIVE


@pytest.mark.slow
def test_a_log_that_judges_may_have_a_battery_of_its_own() -> None:
    logs = [log("full.csv", 1), log("empty.csv", 2, gain=17.0)]
    said = found(logs, [log("half.csv", 3, gain=18.5)])
    ((judge,),) = (said.differences[0].logs["half.csv"],)
    assert judge.value == pytest.approx(18.5 / 20.0, abs=0.01)
    assert [v.validation for v in said.logs] == [False, False, True]


def test_stretches_of_one_file_are_one_log() -> None:
    one = log("a.csv", 1)
    parts = [replace(one.rows(0, 200), name="a.csv part 1"), one.rows(200, 500)]
    logs = logs_of([*parts, log("b.csv", 2)], parts)
    assert logs.names == ("a.csv", "b.csv")
    assert logs.estimation == (0, 0, 1)
    assert logs.holdout == (0, 0)


def test_logs_of_different_machines_are_refused() -> None:
    one = log("a.csv", 1)
    other = replace(log("b.csv", 2), outputs=(Channel("omega", "rpm"),))
    with pytest.raises(DataError, match=r"omega is in rpm in b.csv, in rad/s in a.csv"):
        diagnose([one, other])
    with pytest.raises(DataError, match=r"b.csv is sampled every 0.1 s, a.csv every 0.05 s"):
        diagnose([one, replace(log("b.csv", 2), dt=0.1)])


def errors(sizes: list[float], seed: int) -> Errors:
    """Errors of one model on two logs; half of each log is held out."""
    rng = np.random.default_rng(seed)
    whole = [s * rng.standard_normal((n, 1)) for s, n in zip(sizes, (3000, 400), strict=True)]
    return Errors(*(tuple(_every_other(e, k) for e in whole) for k in (0, 1)))


def _every_other(e: Array, k: int) -> Array:
    out = np.full_like(e, np.nan)
    out[k::2] = e[k::2]
    return out


def node(id: str, sizes: list[float], seed: int = 1) -> CandidateModel:
    return CandidateModel((id,), np.zeros(1), (), errors(sizes, seed), np.ones(1, dtype=bool))


def test_a_short_log_that_was_made_for_it_breaks_a_tie_that_a_long_one_cannot() -> None:
    logs = logs_of([log("a.csv", 1), log("b.csv", 2)], [log("a.csv", 1), log("b.csv", 2)])
    right, wrong = node("actuator-lag", [1.0, 1.0]), node("sensor-lag", [1.0, 1.3])
    assert tied(right, wrong)  # over both logs it is 3.5 %: the law may be as wrong
    assert not tied(right, wrong, logs)
    assert tied(right, node("sensor-lag", [1.0, 1.01]), logs)


def test_logs_that_contradict_each_other_break_no_tie() -> None:
    logs = logs_of([log("a.csv", 1), log("b.csv", 2)], [log("a.csv", 1), log("b.csv", 2)])
    assert tied(node("actuator-lag", [1.0, 1.3]), node("sensor-lag", [1.06, 1.0]), logs)


# Between tracks and ground ------------------------------------------------------------------------


@pytest.mark.slow
def test_another_ground_is_seen_as_another_width_and_a_short_log_cannot_tell() -> None:
    speeds = wandering(300)
    lab, carpet = (driven(speeds, ground("track-width", r), seed=3) for r in (0.8, 0.6))
    named = {"lab.csv": lab, "carpet.csv": carpet, "short.csv": lab.rows(0, 20)}
    logs = [replace(r, name=n, sha256=n) for n, r in named.items()]
    pose = diagnose_pose(logs[:1], (), Geometry())
    several = SeveralLogs(tuple(LogView(n, False, (), (), {}) for n in named))
    said = with_ground(several, logs, logs_of(logs, logs), pose, Geometry())
    assert [v.effects[0].state for v in said.logs] == [SIGNIFICANT, SIGNIFICANT, INCONCLUSIVE]
    (ratio,) = said.constancy
    assert not ratio.same
    seen = [v.effects[0].parameters[0].value for v in said.logs[:2]]
    assert seen == pytest.approx([0.8, 0.6], abs=0.02)
    assert "The estimates of track-width ratio differ between logs" in " ".join(sentences(said))
