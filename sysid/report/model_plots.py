"""``model.plot``: what ``sysid plot`` draws, as figures of matplotlib."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from sysid.data.record import Record
from sysid.report.model_panels import WHAT, panels_of
from sysid.report.panels import PanelPicture, Shown
from sysid.report.plots import figure_of
from sysid.structures.model import Model
from sysid.structures.orders import orders_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class ModelPlots:
    """A method for each word of ``sysid plot``: ``plot.step()``, ``plot.fit(record)``."""

    def __init__(self, model: Model) -> None:
        self._model = model

    def __dir__(self) -> list[str]:
        return list(WHAT)

    def __getattr__(self, what: str) -> "Callable[..., Figure]":
        if what not in WHAT:
            raise AttributeError(f"a model has no plot {what!r}; choose one of {', '.join(WHAT)}")
        return partial(self._drawn, what)

    def _drawn(
        self, what: str, records: Record | Sequence[Record] = (), *others: Model
    ) -> "Figure":
        """The figure of a word, other models over this one."""
        data = (records,) if isinstance(records, Record) else tuple(records)
        models = (self._model, *others)
        orders = [orders_text(m.structure.order_values()) for m in models]
        shown = [Shown(f"{m.structure.name} {o}".rstrip(), m)
                 for m, o in zip(models, orders, strict=True)]  # fmt: skip
        panels = panels_of(what, shown, data)
        title = f"{what}: {', '.join(s.label for s in shown)}"
        return figure_of(PanelPicture(title, ", ".join(r.name for r in data), panels))
