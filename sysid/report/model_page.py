"""The page of a model, and of several: can it be trusted, for what, and what shows it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from sysid.criteria.verdicts import ResidualReport
from sysid.data.finding import Finding, Severity
from sysid.data.record import Record
from sysid.errors import SysidError
from sysid.estimation.assessment.delta_method import NORMAL
from sysid.estimation.assessment.figures import Start, outputs
from sysid.report.data_panels import residual_panels
from sysid.report.model_panels import panels_of
from sysid.report.page import Check, Page, Section
from sysid.report.panels import Curve, Panel, Panels, Shown
from sysid.report.style import labelled
from sysid.structures.model import Model
from sysid.structures.orders import orders_text

LONGEST = 20_000
"""Samples of a record that a page shows: the first ones."""

DOTS = 400
"""Dots of a panel at most."""

TIED = 0.95
"""Correlation of two parameters from which they are named together."""


def model_page(
    id: str,
    model: Model,
    report: Mapping[str, Any],
    records: Sequence[Record],
    findings: Sequence[Finding] = (),
    residuals: ResidualReport | None = None,
    *,
    command: str = "",
    quick: bool = False,
) -> Page:
    """The page of one model.

    Args:
        report: what was said of it when it was fitted, as the workspace keeps it.
        records: what judges it.
        findings: of the checks of its log.
        residuals: tests on the data that it was fitted to.
        command: what makes the model again.
        quick: leave out what takes a nonlinear model long: it is run again for every parameter.
    """
    shown = [Shown(id, model)]
    records = [r.rows(0, min(len(r), LONGEST)) for r in records]
    data = ", ".join(dict.fromkeys(r.name for r in records)) or "no data at hand"
    slow = quick and not model.structure.traits.linear
    orders = orders_text(model.structure.order_values())
    fitted = ", ".join(s.name for s in model.provenance.data)
    warnings = tuple(report.get("warnings") or model.warnings)
    words = [
        ("fit", "Measured and simulated"),
        *(() if slow else (("horizon", "Fit against steps ahead"), ("step", "Step response"))),
        ("bode", "Frequency response over the measured one"),
        ("poles", "Poles and zeros"),
        *(() if quick else (("look", "The log itself, before any model"),)),
        *(() if slow or model.structure.traits.linear else (("curve", "Outputs at rest"),)),
    ]
    sections = [
        Section("Checks of the log", text=tuple(_findings(findings, warnings))),
        *(_section(title, word, shown, records) for word, title in words),
        None if residuals is None else Section("Residual tests", residual_panels(residuals, model)),
        Section("Residuals against input and output", _against(model, records)),
        _parameters(model),
        _complexity(report),
        Section("Warnings", text=warnings or ("None.",)),
        Section(
            "Where it comes from",
            text=(
                f"Fitted to {fitted}; shown on {data}. sysid {model.provenance.version}.",
                *(f"{s.name}: SHA-256 {s.sha256}" for s in model.provenance.data),
            ),
            code=(*([command] if command else []), *model.equations()),
        ),
    ]
    return Page(
        f"{id}: {model.structure.traits.title}",
        f"{orders}; fitted to {fitted}, one sample every {model.dt:.4g} s; shown on {data}. "
        "Bands and ± are 95 %.".lstrip("; "),
        tuple(verdict(model, report)),
        tuple(s for s in sections if s is not None and (s.panels or s.text or s.rows or s.code)),
    )


def _section(
    title: str, word: str, shown: Sequence[Shown], records: Sequence[Record]
) -> Section | None:
    """A section of panels; none where the model has nothing of the kind."""
    try:
        panels = panels_of(word, shown, records)
    except SysidError:
        return None
    if word in ("bode", "poles"):
        with suppress(SysidError):  # those of the paths that a step shows
            main = {p.name.partition("-")[2] for p in panels_of("step", shown, ())}
            panels = tuple(p for p in panels if p.name.partition("-")[2] in main)
    return Section(title, panels)


def verdict(model: Model, report: Mapping[str, Any]) -> list[Check]:
    """Whether the model can be trusted, for what, and for what not."""
    checks: list[Check] = []
    part = report.get("validation") or {}
    fits = part.get("fit_percent") or {}
    shown = ", ".join(f"{n} {v:.1f} %" for n, v in fits.items() if v is not None)
    if shown:
        checks.append(("good", f"On data that it was not fitted to ({part['data']}): {shown} fit."))
    else:
        inside = (report.get("estimation") or {}).get("fit_percent") or {}
        known = ", ".join(f"{n} {v:.1f} %" for n, v in inside.items() if v is not None)
        checks.append(("bad", f"Not judged on other data than it was fitted to ({known}): fit "
                              "again with a validation log."))  # fmt: skip
    residuals = report.get("residuals") or {}
    if (free := residuals.get("independence")) is not None:
        if free["passed"]:
            checks.append(("good", "Residuals show no linear effect of the inputs that is left."))
        else:
            checks.append(("bad", "Residuals correlate with the inputs: dynamics are missing, and "
                                  "intervals are narrower than the truth."))  # fmt: skip
    if any(str(w).startswith("Nonlinear response") for w in report.get("warnings") or ()):
        checks.append(("note", "The log shows a nonlinear response: see the warnings."))
    unsure = [p for p in model.parameter_table() if _holds_zero(p.value, p.std_error)]
    if unsure:
        checks.append(("note", f"Intervals that hold zero: {len(unsure)} of {len(model.theta)} "
                               "parameters; fewer would do."))  # fmt: skip
    if not model.stable:
        checks.append(("bad", "Its free run does not settle: not for long simulations."))
    if len(model.ranges):
        seen = ", ".join(
            f"{labelled(c.name, c.unit)} {low:.5g} to {high:.5g}"
            for c, (low, high) in zip(model.inputs, model.ranges, strict=False)
        )
        if seen:
            reach = f"{np.pi / model.dt:.3g} rad/s"
            use = f"For simulation and control within {seen}, up to {reach}; a guess beyond that."
            checks.append(("note", use))
    return checks


def _holds_zero(value: float, std_error: float) -> bool:
    return bool(0.0 < std_error < np.inf and abs(value) <= NORMAL * std_error)


def _findings(findings: Sequence[Finding], warnings: Sequence[str]) -> list[str]:
    """What checks complained of, but for what stands among the warnings, and how many passed."""
    worth = [f for f in findings if f.severity >= Severity.NOTE]
    lines = [f"{f.severity.word}: {f.text}" for f in worth if f.text not in warnings]
    if len(lines) < len(worth):
        lines.append(f"{len(worth) - len(lines)} more: see the warnings.")
    passed = len(findings) - len(worth)
    return [*lines, *([f"ok: {passed} checks."] if passed else [])]


def _against(model: Model, records: Sequence[Record]) -> Panels:
    """Residuals of the free run over each output's input and its simulated value."""
    panels = []
    if not records:
        return ()
    runs = [outputs(model, r, None if model.inputs else 1, Start.ESTIMATED) for r in records]
    for i, y in enumerate(model.outputs):
        error = np.concatenate(
            [r.y[:, i] - run[:, i] for r, run in zip(records, runs, strict=True)]
        )
        over = [(f"simulated {y.name}", y.unit, np.concatenate([run[:, i] for run in runs]))]
        if model.inputs:
            j = min(i, len(model.inputs) - 1)
            u = model.inputs[j]
            over.insert(0, (u.name, u.unit, np.concatenate([r.u[:, j] for r in records])))
        some = slice(None, None, max(len(error) // DOTS, 1))
        for name, unit, x in over:
            dots = Curve("", x[some], error[some], kind="dots")
            panels.append(
                Panel(
                    f"against-{y.name}-{name}",
                    f"{y.name} over {name}",
                    labelled(name, unit),
                    labelled("measured less simulated", y.unit),
                    (dots,),
                    rules=(0.0,),
                )
            )
    return tuple(panels)


def _parameters(model: Model) -> Section:
    """Every parameter in units of itself, with its interval; the table; what is tied together."""
    table = model.parameter_table()
    known = [p for p in table if p.value and 0.0 < p.std_error < np.inf]
    rows = tuple(
        (p.name, f"{p.value:.6g}", "fixed" if p.fixed else f"± {NORMAL * p.std_error:.3g}", p.unit,
         "at its bound" if p.at_bound else "?" if _holds_zero(p.value, p.std_error) else "")
        for p in table
    )  # fmt: skip
    panels: Panels = ()
    if known:
        reach = np.array([min(NORMAL * p.std_error / abs(p.value), 3.0) for p in known])
        one = np.ones(len(known))
        dots = Curve("", np.arange(len(known), dtype=np.float64), one, one - reach, one + reach,
                     kind="dots")  # fmt: skip
        panels = (
            Panel("parameters", "Parameters in units of their estimates", "", "estimate = 1",
                  (dots,), rules=(0.0,), names=tuple(p.name for p in known),
                  note="An interval that reaches 0 belongs to a parameter that may be left out."),
        )  # fmt: skip
    return Section(
        "Parameters",
        panels,
        tuple(_tied(model)),
        ("parameter", "value", "95 %", "unit", ""),
        rows,
    )


def _tied(model: Model) -> list[str]:
    """Pairs of parameters that the data hardly distinguish, the closest first."""
    p = np.asarray(model.covariance)
    error = np.sqrt(np.maximum(np.diag(p), 0.0))
    with np.errstate(all="ignore"):
        rho = p / np.outer(error, error)
    pairs = [
        (abs(rho[i, k]), f"{model.parameters[i].name} and {model.parameters[k].name}")
        for i in range(len(rho))
        for k in range(i)
        if np.isfinite(rho[i, k]) and abs(rho[i, k]) > TIED
    ]
    told = [f"{pair} ({size:.3f})" for size, pair in sorted(pairs, reverse=True)[:6]]
    return [f"Correlated above {TIED:g}: {', '.join(told)}."] if told else []


def _complexity(report: Mapping[str, Any]) -> Section | None:
    """Held-out error of the orders that were tried, over their number of parameters."""
    search = report.get("order_search") or {}
    tried = [c for c in search.get("candidates") or () if c.get("score") is not None]
    if len(tried) < 2:
        return None
    criterion = str(search.get("criterion", "fit"))
    best = Curve("taken", np.array([float(tried[0]["n"])]), np.array([float(tried[0]["score"])]),
                 kind="marks", colour=1)  # fmt: skip
    others = Curve(
        "tried",
        np.array([float(c["n"]) for c in tried]),
        np.array([float(c["score"]) for c in tried]),
        kind="dots",
    )
    panel = Panel("complexity", f"Orders tried ({len(tried)} best)", "parameters",
                  f"{_SCORES.get(criterion, criterion)} (least is best)",
                  (others, best))  # fmt: skip
    return Section("Fit against complexity", (panel,))


_SCORES = {"fit": "held-out error"}
"""What the score of a criterion is called where its name says something else."""


def comparison_page(
    shown: Sequence[Shown], records: Sequence[Record], best: str, notes: Sequence[str] = ()
) -> Page:
    """The page of several models: who leads by how much, and all of them over each other."""
    records = [r.rows(0, min(len(r), LONGEST)) for r in records]
    shown = sorted(shown, key=lambda s: s.label != best)
    data = ", ".join(dict.fromkeys(r.name for r in records))
    words = (
        ("ranking", "Ranking"),
        ("fit", "Measured and simulated"),
        ("horizon", "Fit against steps ahead"),
        ("step", "Step response"),
        ("bode", "Frequency response over the measured one"),
    )
    sections = [_overlaid(title, word, shown, records) for word, title in words]
    return Page(
        f"{len(shown)} models on {data}",
        f"Best: {best}. Bands are 95 %.",
        tuple(("note", n) for n in notes),
        (
            Section(
                "Differences",
                text=("RMSE beyond that of the best model, with 95 % intervals of paired blocks.",),
                heads=("model", "output", "RMSE beyond the best", "95 % interval"),
                rows=tuple(differences(shown, records)),
            ),
            *(s for s in sections if s is not None),
        ),
    )


def _overlaid(
    title: str, word: str, shown: Sequence[Shown], records: Sequence[Record]
) -> Section | None:
    """Those of the models that have something of the kind, over each other."""
    if (together := _section(title, word, shown, records)) is not None:
        return together
    able = []
    for s in shown:
        try:
            panels_of(word, [s], records)
        except SysidError:
            continue
        able.append(s)
    return _section(title, word, able, records) if able else None


BLOCKS = 24
"""Blocks that two models are compared on."""


def differences(
    shown: Sequence[Shown], records: Sequence[Record]
) -> list[tuple[str, str, str, str]]:
    """By how much each model errs more than the first, by output, with paired intervals.

    d = Σ(e² − e₁²) by block; the relative change of the RMSE is √(1 + d̄/ē₁²) − 1, its interval that
    of Student's t of the blocks' d.
    """
    from scipy.special import stdtrit

    squares = {}
    for s in shown:
        runs = [outputs(s.model, r, None, Start.ESTIMATED) for r in records]
        squares[s.label] = np.concatenate(
            [(r.y - run) ** 2 for r, run in zip(records, runs, strict=True)]
        )
    first = squares[shown[0].label]
    rows = []
    for s in shown[1:]:
        for i, y in enumerate(s.model.outputs):
            d, base = squares[s.label][:, i] - first[:, i], float(np.nanmean(first[:, i]))
            blocks = np.array([np.nanmean(b) for b in np.array_split(d, BLOCKS)])
            reach = float(stdtrit(BLOCKS - 1, 0.975) * blocks.std(ddof=1) / np.sqrt(BLOCKS))
            ends = [float(np.nanmean(d)) + k * reach for k in (0.0, -1.0, 1.0)]
            grown = [100.0 * (np.sqrt(max(1.0 + e / base, 0.0)) - 1.0) for e in ends]
            rows.append(
                (s.label, y.name, f"{grown[0]:+.1f} %", f"{grown[1]:+.1f} to {grown[2]:+.1f} %")
            )
    return rows
