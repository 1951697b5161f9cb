"""Chapter 5, the data-driven half: logs, the accepted model and its figures."""

from functools import cache

import numpy as np

from sysid.criteria.information import information_criteria
from sysid.data.record import Array, Record
from sysid.estimation.assessment.figures import Start, figures, outputs
from sysid.report.panels import PanelPicture, panel
from thesis.entries import DRAWN, MISPRINT, Row, Sheet, compared, line, number, verdict
from thesis.plants import bundled, published_model

LOG = "the thesis's logs are not printed, ours are those of the bundled twin"

PUBLISHED_FIT = (91.474, 91.8968)
PUBLISHED_LOSS, PUBLISHED_FPE, PUBLISHED_AIC = 1.2013e-6, 1.2013e-6, -4.2330e4

TESTS = ("forward_back_val", "rotation_val", "multilevel_val")
"""What the validation tests 1 to 3 are here: both kinds of experiment and the whole range."""


def logs() -> Sheet:
    """5.16–5.19."""
    panels, rows = [], []
    for name, (commands, speeds), title in (
        ("forward_back", ("5.16", "5.18"), "forward and backward"),
        ("rotation", ("5.17", "5.19"), "rotation"),
    ):
        record = bundled(name)
        t = record.dt * np.arange(len(record))
        for number_, table, up in (
            (commands, record.u / 1e3, "PWM [10³ µs]"),
            (speeds, record.y, "ω [rad/s]"),
        ):
            lines = tuple(line(side, t, table[:, k]) for k, side in enumerate(("left", "right")))
            panels.append(panel(f"{number_}: {title}", "time [s]", up, lines))
        levels = np.unique(np.abs(record.u[:, 0]))[1:]
        rows += [
            Row(commands, "pulses [µs]", "a pulse, a pause, the opposite pulse; up to 20000",
                f"{number(levels.min(), '.0f')} to {number(levels.max(), '.0f')}, "
                f"{len(levels)} heights", "–", LOG),
            Row(speeds, "largest speed, left and right [rad/s]", DRAWN,
                " and ".join(number(v, ".1f") for v in np.abs(record.y).max(axis=0)), "–", LOG),
        ]  # fmt: skip
    picture = PanelPicture("Experiments", "bundled logs of the twin", tuple(panels), columns=2)
    return Sheet(tuple(rows), "chapter5/logs.svg", picture)


def validation() -> Sheet:
    """5.21–5.23: free runs of the accepted structure on records it has not seen."""
    model, panels, rows = published_model(), [], []
    sides = ("left", "right")
    for k, name in enumerate(TESTS):
        record = bundled(name)
        y_hat = outputs(model, record, None, Start.ESTIMATED)
        found = figures(model, [record], "validation", None, Start.ESTIMATED)
        fits = tuple(found.fit_percent.values())
        for side, published, fit in zip(sides, PUBLISHED_FIT, fits, strict=True):
            rows.append(
                compared(
                    f"5.{21 + k}",
                    f"fit of `{name}`, {side} [%]",
                    published,
                    fit,
                    ".2f",
                    "one pair is printed for all tests; " + LOG,
                )
            )
        shown = slice(0, 300)
        t = record.dt * np.arange(len(record))[shown]
        for j, side in enumerate(sides):
            lines = (
                line("measured", t, record.y[shown, j], True),
                line("model", t, y_hat[shown, j]),
            )
            panels.append(panel(f"5.{21 + k}: {side}", "time [s]", "ω [rad/s]", lines))
    rows.append(_with_both_tracks())
    rows += _weak_ranges(bundled(TESTS[-1]), outputs(model, bundled(TESTS[-1]), None, Start.ZERO))
    order = (0, 2, 4, 1, 3, 5)
    words = "NARX with a wavelet network, nₐ = I, n_b = n_k = 1, from `multilevel`; 30 s of each"
    picture = PanelPicture("Validation tests", words, tuple(panels[i] for i in order))
    return Sheet(tuple(rows), "chapter5/validation.svg", picture)


def _with_both_tracks() -> Row:
    """What nₐ = I leaves out: one regressor more in the equation of the left track."""
    model = published_model("na=1,1;0,1 nb=1 nk=1")
    found = figures(model, [bundled("multilevel_val")], "validation", None, Start.ESTIMATED)
    fit = number(next(iter(found.fit_percent.values())), ".2f")
    return Row("5.23", "`multilevel_val`, left, with the right track's speed [%]", "–",
        fit, "–", "why 91.47 is not reached: nₐ = I leaves this regressor out")  # fmt: skip


def _weak_ranges(record: Record, y_hat: Array) -> list[Row]:
    """Where the model is least reliable, by size of the command; and in reverse."""
    error, size = np.abs(record.y - y_hat), np.abs(np.vstack([np.zeros((1, 2)), record.u[:-1]]))
    parts = [100 * error[where].mean() / np.abs(record.y[where]).mean() for where in
             (size < 5000, (size >= 5000) & (size <= 18000), size > 18000)]  # fmt: skip
    backward = np.sign(record.u) * np.sign(record.y)
    forward = error[(record.u > 0) & (backward > 0)].mean()
    reverse = error[(record.u < 0) & (backward > 0)].mean()
    return [
        Row("§5.5", "mean error over mean speed below 5000, to 18000, above [%]",
            "least in the middle: friction below, saturation above",
            ", ".join(number(p, ".1f") for p in parts),
            verdict(parts[1] == min(parts)),
            "below as described; above, the twin's sharp saturation is what wavelets can follow"),
        Row("§5.5", "mean error forward and in reverse [rad/s]",
            "in reverse the robot answers with a slight delay",
            f"{number(forward, '.2f')} and {number(reverse, '.2f')}",
            verdict(reverse > 1.1 * forward),
            "the twin is as quick in reverse as forward"),
    ]  # fmt: skip


@cache
def _criteria() -> dict[str, float]:
    model = published_model()
    errors = model.residuals(bundled("multilevel"))
    return information_criteria([errors], len(model.theta))


def criteria() -> Sheet:
    """The figures printed with the model, and whether they agree with each other."""
    ours = _criteria()
    samples = implied_samples()
    sigma = PUBLISHED_LOSS**0.25
    spread = sigma / (1.0 - np.mean(PUBLISHED_FIT) / 100.0)
    most = samples * 0.5e-10 / PUBLISHED_FPE / 2.0
    rows = (
        Row("Table in 5.5", "LossFcn, det of the errors' covariance", "1.2013e−6",
            number(ours["loss"], ".3g"), "× " + number(ours["loss"] / PUBLISHED_LOSS, ".1g"),
            f"a σ of {sigma:.3f} and a fit of 91.7 % together mean speeds with a spread of "
            f"{spread:.2f}: not rad/s of a drive wheel; the unit is not printed"),
        Row("Table in 5.5", "FPE", "1.2013e−6", number(ours["fpe"], ".3g"),
            "× " + number(ours["fpe"] / PUBLISHED_FPE, ".1g"),
            "printed equal to the loss, which with its own (3.40) needs fewer than "
            f"{number(most, '.1f')} parameters"),
        Row("Table in 5.5", "AIC", "−4.2330e4", number(ours["aic"], ".4g"), "–",
            "printed without its e; counts samples and parameters, neither of which is printed; "
            f"ours is of {len(bundled('multilevel'))} samples in rad/s"),
        Row("§5.5", "samples behind AIC and loss", "not printed", number(samples, ".0f"), "–",
            "(3.39) solved for N, with few parameters: about "
            f"{number(samples * 0.1 / 60, '.0f')} min at 0.1 s; with the likelihood's constant "
            f"{number(implied_samples(2), '.0f')}"),
        Row("Table in 5.5", "fit one step ahead on the record of the estimation [%]",
            "91.474 and 91.8968", _one_step(), "–",
            "whether the printed fit is of one step or of a free run is not said"),
        Row("§5.6", "lumped parameters against a black box",
            "understood and computed more easily; the same quality",
            "measured on one motor: [lumped_or_black_box.md](lumped_or_black_box.md)", "–",
            "the thesis compares in words"),
        Row("(3.39)", "constant of AIC", "N(n_y log 2π + 1))", "N n_y(log 2π + 1)", MISPRINT,
            "unbalanced bracket; the Gaussian likelihood has n_y before it, as (3.41) should"),
    )  # fmt: skip
    return Sheet(rows)


def implied_samples(ones: int = 1) -> float:
    """N of the printed AIC, N(log det J + n_y log 2π + 1), or with n_y instead of that 1."""
    return float(PUBLISHED_AIC / (np.log(PUBLISHED_LOSS) + 2 * np.log(2 * np.pi) + ones))


def _one_step() -> str:
    found = figures(published_model(), [bundled("multilevel")], "estimation", 1, Start.ESTIMATED)
    return " and ".join(number(v, ".2f") for v in found.fit_percent.values())


SHEETS = (logs, validation, criteria)
