"""Drawing a shape: its curve with the 95 % band."""

from typing import TYPE_CHECKING

from sysid.diagnosis.shapes.shape import Curve
from sysid.report import style
from sysid.report.layout import WIDTH

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEIGHT = 2.1
"""Of a picture [in]."""


def draw_curve(figure: "Figure", curve: Curve) -> None:
    """The curve over its axis, and its band."""
    figure.set_size_inches(WIDTH, HEIGHT)
    axes = figure.add_subplot()
    axes.fill_between(curve.x, curve.low, curve.high, color=style.BLUE, alpha=0.18, linewidth=0)
    axes.plot(curve.x, curve.y, color=style.BLUE, linewidth=1.4)
    axes.set_xlabel(curve.x_label)
    axes.set_ylabel(curve.y_label)
    axes.locator_params(axis="x", nbins=5)
    axes.locator_params(axis="y", nbins=5)
