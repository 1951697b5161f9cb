"""The study of measured records: how it judges, and that what it expects exists."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from studies import real_diagnose as study
from sysid.effects.catalogue import is_known

DATA = Path(os.environ.get("SYSID_DATA", Path(__file__).parents[3] / "shared" / "data"))
CASES = {c.name: c for c in study.CASES}


def test_every_name_that_a_record_should_get_is_one_of_the_catalogue() -> None:
    for case in study.CASES:
        assert all(is_known(i) for i in case.may.union(*case.must)), case.name


@pytest.mark.parametrize(
    ("record", "named", "judged"),
    [
        ("EMPS", ("coulomb-friction",), "right"),
        ("EMPS", ("stiction=coulomb-friction", "quantisation"), "right"),
        ("EMPS", ("coulomb-friction", "backlash"), "extra"),
        ("EMPS", ("backlash",), "missing and extra"),
        ("EMPS", (), "missing"),
        ("Husky", ("twist-limit", "track-width", "track-slip"), "right"),
        ("Husky", ("track-width", "input-delay"), "missing"),
        ("dryer", (), "right"),
        ("dryer", ("dropouts",), "right"),
        ("dryer", ("backlash",), "false"),
    ],
)
def test_names_are_judged_by_the_notes_of_the_record(
    record: str, named: tuple[str, ...], judged: str
) -> None:
    assert study.Found(record, named=named).judged(CASES[record]) == judged


def test_a_record_without_an_answer_misses_its_names() -> None:
    assert study.Found("EMPS", error="it cannot be read").judged(CASES["EMPS"]) == "missing"


@pytest.mark.skipif(not DATA.is_dir(), reason=f"the measured records are not at {DATA}")
def test_viscous_friction_of_the_measured_positioner_is_larger_backwards() -> None:
    # M q̈ + F± q̇ + Fc sign q̇ + offset = 35.15 u by least squares: the effect that is named beside
    # the published ones is in the record, and the published offset of −3.2 N is none beside it
    log = np.genfromtxt(DATA / "emps" / "train.csv", delimiter=",", names=True)
    low_pass = butter(4, 0.1)  # 50 Hz
    q, force = (filtfilt(*low_pass, c) for c in (log["y_qm_m"], 35.1507 * log["u_vir_V"]))
    v = np.gradient(q, 1e-3)
    terms = [np.gradient(v, 1e-3), v.clip(0.0), v.clip(None, 0.0), np.sign(v), np.ones_like(v)]
    moving = np.abs(v) > 1e-3
    found = np.linalg.lstsq(np.column_stack(terms)[moving], force[moving], rcond=None)[0]
    mass, forward, backward, dry, offset = found
    assert mass == pytest.approx(95.1, rel=0.01)
    assert dry == pytest.approx(20.4, rel=0.02)
    assert backward / forward == pytest.approx(1.45, abs=0.05)
    assert abs(offset) < 0.3
