"""Rows that are written behind command and reading, and commands that change between two rows.

A firmware that sets the PWM, waits, reads the speed and then prints has let the command of a row
act before its reading; a logger of its own clock sees commands change anywhere within a row.
"""

import numpy as np
import pytest

from sysid.data.record import Channel, Record
from sysid.diagnosis.base_model import fit_baseline
from sysid.diagnosis.diagnose import diagnose
from sysid.effects.catalogue import chain_effects
from sysid.structures.augmented.structure import Augmented

DT, PARTS, TAU, GAIN = 0.02, 10, 0.3, 0.5


def driven(written: str, seed: int, friction: float = 0.0, rows: int = 2500) -> Record:
    """τ ω̇ = K u − c sign ω − ω by steps of 2 ms; a row before or after its command has acted."""
    rng = np.random.default_rng(seed)
    grid = 1 if written == "between" else PARTS
    u = np.empty(0)
    while len(u) < rows * PARTS:
        held = int(rng.uniform(0.3, 1.5) / DT * PARTS) // grid * grid
        u = np.append(u, np.full(held, rng.uniform(-200.0, 200.0)))
    pole, w, y = np.exp(-DT / PARTS / TAU), 0.0, np.zeros(rows * PARTS)
    for k, command in enumerate(u[: len(y)]):
        y[k] = w
        pushed = pole * w + (1.0 - pole) * GAIN * command
        most = (1.0 - pole) * friction
        w = pushed - min(max(pushed, -most), most)  # friction takes what there is
    read = np.append(y[PARTS::PARTS], w) if written == "after" else y[::PARTS]
    read = read + 0.004 * read.std() * rng.standard_normal(rows)
    channels = (Channel("pwm", ""),), (Channel("speed_rpm", "rpm"),)
    return Record(u[: len(y) : PARTS, None], read[:, None], DT, *channels)


@pytest.mark.parametrize(("written", "delay"), [("before", 1), ("after", 0), ("between", 0)])
def test_the_baseline_takes_rows_as_they_were_written(written: str, delay: int) -> None:
    base = fit_baseline([driven(written, 1)], [driven(written, 2)], chain_effects())
    assert base.search.delay == delay
    assert ("a row's command acts before its reading" in base.words) == (delay == 0)


@pytest.mark.slow
@pytest.mark.parametrize("written", ["after", "between"])
def test_what_is_hidden_does_not_depend_on_how_rows_were_written(written: str) -> None:
    nothing = diagnose([driven(written, 1)], [driven(written, 2)])
    assert nothing.verdict == "no-missing-effect"
    found = diagnose([driven(written, 1, 12.0)], [driven(written, 2, 12.0)]).to_json()["effects"]
    (entry,) = found
    assert entry["id"] == "coulomb-friction"
    level = next(p["value"] for p in entry["parameters"] if p["name"].startswith("level["))
    assert level == pytest.approx(12.0, rel=0.05)


def test_without_delay_the_chain_runs_one_row_ahead() -> None:
    """y₀(k) = y₁(k) of commands one row ahead, and ``step`` says the same as ``simulate``."""
    rng = np.random.default_rng(3)
    theta, u = np.array([0.8, -0.9, 0.05]), rng.uniform(-1.0, 1.0, (60, 1))
    late, now = (Augmented(1, nk, (1.0,), DT, ("coulomb-friction",)) for nk in (1, 0))
    theta = np.append(theta[:2], [0.05] * (now.n_effect_parameters))
    x0 = np.zeros(now.n_states(theta))
    ahead = late.simulate(theta, u)[1:]
    assert now.simulate(theta, u)[:-1] == pytest.approx(ahead, abs=1e-12)
    step, x, stepped = now.step(theta), x0, []
    for row in u:
        x, y = step(x, row)
        stepped.append(y)
    assert np.array(stepped) == pytest.approx(now.simulate(theta, u), abs=1e-12)
