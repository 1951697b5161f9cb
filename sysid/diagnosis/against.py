"""Another model of the same channels beside the original and the augmented one."""

from collections.abc import Sequence

import numpy as np

from sysid.diagnosis.base_model import start_of
from sysid.diagnosis.diagnosis import Against, Trace
from sysid.errors import SysidError
from sysid.estimation.assessment.figures import outputs
from sysid.structures.model import Model


def compared(name: str, model: Model, traces: Sequence[Trace]) -> Against | None:
    """The free run of a model on the samples that judge; None where it cannot run there."""
    held_out = [t for t in traces if t.role == "held-out"]
    errors = []
    try:
        for t in held_out:
            model.check(t.record)
            run = outputs(model, t.record, None, start_of(model, t.record))
            errors.append(np.where(t.counted[:, None] > 0.0, t.record.y - run, np.nan))
    except SysidError:
        return None
    rmse = np.sqrt(np.nanmean(np.concatenate(errors) ** 2, axis=0)).tolist()
    return Against(name, {c.name: v for c, v in zip(model.outputs, rmse, strict=True)})
