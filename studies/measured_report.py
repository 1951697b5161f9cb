"""``structures_on_data.md``: what the linear structures reach on measured records."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from studies.measured_records import PROTOCOLS, Protocol, available
from sysid.estimation.assessment.findings import Assessment, Policy
from sysid.estimation.identify import Identification, Request, identify
from sysid.report.markdown import table
from sysid.structures.orders import orders_text

HEAD = """# The linear structures on measured records

`sysid fit` without options on records of real machines: the four linear structures, their orders
searched on the estimation data alone, means removed, judged on the validation data. The winner
stands first; it is chosen without a look at the validation data, so it need not be the best of its
table. *n* counts the estimated numbers, initial states included. Free run: only the input is given,
from a state estimated at the head of the validation data. *Residuals* are those on the estimation
data: whether the tests of independence from the input, and of whiteness where there is a noise
model, pass at 99 %. Most of these machines are nonlinear, so that most tests fail, and rightly so.

Left out: EMPS, recorded as a position in closed loop, and Silverbox, whose linear figures stand in
[published_figures.md](published_figures.md).
"""


def write(_folder: Path) -> Mapping[str, str]:
    """The table, or nothing where the records are missing."""
    if not available():
        return {}
    parts = [HEAD]
    for protocol in PROTOCOLS:
        print(f"  {protocol.name}", flush=True)
        parts += [
            f"## {protocol.name}\n",
            f"{_described(protocol)}\n",
            _table(_identified(protocol)),
        ]
    return {"structures_on_data.md": "\n".join(parts)}


def _described(p: Protocol) -> str:
    what = p.what[0].upper() + p.what[1:]
    return f"{what}. Estimation / validation: {p.division}."


def _identified(p: Protocol) -> Identification:
    inside, outside = p.read()
    request = Request(
        jobs=2,
        # as the protocols have it; a robot's zeros are physical
        detrend="none" if inside.is_robot_log else "mean",
        policy=Policy(skip=p.skip),
    )
    return identify([inside], [outside], request)


def _table(found: Identification) -> str:
    headers = [
        "structure",
        "orders",
        "n",
        "output",
        "free run %",
        "RMSE",
        "one step %",
        "residuals",
    ]
    rows = [row for a in found.assessments for row in _rows(a)]
    text = table(headers, rows, "llrlrrrl")
    failed = [f"- {name} could not be fitted: {why}" for name, why in found.failed.items()]
    return "\n".join([text, *failed]) if failed else text


def _rows(a: Assessment) -> Sequence[Sequence[str]]:
    judged = a.judged
    model = a.model
    lines = []
    for k, name in enumerate(judged.free_run.fit_percent):
        first = k == 0
        lines.append(
            [
                model.structure.name if first else "",
                orders_text(model.structure.order_values()) if first else "",
                str(model.n_estimated) if first else "",
                name,
                _fit(judged.free_run.fit_percent[name]),
                f"{judged.free_run.rmse[name]:.3g}",
                _fit(judged.one_step.fit_percent[name]),
                ("pass" if a.residuals.passed else "fail") if first else "",
            ]
        )
    return lines


def _fit(percent: float) -> str:
    return f"{percent + 0.0:.1f}" if percent == percent else "–"
