"""The reason why a model leads quotes no figure of a search that a short log did not bear."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from sysid.data.record import Record
from sysid.estimation.identify import Request, identify
from sysid.estimation.selection.ranking import Entry, StructureRanking, reason
from sysid.estimation.selection.residual_check import valid_first


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


def test_residuals_that_follow_the_inputs_cost_the_lead_where_a_rival_errs_no_more() -> None:
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-1.0, 1.0, 100), 8)
    y = lfilter([0.0, 0.06, 0.05], [1.0, -1.5, 0.61], u) + 0.02 * rng.standard_normal(800)
    request = Request(structures=("arx", "oe"), orders="arx: na=1 nb=1 nk=1; oe: nb=2 nf=2 nk=1")
    fits = identify([Record(u[:, None], y[:, None], 0.1)], (), request)
    by_name = {a.model.structure.name: a for a in fits.assessments}
    wrong, right = by_name["arx"], by_name["oe"]
    assert not wrong.residuals.independence[0].passed
    judged, why = valid_first((wrong, right), "arx leads.")
    assert judged == (right, wrong)
    assert "the residuals of arx" in why
    assert valid_first((right, wrong), "oe leads.") == ((right, wrong), "oe leads.")
