"""An augmented model is ordinary: fitted again, tested, cross-validated, exported, driven."""

import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import quick_diagnosis
from command_line import Capture, run
from quick_diagnosis import dead_zone_log

from sysid.data.io import read_logs
from sysid.data.reading.read_options import ReadOptions
from sysid.effects.catalogue import chain_effects
from sysid.errors import ModelError
from sysid.estimation.pem import fit
from sysid.estimation.selection import cross_validation
from sysid.fitting.options import FitOptions
from sysid.structures.augmented.structure import Augmented
from sysid.structures.base import Structure
from sysid.structures.model import Model
from sysid.structures.registry import structure_class

TWO_TRACKS = {"order": 1, "delay": 2, "scales": (20000.0, 20000.0), "dt": 0.05}


def _theta(s: Augmented, seed: int) -> np.ndarray:
    """A core like that of the bundled robot, effects at their null values plus a little."""
    rng = np.random.default_rng(seed)
    core = np.array([20.0, -0.8, 18.0, -0.85]) * (1.0 + 0.05 * rng.standard_normal(4))
    effects = [
        p.starts[0] if np.isfinite(p.starts[0]) else p.null
        for e in s.active
        for _ in range(1 if e.shared else 2)
        for p in e.parameters
    ]
    return np.concatenate([core, effects])


@pytest.mark.parametrize("effect", [e.id for e in chain_effects()])
def test_runs_side_by_side_are_the_runs_one_by_one(effect: str) -> None:
    """Every effect of the catalogue, with different numbers in every run, to the last digits."""
    s = Augmented(effects=(effect,), **TWO_TRACKS)  # type: ignore[arg-type]
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-2e4, 2e4, (12, 2)), 10, axis=0)
    thetas = np.array([_theta(s, seed) for seed in range(3)])
    y = np.zeros((len(u), 2))
    states = np.array([s.fitted_state(t, u, y, 1) for t in thetas])
    together = s.simulate_many(thetas, u, states)
    for theta, state, run_ in zip(thetas, states, together, strict=True):
        step, x = s.step(theta), state
        alone = np.zeros_like(run_)
        for k in range(len(u)):
            x, alone[k] = step(x, u[k])
        # the same operations on longer arrays: rounding of a vectorised exp is all that may differ
        assert np.allclose(run_, alone, rtol=1e-9, atol=1e-9)


def test_a_combination_that_no_log_tells_is_named_and_has_no_error(tmp_path: Path) -> None:
    record = read_logs([dead_zone_log(tmp_path / "log.csv")], ReadOptions())[0]
    s = Augmented(1, 1, (20000.0, 20000.0), 0.05, ("dead-zone",))
    # commands that stand or lie far beyond every edge: only width less jump is told
    drive = np.where(np.abs(record.u) > 8000.0, 12000.0 * np.sign(record.u), 0.0)
    # hardly more than rounding, which is enough for slopes that are not singular
    drive += 0.1 * np.random.default_rng(2).standard_normal(drive.shape) * (drive != 0.0)
    edges = np.array([0.2, 0.2, 0.05] * 1)
    theta = np.array([20.0, -0.85, 18.0, -0.85, *edges, *edges])
    y = s.simulate(theta, drive)
    y = y + 0.05 * np.random.default_rng(3).standard_normal(y.shape)
    log = replace(record, u=drive, y=y, sha256="two-levels")
    model = fit(s, [log], FitOptions(), initial_guesses=[("near", theta * 1.02)])
    for p in model.parameter_table():
        if p.name.startswith("f1"):  # the time constant shows at every change of level
            assert 0.0 < p.std_error < 0.01, p.name
        else:  # one level each way: gain, edge and jump make one number of steady speed
            assert np.isinf(p.std_error), p.name


def test_a_refit_from_elsewhere_finds_the_truth_again(tmp_path: Path) -> None:
    """Dead zone .2, gains 20 and 18, pole .85: from values 2–10 % off, within three errors."""
    records = read_logs([dead_zone_log(tmp_path / "log.csv")], ReadOptions())
    s = Augmented(1, 1, (20000.0, 20000.0), 0.05, ("dead-zone",))
    names = [p.name for p in s.parameters(records[0].inputs, records[0].outputs)]
    edges = {"plus": 0.2, "minus": 0.2, "jump": 0.0}
    truth = np.array([20.0, -0.85, 18.0, -0.85, *edges.values(), *edges.values()])
    # commands on a grid of .05 cannot tell the width of the zone from a jump behind it
    held = FitOptions(fixed={n: 0.0 for n in names if ".jump[" in n})
    near = truth * np.array([1.1, 0.98, 0.9, 0.98, *[0.9] * 6])
    model = fit(s, records, held, initial_guesses=[("near", near)])
    free = np.array([p.fixed is None for p in model.parameters])
    errors = np.array([p.std_error for p in model.parameter_table()])[free]
    assert model.termination.good
    assert np.all((errors > 0.0) & np.isfinite(errors))
    # eight numbers, each beyond three standard errors with a chance of 0.3 %: 2 % for this seed
    assert np.all(np.abs(model.theta - truth)[free] < 3.0 * errors)
    with pytest.raises(ModelError, match="sysid diagnose"):
        fit(s, records)


@pytest.mark.slow
def test_a_diagnosed_model_goes_through_every_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """compare with residual tests and --folds, export, simulate: as any other model."""
    monkeypatch.chdir(tmp_path)
    dead_zone_log(tmp_path / "log.csv")
    dead_zone_log(tmp_path / "other.csv", seed=2)
    stub = types.ModuleType("sysid.diagnosis.diagnose")
    stub.diagnose = quick_diagnosis.diagnose  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, stub.__name__, stub)
    monkeypatch.setattr("sysid.report.diagnosis_page.diagnosis_page", quick_diagnosis.no_page)
    found = run(capsys, "diagnose", "log.csv", "--val", "other.csv", "--json").document
    ranking = run(capsys, "compare", "--val", "other.csv", "--folds", 3, "--json").document
    lines = {line["model"]: line for line in ranking["ranking"]}
    after = lines[found["augmented_model"]]
    assert ranking["best"] == found["augmented_model"]
    for line in lines.values():
        assert line["residuals"]["independence"]["outputs"], line["model"]
        assert line["cross_validation"]["failed"] == 0
    # the noise is .1 rad/s; a third of the log less, edges of the dead zone are known less well
    assert max(after["cross_validation"]["rmse"].values()) < 0.2
    assert after["residuals"]["independence"]["passed"]
    for options in (["--skip", 30], ["--horizon", 5]):
        asked = run(capsys, "compare", "--val", "other.csv", *options, "--json").document
        assert len(asked["ranking"]) == len(lines)
    assert run(capsys, "export").code == 0
    (tmp_path / "mission.yaml").write_text("goal: [1, 0]\n")
    assert run(capsys, "simulate", "mission.yaml").code == 0


def test_folds_are_fitted_as_the_model_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Held values, bounds, loss and stability of the model hold in every fold."""
    records = read_logs([dead_zone_log(tmp_path / "log.csv", 200)], ReadOptions())
    arx = structure_class("arx").from_orders({"na": 1, "nb": 1, "nk": 1}, 2, 2)
    model = fit(arx, records)
    first, second, *rest = model.parameters
    held = (replace(first, fixed=-0.2), replace(second, lower=-0.5, upper=0.0), *rest)
    told = {**model.provenance.options, "loss": "huber", "stable": True}
    asked = replace(model, parameters=held, provenance=replace(model.provenance, options=told))
    seen: list[FitOptions] = []

    def recorded(structure: Structure, part: object, options: FitOptions, **_: object) -> Model:
        seen.append(options)
        return model

    monkeypatch.setattr(cross_validation, "fit", recorded)
    cross_validation.cross_validate(asked, records, 2)
    for options in seen:
        assert options.fixed == {first.name: -0.2}
        assert options.bounds == {second.name: (-0.5, 0.0)}
        assert (options.robust, options.stable) == (True, True)
    assert len(seen) == 2
