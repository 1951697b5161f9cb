"""A criterion: Hannan and Quinn's, between AIC and BIC."""

import math

from sysid.criteria.table import Criterion, Loss


def _value(loss: Loss) -> float:
    """N ln V + N ny (ln 2π + 1) + 2 n ln ln N (Hannan & Quinn 1979)."""
    return loss.deviance + 2.0 * loss.parameters * math.log(math.log(loss.samples))


HANNAN_QUINN = Criterion(
    sentence="Hannan and Quinn: finds the true order as N grows, and punishes size less than BIC.",
    value=_value,
)
