"""The reason why a model leads quotes no figure of a search that a short log did not bear."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from sysid.data.record import Record
from sysid.estimation.identify import Request, identify
from sysid.estimation.selection.ranking import Entry, StructureRanking, reason


def test_a_model_without_a_search_has_no_held_out_figure() -> None:
    u = np.where(np.arange(60) < 5, 0.0, 2.0)
    y = lfilter([0.0, 0.2], [1.0, -0.8], u) + 0.02 * np.random.default_rng(1).standard_normal(60)
    request = Request(structures=("arx", "oe"), orders="na=1 nb=1 nf=1")
    fits = identify([Record(u[:, None], y[:, None], 0.1)], (), request)
    first, second = (a.model for a in fits.assessments)
    searched: Any = SimpleNamespace(best=SimpleNamespace(error=1.2))
    entries = (Entry(first, searched, 0.0), Entry(second, None, 0.0))
    text = reason(StructureRanking(entries, entries, 0.02, "aic"), "fit", "data", given=False)
    assert "its AIC on the estimation data is the lowest" in text
    assert "%" not in text
