"""The content of a picture of a fit: stretches of data, fits, residual tests."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from sysid.data.record import Array, Channel, frozen
from sysid.errors import DataError
from sysid.report.correlation_panels import LagTest

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class FitSegment:
    """A stretch of one record that played one part.

    Attributes:
        t: sample instants [s], increasing, shape (N,), N ≥ 1.
        measured: measured outputs, shape (N, ny); NaN where nothing was measured.
        simulated: outputs of the model, shape (N, ny); NaN where it gave none.
        u: inputs, shape (N, nu); nu may be 0.
        part: whether the model was fitted to these samples or only judged on them.
        label: what to call the stretch, as a rule the record's name; empty for nothing.

    Raises:
        DataError: the lengths or widths differ, or there is no sample.
    """

    t: Array
    measured: Array
    simulated: Array
    u: Array
    part: Literal["estimation", "validation"] = "estimation"
    label: str = ""

    def __post_init__(self) -> None:
        for name in ("measured", "simulated", "u"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        object.__setattr__(self, "t", frozen(self.t, 1)[:, 0])
        shapes = {len(self.t), len(self.measured), len(self.simulated), len(self.u)}
        if len(shapes) != 1 or self.measured.shape != self.simulated.shape or 0 in shapes:
            raise DataError(
                f"segment {self.label!r}: t {self.t.shape}, measured {self.measured.shape}, "
                f"simulated {self.simulated.shape} and u {self.u.shape} have incompatible shapes"
            )

    @property
    def step(self) -> float:
        """Usual distance of two samples [s]; 1 for a single sample."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 1.0

    def follows(self, other: "FitSegment") -> bool:
        """Whether this stretch starts where ``other`` ended, within half a sample."""
        return bool(abs(self.t[0] - other.t[-1] - other.step) < 0.5 * other.step)


@dataclass(frozen=True, eq=False)
class FitPicture:
    """What a picture of a fit shows.

    Attributes:
        title: the model, for instance ``oe-1: OE, nb = 2, nf = 2, nk = 1``.
        segments: stretches of data in the order drawn. A stretch that starts where the one
            before it ended continues it (a split record); any other starts behind a separator.
        horizon: how the model's output was made; shown in the subtitle.
        initial_state: how its initial state was found; shown in the subtitle.
        estimation_fit: fit % per output on the estimation data, or empty.
        validation_fit: fit % per output on the validation data, or empty.
        whiteness: the test of the residuals against their past, one per output, or empty.
        independence: that against past inputs, one per output, or empty.
        feedback: that against future inputs, one per output, or empty.

    Raises:
        DataError: a segment does not have the channels named.
    """

    title: str
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    segments: tuple[FitSegment, ...]
    horizon: str = "free-run simulation"
    initial_state: str = ""
    estimation_fit: tuple[float, ...] = ()
    validation_fit: tuple[float, ...] = ()
    whiteness: tuple[LagTest, ...] = ()
    independence: tuple[LagTest, ...] = ()
    feedback: tuple[LagTest, ...] = ()

    def draw(self, figure: "Figure") -> None:
        """Draw a block of panels per output, then the inputs, all on one time axis."""
        from sysid.report.fit_drawing import draw

        draw(figure, self)

    def __post_init__(self) -> None:
        ny, nu = len(self.outputs), len(self.inputs)
        if ny == 0 or not self.segments:
            raise DataError("a picture of a fit needs an output and a segment of data")
        for segment in self.segments:
            if segment.measured.shape[1] != ny or segment.u.shape[1] != nu:
                raise DataError(
                    f"segment {segment.label!r} has {segment.measured.shape[1]} outputs and "
                    f"{segment.u.shape[1]} inputs; {ny} and {nu} are named"
                )
        fits = ("estimation_fit", "validation_fit")
        per_output = (*fits, "whiteness", "independence", "feedback")
        for name in per_output:
            if len(getattr(self, name)) not in (0, ny):
                raise DataError(f"{name} needs one entry per output ({ny}), or none")
