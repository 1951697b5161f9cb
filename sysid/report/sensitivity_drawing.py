"""When a log shows its parameters, drawn: the share of each one's information over time."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sysid.data.record import Record
from sysid.estimation.information.sensitivity import Sensitivity
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class SensitivityPicture:
    """Inputs above, below the share of each parameter's information that has come in."""

    found: Sensitivity
    record: Record

    def draw(self, figure: "Figure") -> None:
        """Draw it."""
        found, record = self.found, self.record
        figure.set_size_inches(style.WIDTH, 4.5)
        axes: Any = figure.subplots(2, 1, sharex=True, height_ratios=(1, 3))
        for u, channel in zip(record.u.T, record.inputs, strict=True):
            axes[0].step(found.t, u, where="post", linewidth=0.8, label=channel.name)
        axes[0].set_title(f"{record.name}: inputs")
        axes[0].legend(fontsize=7)
        for k, p in enumerate(found.parameters):
            if p.when is not None:
                colour = style.SERIES[k % len(style.SERIES)]
                dashes = ("-", "--", ":")[k // len(style.SERIES) % 3]
                label = f"{p.name} ± {196 * p.relative:.2g} %" if p.value else p.name
                axes[1].plot(found.t, found.course[:, k], dashes, color=colour, label=label)
        axes[1].set_title("share of the information on each parameter that has come in")
        axes[1].set_xlabel("time [s]")
        axes[1].set_ylim(0.0, 1.02)
        axes[1].legend(fontsize=7, loc="lower right")
