"""Why a diagnosis says what it says: what is named, what remains, and if the log is followed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.finding import Finding, Severity
from sysid.data.record import Array, Record
from sysid.diagnosis.diagnosis import OF_THE_LOG
from sysid.diagnosis.gap import Gap
from sysid.diagnosis.policies import SHAPES, VERDICT
from sysid.diagnosis.shapes.grading import FoundShape
from sysid.diagnosis.validation.model_error import ResidualStructure, structured

LONG_ENOUGH = 800
"""Samples whose held-out part, three blocks of 80, is left with twice as many samples as terms of
the model of the errors: whitening takes 20 of each block, the terms are some 40."""

TOO_SHORT = "The log is too short for a diagnosis"

ON_A_RATE = (
    " The output integrates its input, so effects were searched on its rate. Differences of a "
    "position may be too coarse to show backlash: record the speed as well."
)


@dataclass(frozen=True, eq=False)
class Remaining:
    """What remains in the errors of the augmented model.

    Attributes:
        where: the regime that holds most of what is left beyond its size, in words; empty where
            none stands out.
    """

    structure: ResidualStructure | None
    gap: Gap
    where: str = ""

    @property
    def structured(self) -> bool:
        """Whether they depend on what is known."""
        return structured(self.structure)

    @property
    def matters(self) -> bool:
        """Whether their structure is more than a slight one, of errors that may all be noise."""
        if self.structure is None or not self.structured:
            return False
        if self.within_noise:
            return False
        sure = self.structure.p_value < VERDICT.certain_p and bool(self.above_noise)
        return sure or self.structure.share >= VERDICT.min_predicted_share

    @property
    def within_noise(self) -> bool:
        """Whether the errors of no output are larger than its noise may be."""
        return all(c.rmse_after <= c.surely_noise for c in self.gap.channels.values())

    @property
    def share(self) -> str:
        """How much of them is predicted, in per cent."""
        return f"{100.0 * self.structure.share:.0f} %" if self.structure is not None else ""

    @property
    def above_noise(self) -> str:
        """Outputs whose errors are far above the noise, and how far; empty where there is none."""
        return ", ".join(
            f"{name} {c.rmse_after / c.noise_floor:.1f} times"
            for name, c in self.gap.channels.items()
            if c.rmse_after > VERDICT.residual_to_noise * c.surely_noise > 0.0
        )


def verdict_of(
    ids: Sequence[str], remaining: Remaining, missing: bool, shapes: Sequence[FoundShape] = ()
) -> str:
    """``effects-found``, ``shape-found``, ``no-missing-effect`` or ``unexplained``.

    Args:
        missing: whether something else shows that something is missing.
        shapes: proven shapes of what remains.
    """
    # what is a matter of the log is no missing effect and explains no error
    if any(id not in OF_THE_LOG for id in ids):
        return "effects-found"
    if shapes:
        return "shape-found"
    return "unexplained" if missing or remaining.matters else "no-missing-effect"


def story(
    verdict: str,
    ids: Sequence[str],
    remaining: Remaining,
    on_rate: bool = False,
    shapes: Sequence[FoundShape] = (),
) -> str:
    """Why this verdict, in a sentence or two."""
    missing = [id for id in ids if id not in OF_THE_LOG]
    if verdict == "effects-found" and missing:
        rest = f" What remains has a shape: {_shapes(shapes)}." if shapes else ""
        return f"Missing: {', '.join(missing)}.{_what_remains(remaining)}{rest}"
    if verdict == "shape-found":
        known = f"{shape_known(shapes)}: {_shapes(shapes)}."
        return f"{known} No effect of the catalogue explains it."
    if verdict == "unexplained" and remaining.structure is None:
        return too_short(remaining)
    if verdict == "unexplained":
        return (
            "The errors depend on inputs and outputs, so something is missing, but no effect of "
            "the catalogue is significant." + ON_A_RATE * on_rate
        )
    if remaining.above_noise:
        return undecided(remaining)
    if remaining.structured and remaining.within_noise:
        return "Nothing is missing that matters: the errors are no larger than the noise may be."
    if remaining.structured:
        return (
            "No effect of the catalogue is missing: inputs and outputs predict only "
            f"{remaining.share} of the errors beyond the noise."
        )
    return "Nothing is missing that this log could show: the errors look like noise."


def shape_known(shapes: Sequence[FoundShape]) -> str:
    """How far shapes explain the errors, in words: what they leave may be anything."""
    part = min((s.share for s in shapes), default=1.0) < SHAPES.whole
    return f"Shape known{' in part' if part else ''}, physics open"


def _shapes(shapes: Sequence[FoundShape]) -> str:
    """Shapes in words, each with its share of the excess error; alike ones once, by the largest."""
    said = []
    for id in dict.fromkeys(s.id for s in shapes):
        first, *others = sorted((s for s in shapes if s.id == id), key=lambda s: -s.share)
        alike = f", and likewise {', '.join(s.output for s in others)}" if others else ""
        said.append(
            f"{first.sentence} ({100.0 * first.share:.0f} % of the excess error of "
            f"{first.output}{alike})"
        )
    return "; ".join(said)


def _what_remains(remaining: Remaining) -> str:
    closed = remaining.gap.closed_percent
    if remaining.structured and (closed < VERDICT.nearly_all or remaining.above_noise):
        rest = 100.0 - closed
        share = "Less than 1 %" if rest < 1.0 else f"{rest:.0f} %"
        ratios = f" (errors: {remaining.above_noise} the noise)" if remaining.above_noise else ""
        where = f", mostly where {remaining.where}" if remaining.where else ""
        return (
            f" {share} of the error beyond the noise remains{ratios}; inputs and outputs predict "
            f"{remaining.share} of it{where}. It is partly explained, or something else is missing."
        )
    if remaining.above_noise:
        return (
            f" The remaining errors ({remaining.above_noise} the noise) are not correlated with "
            "inputs or outputs: an unrecorded disturbance acts, or the commands are too simple."
        )
    return ""


def too_short(remaining: Remaining) -> str:
    """That too few samples are held out for any test of the errors, and what to do."""
    above = f" ({remaining.above_noise} the noise)" if remaining.above_noise else ""
    return (
        f"{TOO_SHORT}: the errors{above} cannot be tested on so few "
        f"held-out samples. Record at least {LONG_ENOUGH} samples, or give a second log of the "
        "same system."
    )


def undecided(remaining: Remaining) -> str:
    """Why no effect is reported although the errors are far above the noise."""
    if remaining.structure is None:
        return too_short(remaining)
    begin = "No effect is significant, but the errors are not noise: "
    if remaining.structured:
        return begin + (
            f"inputs and outputs predict only {remaining.share} of them. No channel records the "
            f"rest ({remaining.above_noise} the noise)."
        )
    return begin + (
        f"they exceed the measurement noise ({remaining.above_noise}) but depend on no command or "
        "speed. An unrecorded load or disturbance acts, or the log is too short or its commands "
        "too simple."
    )


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
