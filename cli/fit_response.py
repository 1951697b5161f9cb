"""``sysid fit`` of a frequency response: `.frd.csv` in, a model out."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.errors import UsageError
from sysid.workspace.store import Workspace

from . import render

if TYPE_CHECKING:
    from sysid.estimation.response_fit import ResponseFit

TRIED = ("process", "tf")
"""What is fitted where no structure is named."""


def is_response(logs: list[Path]) -> bool:
    """Whether what is to be fitted is a frequency response."""
    found = [p for p in logs if p.name.lower().endswith(".frd.csv")]
    if found and len(logs) > 1:
        raise UsageError(f"{found[0].name} is a frequency response, which is fitted by itself")
    return bool(found)


def fit_response(
    path: Path,
    structures: tuple[str, ...],
    orders: str | None,
    options: Mapping[str, str],
    band: tuple[float, float] | None,
    workspace: Path,
    json: bool,
) -> None:
    """Fit structures to a response, store them, and say what the best one is."""
    from sysid.data.frequency_response import read_frequency_response
    from sysid.estimation.response_fit import fit_response as fitted

    response = read_frequency_response(path)
    found = [fitted(response, name, orders, options, band) for name in structures or TRIED]
    found.sort(key=lambda f: (round(f.error, 4), f.model.n_estimated))
    store = Workspace(workspace)
    reports = [{"response_fit": {"error": f.error, "relative": f.relative}} for f in found]
    stored = [store.save(f.model, r) for f, r in reversed(list(zip(found, reports, strict=True)))][
        ::-1
    ]
    store.remember("latest", [s.id for s in stored])
    if json:
        render.document(
            {
                "models": [
                    {"model": s.id, "parameters": f.model.parameter_table(), **r["response_fit"]}
                    for s, f, r in zip(stored, found, reports, strict=True)
                ]
            }
        )
        return
    rows = [_row(f) for f in found]
    title = f"{path.name}: {len(response.frequency)} frequencies"
    render.table(("model", "orders", "par.", "weighed error", "relative error"), rows, title)
    best = found[0]
    for line in best.model.equations():
        render.say(line)
    render.parameters(best.model)
    if not best.weighed:
        render.say("The response has no errors of its own: they count relative to its size.")
    elif best.error > 2.0:
        render.say(f"! {best.error:.1f} times its errors are left: another structure, or more.")
    render.say(f"Saved {stored[0].id}. Next: sysid plot bode {stored[0].id} | sysid export")


def _row(f: "ResponseFit") -> tuple[str, ...]:
    from sysid.structures.orders import orders_text

    structure = f.model.structure
    return (
        structure.name,
        orders_text(structure.order_values()),
        str(f.model.n_estimated),
        f"{f.error:.3g}",
        f"{100.0 * f.relative:.2g} %",
    )
