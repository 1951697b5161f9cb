"""What the tests of estimation share."""

from collections.abc import Sequence

import pytest
from polynomial_cases import System

from sysid.data.record import Array, Record
from sysid.estimation.pem import fit
from sysid.fitting.options import FitOptions
from sysid.structures.model import Model
from sysid.structures.motion import initial_state_window
from sysid.structures.registry import structure_class

FOUR = ("arx", "armax", "oe", "bj")

every_structure = pytest.mark.parametrize("name", FOUR)


def estimated(
    name: str,
    orders: dict[str, object],
    records: Sequence[Record],
    *,
    detrend: str = "auto",
    **options: object,
) -> Model:
    structure = structure_class(name).from_orders(orders, records[0].nu, records[0].ny)
    found = FitOptions(**options)  # type: ignore[arg-type]
    return fit(structure, records, found, detrend=detrend)


def of(system: System, record: Record, **options: object) -> Model:
    return fit(system.model_structure, [record], FitOptions(**options))  # type: ignore[arg-type]


def free_run(model: Model, record: Record) -> Array:
    x0 = model.fitted_state(record, initial_state_window(model.structure, model.theta))
    return model.simulate(record.u, x0)
