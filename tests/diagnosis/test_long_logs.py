"""Long logs: pieces that know what went before them, and errors of all other samples."""

import numpy as np
import pytest

from sysid.data.record import Record
from sysid.diagnosis import long_logs
from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.long_logs import LONG, SEARCHED, pieces_of
from sysid.diagnosis.search.prepared import prepare


def motor(samples: int) -> Record:
    """A lag of 10 samples behind 0.2 of friction, driven by random levels."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1.0, 1.0, samples // 40 + 1), 40)[:samples]
    y, w = np.zeros(samples), 0.0
    for k in range(samples):
        y[k] = w
        force = u[k] - 0.2 * np.sign(w or np.clip(u[k], -0.2, 0.2) * 5.0)
        after = w + 0.1 * (5.0 * force - w)
        w = 0.0 if w * after < 0.0 or (w == 0.0 and abs(u[k]) < 0.2) else after
    return Record(u, y + 0.02 * rng.standard_normal(samples), 0.01)


def test_a_short_log_stays_whole() -> None:
    r = motor(LONG)
    assert pieces_of([r]) == (r,)


def test_time_and_angle_go_on_in_a_piece() -> None:
    whole = motor(LONG + 1)
    pieces = pieces_of([whole])
    assert sum(map(len, pieces)) <= SEARCHED
    full, cut = (prepare(r, np.ones(1), 1) for r in ([whole], pieces))
    for piece, t, counted in zip(pieces, cut.split(cut.t), cut.split(cut.counted), strict=True):
        k = round(piece.t0 / piece.dt)
        np.testing.assert_allclose(t, full.t[k : k + len(piece)])
        np.testing.assert_allclose(counted, full.counted[k : k + len(piece)], atol=1e-9)


@pytest.mark.slow
def test_judged_on_the_samples_that_were_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(long_logs, "LONG", 1000)
    monkeypatch.setattr(long_logs, "SEARCHED", 1000)
    result = diagnose([motor(4000)])
    assert "coulomb-friction" in [e.id for e in result.effects]
    counted = [t for t in result.traces if t.role == "held-out"]
    assert [len(t.record) for t in counted] == [4000]
    assert sum(t.counted.sum() for t in counted) == 3000
    c = result.gap.channels["y"]
    assert c.rmse_after < 2.0 * 0.02 < 0.5 * c.rmse_before  # its noise, and what 1000 samples leave
    assert "searched on 1000 samples in 4 pieces" in result.warnings[0]
