"""An effect says everything itself: no other module names one; what it says of itself is tried."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sysid.diagnosis.search.full_model import FullModel
from sysid.effects.base import Effect
from sysid.effects.catalogue import CHANGED, about, catalogue, chain_effects
from sysid.effects.conformance import fault
from sysid.effects.samples import EFFECTS as OF_SAMPLES

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("sysid/diagnosis", "sysid/report", "sysid/estimation", "sysid/structures", "cli")
NAMESAKES = {
    "cli/diagnose.py": {"held-telemetry"},  # a finding of the reader
    "sysid/structures/blocks/static/kinds.py": {"dead-zone"},  # a kind of static curve
    "sysid/structures/blocks/hammerstein_wiener_proposals.py": {"dead-zone"},
    "sysid/structures/blocks/wiener_hammerstein_proposals.py": {"dead-zone"},
}
"""What is called as an effect is, and is none."""


def named_effects(text: str) -> set[str]:
    """Ids of the catalogue that stand in a source as strings of their own."""
    ids = {*catalogue(), *(e.id for e in OF_SAMPLES)}
    return {word for word in re.findall(r"[\"']([a-z-]+)[\"']", text) if word in ids}


def test_what_looks_for_names_finds_them() -> None:
    assert named_effects("if e.id == \"cross-coupling\" or 'backlash' in ids:") == {
        "cross-coupling",
        "backlash",
    }


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_effect_is_named_outside_the_catalogue(folder: str) -> None:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    for path in files:
        named = named_effects(path.read_text(encoding="utf-8"))
        assert named == NAMESAKES.get(path.relative_to(ROOT).as_posix(), set()), path


@pytest.mark.parametrize("e", catalogue().values(), ids=lambda e: e.id)
def test_every_effect_is_what_it_says(e: Effect) -> None:
    assert fault(e) == ""
    assert all(tie in catalogue() for tie in e.hints.ties)
    assert about(e.id) is e


@pytest.mark.parametrize("id", ["cross-coupling", "supply-sag", "inertial-coupling"])
def test_a_coupling_that_is_not_declared_is_seen(id: str) -> None:
    silent = replace(about(id), couples=False, shared=False)
    assert "give it couples=True" in fault(silent)


def test_a_step_that_acts_at_its_null_or_fails_is_seen() -> None:
    def shifted(xp, signal, state, p, c):  # type: ignore[no-untyped-def]
        return signal + 1.0, state

    def broken(xp, signal, state, p, c):  # type: ignore[no-untyped-def]
        return signal * p["gone"], state

    plain = about("concave-gain")
    assert "null values" in fault(replace(plain, step=shifted))
    assert "fails (KeyError: 'gone')" in fault(replace(plain, step=broken))


def test_tracks_that_any_effect_couples_are_moved_together() -> None:
    """A coupling effect under another name: its lanes must not share a shifted copy."""
    mine = replace(about("cross-coupling"), id="somebody-elses")
    model = FullModel((mine,), 1, 2, np.array([10.0, 10.0]), 0.05)
    q = model.null.copy()
    core, own = model.of("core"), model.of("somebody-elses")
    assert not model.joined(q, core)
    assert model.joined(q, (*core, *own))
    q[own[0]] = 0.1  # held, but it acts
    assert model.joined(q, core)


def test_changed_parameter_is_the_only_one_with_a_name_of_its_own() -> None:
    assert CHANGED.id not in catalogue()
    assert CHANGED not in chain_effects()
