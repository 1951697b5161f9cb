"""What the tests of structures share."""

import pytest
from polynomial_cases import SYSTEMS, System

from sysid.data.record import Record
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.model import Model

every_system = pytest.mark.parametrize("name", list(SYSTEMS))


def fitted(system: System, record: Record, **options: object) -> Model:
    return fit(system.model_structure, [record], FitOptions(**options))  # type: ignore[arg-type]
