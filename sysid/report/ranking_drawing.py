"""The picture of a comparison: models as bars in the order of a criterion, fits beside them."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.data.record import Array
from sysid.errors import DataError
from sysid.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

_ROW = 0.40
_TOP = 0.60
_HEADER = 0.30
_BOTTOM = 0.52
_MARGIN = 0.12
_MOST_ROWS = 30
_MOST_FITS = 4
_LOG_RATIO = 50.0
"""Bars whose lengths differ by more than this are drawn on a logarithmic axis."""

_VERDICTS = {True: ("✓", style.GREEN), False: ("✗", style.VERMILION), None: ("–", style.MUTED)}


@dataclass(frozen=True)
class RankingRow:
    """One model of a comparison.

    Attributes:
        model: its name, as a rule its id in the workspace.
        details: structure and orders, shown small below the name.
        value: the criterion; NaN when it could not be computed.
        text: the value as shown, formatted by the caller.
        fit_percent: fit % per output, or empty.
        passed: whether its residuals pass the tests; None when they were not tested.
    """

    model: str
    details: str
    value: float
    text: str
    fit_percent: tuple[float, ...] = ()
    passed: bool | None = None


@dataclass(frozen=True)
class RankingPicture:
    """What a picture of a comparison shows.

    Attributes:
        title: for instance ``Which model? Ranked by AIC``.
        criterion: name of the criterion, for the axis.
        rows: the models, best first; the first is highlighted.
        outputs: names of the ny outputs, the heads of the columns of fits.
        higher_is_better: whether a larger criterion is better (a fit) or a smaller one (AIC).
        from_best: draw the distance to the best model instead of the value: right for AIC and
            the other logarithmic criteria, whose zero means nothing.
        fit_of: what the fits are fits of; shown in the subtitle.

    Raises:
        DataError: there is no row, or a row has another number of fits than outputs.
    """

    title: str
    criterion: str
    rows: tuple[RankingRow, ...]
    outputs: tuple[str, ...] = ()
    higher_is_better: bool = False
    from_best: bool = False
    fit_of: str = "free-run simulation"

    def __post_init__(self) -> None:
        if not self.rows:
            raise DataError("a ranking needs at least one model")
        for row in self.rows:
            if len(row.fit_percent) not in (0, len(self.outputs)):
                raise DataError(
                    f"{row.model}: {len(row.fit_percent)} fits for {len(self.outputs)} outputs"
                )

    def draw(self, figure: "Figure") -> None:
        """Draw the table; bars take the room that the texts around them leave."""
        rows = self.rows[:_MOST_ROWS]
        hidden = len(self.rows) - len(rows)
        subtitle = f"best first; fit in % of {self.fit_of}"
        height = _TOP + _HEADER + _ROW * len(rows) + _BOTTOM
        style.heading(
            figure, height, self.title, subtitle + (f"; {hidden} more not shown" * bool(hidden))
        )
        figure.set_layout_engine("none")  # every panel is placed by the width of the texts
        page = _page(figure, len(rows))
        left = _write_names(page, rows)
        right = _write_columns(page, self, rows)
        width, height = figure.get_size_inches()
        place = (
            left / width,
            _BOTTOM / height,
            max(right - left, 0.5) / width,
            _ROW * len(rows) / height,
        )
        _draw_bars(figure.add_axes(place), self, rows)


def _page(figure: "Figure", n: int) -> "Axes":
    """An invisible panel for the texts: x in inches, y in rows from the top."""
    width, height = figure.get_size_inches()
    page = figure.add_axes((0.0, _BOTTOM / height, 1.0, (_ROW * n + _HEADER) / height))
    page.set_axis_off()
    page.set_xlim(0.0, width)
    page.set_ylim(n, -_HEADER / _ROW)
    for k in range(0, n, 2):
        page.axhspan(k, k + 1, _MARGIN / width, 1 - _MARGIN / width, color="#f6f7f9", linewidth=0)
    return page


def _write_names(page: "Axes", rows: tuple[RankingRow, ...]) -> float:
    """Write rank, name and orders; return where the bars may begin [in]."""
    at, widest = _MARGIN + 0.40, 0.0
    for k, row in enumerate(rows):
        best = k == 0
        page.text(
            at - 0.12,
            k + 0.5,
            f"{k + 1}",
            ha="right",
            va="center",
            color=style.BLUE if best else style.MUTED,
            weight="bold" if best else "normal",
        )
        texts = [page.text(at, k + 0.36, row.model, va="center", weight="bold")]
        texts[0].set_color(style.BLUE if best else style.INK)
        if row.details:
            texts.append(
                page.text(at, k + 0.72, row.details, va="center", size=7.0, color=style.MUTED)
            )
        else:
            texts[0].set_y(k + 0.5)
        for text in texts:
            style.shorten(text, 2.9)
            widest = max(widest, style.width_inches(text))
    return at + widest + 0.2


def _write_columns(page: "Axes", picture: RankingPicture, rows: tuple[RankingRow, ...]) -> float:
    """Write verdicts, fits and values from the right edge on; return where the bars must end."""
    edge = style.WIDTH - _MARGIN - 0.12
    if any(row.passed is not None for row in rows):
        texts = _column(page, edge, "residuals", [_VERDICTS[row.passed][0] for row in rows])
        for text, row in zip(texts[:-1], rows, strict=True):
            text.set_color(_VERDICTS[row.passed][1])
        edge -= 0.78
    for head, values in reversed(_fit_columns(picture, rows)):
        texts = _column(page, edge, head, [style.percent(v) for v in values])
        finite = np.where(np.isfinite(values), values, -np.inf)
        texts[int(finite.argmax())].set_fontweight("bold")
        edge -= max(0.72, style.width_inches(texts[-1]) + 0.2)
    texts = _column(
        page, edge, _heading(picture.criterion), [row.text.replace("-", "−") for row in rows]
    )
    widest = max(style.width_inches(text) for text in texts)
    return edge - max(widest, 0.5) - 0.2


def _fit_columns(picture: RankingPicture, rows: tuple[RankingRow, ...]) -> list[tuple[str, Array]]:
    """Heads and values: a column per output, or the mean and the worst of many outputs."""
    if not any(row.fit_percent for row in rows):
        return []
    fits = np.array([row.fit_percent or (np.nan,) * len(picture.outputs) for row in rows])
    if len(picture.outputs) > _MOST_FITS:
        return [("mean fit", fits.mean(axis=1)), ("worst fit", fits.min(axis=1))]
    return [(name, fits[:, j]) for j, name in enumerate(picture.outputs)]


def _column(page: "Axes", right: float, head: str, cells: list[str]) -> "list[Text]":
    """Write a column flush right at ``right`` [in] and return its texts, the head last."""
    title = page.text(
        right, -0.38, head, ha="right", va="center", size=style.SMALL, color=style.MUTED
    )
    style.shorten(title, 0.85)
    texts = [page.text(right, k + 0.5, c, ha="right", va="center") for k, c in enumerate(cells)]
    for text in texts:
        style.shorten(text, 1.2)
    return [*texts, title]


def _draw_bars(axes: "Axes", picture: RankingPicture, rows: tuple[RankingRow, ...]) -> None:
    values = np.array([row.value for row in rows], dtype=np.float64)
    name = _heading(picture.criterion)
    if picture.from_best:
        values = np.abs(values - values[0])
        name = f"Δ{name}: distance to the best"
    finite = np.isfinite(values)
    positive = values[finite & (values > 0)]
    spread = positive.size > 1 and positive.max() > _LOG_RATIO * positive.min()
    if spread and not picture.higher_is_better and values[finite].min() >= 0:
        decade = 10.0 ** np.floor(np.log10(positive.min()))
        axes.set_xscale("symlog", linthresh=decade, linscale=0.5)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        name += " (log scale)"
    k = np.arange(len(rows))
    colours = [style.BLUE] + ["#b7c3ce"] * (len(rows) - 1)
    axes.barh(k[finite] + 0.5, values[finite], 0.5, color=[colours[i] for i in k[finite]])
    if finite[0] and picture.from_best:
        axes.plot(0.0, 0.5, marker="o", color=style.BLUE, markersize=6.0, clip_on=False, zorder=5)
    for i in k[~finite]:
        at = (0.0, i + 0.5)
        style.words(axes, "not comparable", at, (4.0, 0.0), va="center", color=style.MUTED)
    if not finite.any() or not np.any(values[finite]):
        axes.set_xlim(0.0, 1.0)
    elif not spread:
        axes.set_xlim(min(0.0, 1.04 * values[finite].min()), max(0.0, 1.04 * values[finite].max()))
    axes.set_ylim(len(rows), 0)
    axes.set_facecolor("none")
    axes.yaxis.set_visible(False)
    axes.grid(visible=True, axis="x")
    axes.spines["left"].set_visible(bool(np.all(values[finite] >= 0)))
    style.shorten(axes.set_xlabel(name), 4.0)


def _heading(criterion: str) -> str:
    """AIC, BIC … are written in capitals, fit and loss are words."""
    return criterion if criterion in ("fit", "loss", "rmse") else criterion.upper()
