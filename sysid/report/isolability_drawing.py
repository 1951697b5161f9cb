"""What a log can distinguish, drawn: angles between the signatures of effects."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.diagnosis.isolability import Isolability
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 24
"""Effects drawn: those that would show best."""

FAR = 90.0


def draw_isolability(figure: "Figure", found: Isolability) -> None:
    """A table of angles [deg]: dark where a log could distinguish two effects, else crossed."""
    n = min(len(found.ids), MOST)
    figure.set_size_inches(style.WIDTH, 1.6 + 0.2 * n)
    axes: Any = figure.subplots()
    angles = np.where(np.tri(n, k=-1, dtype=bool), found.angles[:n, :n], np.nan)
    drawn = axes.imshow(angles, cmap="Blues", vmin=0.0, vmax=FAR, aspect="auto")
    at = {id: k for k, id in enumerate(found.ids[:n])}
    for pair in found.pairs:
        a, b = (at.get(id, n) for id in pair.effects)
        if max(a, b) < n:
            axes.text(min(a, b), max(a, b), "×", ha="center", va="center", color=style.VERMILION)
    names = [id if shown else f"({id})" for id, shown in zip(found.ids, found.shown, strict=True)]
    axes.set_xticks(range(n), names[:n], rotation=90, fontsize=7)
    axes.set_yticks(range(n), names[:n], fontsize=7)
    axes.grid(visible=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.colorbar(drawn, ax=axes, label="angle [deg]", shrink=0.7)


@dataclass(frozen=True, eq=False)
class IsolabilityPicture:
    """The same as a picture of its own."""

    found: Isolability

    def draw(self, figure: "Figure") -> None:
        """Draw it."""
        draw_isolability(figure, self.found)
