"""``sysid forecast``: what comes after a log, with bands that grow."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid.errors import UsageError
from sysid.workspace.logs import as_fitted
from sysid.workspace.store import Workspace

from . import reading, render, targets
from .options import argument, command, group, option

if TYPE_CHECKING:
    from sysid.data.reading.read_options import ReadOptions
    from sysid.estimation.assessment.forecast import Forecast

ROWS = 8
"""Most rows of the table on the screen."""


@command
def forecast(
    log: Path = argument("LOG", "What was measured so far."),
    steps: int = option("N", "Samples to forecast.", default=20, min=1),
    at: float | None = option(
        "SECONDS", "Use nothing after this instant; what the log holds then is shown beside [end]."
    ),
    model: str | None = reading.model("Which model [of the last diagnosis, comparison or fit]."),
    output: Path | None = targets.picture_target(
        "Picture: .svg, .png or .pdf [WORKSPACE/forecast.svg].", "-o"
    ),
    save: Path | None = targets.data_target("--save", "Also write the numbers, with 95 % bands."),
    read: "ReadOptions" = group(reading.Reading, hidden=True),
    workspace: Path = reading.WORKSPACE,
    json: bool = reading.JSON,
) -> None:
    """Forecast the outputs after a log, with 95 % bands.

    Inputs after that instant are those of the log as far as it goes, then its last ones.
    """
    from sysid.data.files import write_atomic
    from sysid.data.preparation import Preparation, read_prepared
    from sysid.estimation.assessment.forecast import forecast as forecast_of
    from sysid.report.data_panels import forecast_panels
    from sysid.report.panels import draw_panels

    store = Workspace(workspace)
    stored = store.chosen(model)
    read, steps_before = as_fitted(stored, read, Preparation())
    records, _ = read_prepared([log], read, steps_before, stored.model.dt)
    if at is not None and not any(r.t[0] <= at <= r.t[-1] for r in records):
        raise UsageError(f"`at`: {at:g} s lies outside the log")
    record = next((r for r in records if at is not None and r.t[0] <= at <= r.t[-1]), records[-1])
    found = forecast_of(stored.model, record, steps, at)
    path = output or store.root / "forecast.svg"
    head = f"{stored.id}: {steps} samples after {record.t[found.first - 1]:.6g} s"
    draw_panels(path, head, f"data: {record.name}; bands: 95 %", forecast_panels(found))
    if save is not None:
        write_atomic(save, found.table())
    if json:
        render.document({"model": stored.id, **_document(found), "picture": path, "data": save})
        return
    render.say(f"{head}.")
    if record.nu and found.held < steps:
        render.say(f"The inputs keep their last values from {found.t[found.held]:.6g} s on.")
    _table(found)
    render.files({"picture": path, "data": save}, picture="Picture", data="Numbers")


def _document(f: "Forecast") -> dict[str, Any]:
    names = [c.name for c in f.record.outputs]
    columns = {"forecast": f.y, "low": f.low, "high": f.high, "measured": f.measured}
    return {
        "t": f.t,
        "inputs": dict(zip([c.name for c in f.record.inputs], f.u.T, strict=True)),
        **{word: dict(zip(names, m.T, strict=True)) for word, m in columns.items()},
        "inside": {n: _inside(f, i) for i, n in enumerate(names)},
    }


def _inside(f: "Forecast", i: int) -> float | None:
    """Share of the measured samples that lie in the band; None where none was measured."""
    import numpy as np

    seen = np.isfinite(f.measured[:, i])
    if not seen.any():
        return None
    y = f.measured[seen, i]
    return float(np.mean((f.low[seen, i] <= y) & (y <= f.high[seen, i])))


def _table(f: "Forecast") -> None:
    rows = []
    import numpy as np

    chosen = np.unique(np.geomspace(1, len(f.t), min(ROWS, len(f.t))).round().astype(int)) - 1
    for k in chosen:
        for i, c in enumerate(f.record.outputs):
            half = float(f.high[k, i] - f.y[k, i])
            seen = f.measured[k, i]
            rows.append(
                [
                    f"{f.t[k]:.6g}",
                    c.name,
                    f"{f.y[k, i]:.5g} ± {half:.2g} {c.unit}".strip(),
                    f"{seen:.5g}" if np.isfinite(seen) else "",
                ]
            )
    render.table(["time [s]", "output", "forecast, 95 %", "measured"], rows)
    shares = [(c.name, _inside(f, i)) for i, c in enumerate(f.record.outputs)]
    if said := [f"{100 * s:.0f} % of {n}" for n, s in shares if s is not None]:
        render.say(f"Inside the band: {', '.join(said)}.")
