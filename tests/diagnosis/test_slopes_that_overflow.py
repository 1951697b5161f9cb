"""Errors of a diagnosis where a run grows until its slopes overflow: the converter's baseline."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sysid.diagnosis import augment
from sysid.fitting.holdout import Errors


def test_a_parameter_without_slopes_has_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The others keep theirs; 0 says that slopes say nothing, as everywhere."""
    rng = np.random.default_rng(0)
    H = np.diag([400.0, 100.0, np.inf])
    H[0, 2] = H[2, 0] = np.nan
    monkeypatch.setattr(augment, "information", lambda *given: H)
    errors = Errors((rng.normal(0.0, 1.0, (2000, 1)),), (rng.normal(0.0, 1.0, (500, 1)),))
    search = SimpleNamespace(model=None, data=None)
    base = cast(Any, SimpleNamespace(search=search))
    candidate = cast(Any, SimpleNamespace(q=None, free=(4, 7, 9), errors=errors))
    found = augment.std_errors(base, candidate)
    assert found[4] == pytest.approx(0.05, rel=0.1)
    assert found[7] == pytest.approx(0.1, rel=0.1)
    assert found[9] == 0.0
