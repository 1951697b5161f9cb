"""What is said of a log: the verdict, why, and why nothing is named where errors are loud."""

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.diagnosis.diagnosis import OF_THE_LOG
from sysid.diagnosis.gap import Gap
from sysid.diagnosis.policies import VERDICT
from sysid.diagnosis.study import structured
from sysid.diagnosis.validation.model_error import ResidualStructure

LONG_ENOUGH = 800
"""Samples whose held-out part, three blocks of 80, is left with twice as many samples as terms of
the model of the errors: whitening takes 20 of each block, the terms are some 40."""

ON_A_RATE = (
    " Effects were looked for on the rate of the output, which integrates its input. Play in a "
    "gear (backlash) is looked for on a speed, and differences of a position may be too coarse to "
    "show it: record the speed as well."
)


@dataclass(frozen=True, eq=False)
class Remaining:
    """What the errors of the model after hold.

    Attributes:
        structure: what they depend on; None where too few samples tell.
        gap: the gap before and after.
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
        """Whether their structure is more than a slight one that may be chance."""
        if self.structure is None or not self.structured:
            return False
        sure = self.structure.p_value < VERDICT.certain and bool(self.loud)
        return sure or self.structure.share >= VERDICT.slight

    @property
    def share(self) -> str:
        """How much of them is foretold, in per cent."""
        return f"{100.0 * self.structure.share:.0f} %" if self.structure is not None else ""

    @property
    def loud(self) -> str:
        """Outputs whose errors are far above the noise, and how far; empty where there is none."""
        return ", ".join(
            f"{name} {c.rmse_after / c.noise_floor:.1f} times"
            for name, c in self.gap.channels.items()
            if c.rmse_after > VERDICT.loud * c.surely_noise > 0.0
        )


def verdict_of(ids: Sequence[str], remaining: Remaining, missing: bool) -> str:
    """``effects-found``, ``no-missing-effect`` or ``unexplained``.

    Args:
        ids: what was named.
        remaining: what the errors of the model after hold.
        missing: whether something else shows that something is missing.
    """
    # what is a matter of the log is no missing effect and explains no error
    if any(id not in OF_THE_LOG for id in ids):
        return "effects-found"
    return "unexplained" if missing or remaining.matters else "no-missing-effect"


def story(verdict: str, ids: Sequence[str], remaining: Remaining, on_rate: bool = False) -> str:
    """Why this verdict, in a sentence or two.

    Args:
        verdict: see ``verdict_of``.
        ids: what was named.
        remaining: what the errors of the model after hold.
        on_rate: whether effects were looked for on the rate of the output.
    """
    missing = [id for id in ids if id not in OF_THE_LOG]
    if verdict == "effects-found" and missing:
        return f"Missing: {', '.join(missing)}.{_what_remains(remaining)}"
    if verdict == "unexplained":
        return (
            "The errors depend on what is known, so something is missing, but no effect of the "
            "catalogue is proven to be it." + ON_A_RATE * on_rate
        )
    if remaining.loud:
        return undecided(remaining)
    if remaining.structured:
        return (
            "Nothing of the catalogue is missing: what is known predicts only "
            f"{remaining.share} of the errors beyond the noise."
        )
    return "Nothing is missing that this log could show: the errors look like noise."


def _what_remains(remaining: Remaining) -> str:
    closed = remaining.gap.closed_percent
    if remaining.structured and (closed < VERDICT.nearly_all or remaining.loud):
        rest = 100.0 - closed
        share = "Less than 1 %" if rest < 1.0 else f"{rest:.0f} %"
        loud = f" (errors: {remaining.loud} the noise)" if remaining.loud else ""
        where = f", mostly where {remaining.where}" if remaining.where else ""
        return (
            f" {share} of the error beyond the noise is left{loud} and still follows inputs and "
            f"outputs ({remaining.share} foretold by them{where}): what is named fits only in "
            "part, or something else is missing, too."
        )
    if remaining.loud:
        return (
            f" The errors that remain ({remaining.loud} the noise) depend on nothing known: a "
            "disturbance acts that no channel records, or the commands are too simple to tell."
        )
    return ""


def undecided(remaining: Remaining) -> str:
    """Why nothing is named where errors are far above the noise of the readings."""
    if remaining.structure is None:
        return (
            f"The log is too short to tell what is missing: the errors ({remaining.loud} the noise "
            "of the readings) cannot be tested on so few held-out samples; record at least "
            f"{LONG_ENOUGH} samples, or name a second log of the same system to judge by."
        )
    begin = "No effect is shown, but the errors are not noise: "
    if remaining.structured:
        return begin + (
            f"what is known predicts only {remaining.share} of them. The rest ({remaining.loud} "
            "the noise of the readings) no channel records."
        )
    return begin + (
        f"they are larger than that of the readings ({remaining.loud}), yet depend on no "
        "command and no speed. A load or a disturbance acts that no channel records, or the log is "
        "too short or its commands too simple to tell."
    )
