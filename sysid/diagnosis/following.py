"""Whether the augmented model follows the log: if not, no effect is reported."""

from collections.abc import Sequence

import numpy as np

from sysid.data.finding import Finding, Severity
from sysid.data.record import Array, Record
from sysid.diagnosis.policies import VERDICT

ASTRAY = "The model does not follow the log"
"""How the sentence begins where the errors are more than noise."""

CODES = ("feedback", "nonlinear", "delay", "sampling", "levels", "excitation", "constant", "stuck")
"""Beginnings of the codes of checks whose findings may explain why a model does not follow."""


def not_followed(
    records: Sequence[Record], errors: Sequence[Array], floor: Array, findings: Sequence[Finding]
) -> str:
    """The first sentence of a diagnosis whose model is none; empty where every output is followed.

    Args:
        errors: its free-run errors there, (N, ny) a record; NaN where a sample does not count.
        floor: measurement noise of each output, (ny,).
    """
    e = np.concatenate(errors)
    y = np.concatenate([r.y for r in records])
    size = np.sqrt(np.nanmean(e**2, axis=0))
    spread = np.nanstd(y, axis=0)  # of the whole records: behind one step a block stands still
    fit = 100.0 * (1.0 - size / np.maximum(spread, 1e-300))
    names = records[0].output_names
    inputs = ", ".join(records[0].input_names)
    poor = [i for i in range(len(names)) if fit[i] < VERDICT.min_fit and spread[i] > 0.0]
    above_noise = [i for i in poor if size[i] > VERDICT.residual_to_noise * floor[i]]
    if above_noise:
        shown = ", ".join(f"{names[i]} {fit[i]:.0f} %" for i in above_noise)
        why = " ".join(f.text for f in findings if f.severity >= Severity.WARNING and _tells(f))
        return (
            f"{ASTRAY} ({shown} fit in free run on held-out data): "
            "missing effects cannot be diagnosed. Run sysid inspect (units, delay, feedback, a "
            "position that integrates), fit other structures with sysid fit, or choose channels "
            f"that belong together." + (f" About this log: {why}" if why else "")
        )
    silent = [i for i in poor if fit[i] < VERDICT.min_fit_of_input]
    if silent:
        shown = " and ".join(names[i] for i in silent)
        verb = "does" if records[0].nu == 1 else "do"
        return (
            f"{inputs} {verb} not explain {shown}: {'its' if len(silent) == 1 else 'their'} "
            "measurements look like noise. Check the columns, or use larger commands."
        )
    return ""


def _tells(finding: Finding) -> bool:
    return finding.code.startswith(CODES)
