"""``published_figures.md``: figures others have published, beside the same made here."""

import math
from collections.abc import Mapping
from pathlib import Path

from studies.measured_records import available, read
from sysid.criteria.table import Loss, weighed
from sysid.data.preprocess import Detrend
from sysid.data.record import Record
from sysid.estimation.assessment.figures import Start, figures
from sysid.estimation.pem import fit
from sysid.report.markdown import table
from sysid.structures.linear.families import ARX
from sysid.structures.model import Model

HEAD = """# Published figures beside ours

The same protocol, the same digits: these figures test the estimators and the definitions, not the
choice of a model. What the workbench chooses by itself stands in
[structures_on_data.md](structures_on_data.md).
"""

CRITERIA = """
## Information criteria

N = 300 samples, loss V = 1.6575, n = 6 parameters, one output (Ljung's definitions; the constant
N ny (ln 2π + 1) is part of AIC and BIC).

"""

DRYER = """
## Hot-air dryer

`arx([2 2 3])` on samples 1 … 300 with their means removed, A = 1 + a₁q⁻¹ + a₂q⁻² and
B = b₃q⁻³ + b₄q⁻⁴, and its one-step fit on the same samples (L. Ljung's dryer, DaISy).

"""

LAGS = """
## ARX with ten lags

10 output and 10 input lags with nk = 0, fitted on the first half of the training samples, that
half's means removed; free run over the test samples, started from its first measured outputs
(ARX in Champneys et al., arXiv 2405.10779: CED .291 / .331 V, Silverbox 6.95 / 14.2 mV). CED: 400
training and 100 test samples, 10 not counted. Silverbox: multisine samples 40650 … 127400, 75 % for
training, and the arrow 100 … 40575; 50 not counted.

"""


def write(_folder: Path) -> Mapping[str, str]:
    """The tables, or nothing where the records are missing."""
    if not available():
        return {}
    headers = ["figure", "published", "ours"]
    text = HEAD + CRITERIA + table(headers, _criteria(), "lrr")
    text += DRYER + table(headers, _dryer(), "lrr")
    text += LAGS + table(headers, [*_drives(), *_silverbox()], "lrr")
    return {"published_figures.md": text}


def _criteria() -> list[list[str]]:
    c = weighed(Loss(math.log(1.6575), 300, 6))
    return [
        ["FPE", "1.7252", f"{c['fpe']:.4f}"],
        ["AIC", "1015.0", f"{c['aic']:.1f}"],
        ["AICc", "1015.2", f"{c['aicc']:.1f}"],
        ["nAIC", "0.5453", f"{c['naic']:.4f}"],
        ["BIC", "1037.2", f"{c['bic']:.1f}"],
    ]


def _dryer() -> list[list[str]]:
    record = read("dryer/dryer.csv").rows(0, 300)
    model = _arx(record, na=2, nb=2, nk=3)
    one_step = figures(model, [record], "estimation", 1).mean_fit
    published = ("−1.2737", "0.3935", "0.0666", "0.0445")
    names = ("a₁", "a₂", "b₃", "b₄")
    rows = [
        [name, known, f"{value:.4f}".replace("-", "−")]
        for name, known, value in zip(names, published, model.theta, strict=True)
    ]
    return [*rows, ["one-step fit [%]", "95.12", f"{one_step:.2f}"]]


def _drives() -> list[list[str]]:
    rows = []
    for level, published in (("low", ".2915"), ("high", ".3305")):
        record = read(f"ced/unif_{level}.csv")
        model = _arx(record.rows(0, 200), na=10, nb=10, nk=0)
        error = _test_rmse(model, record.rows(400, 500), 10)
        rows.append([f"CED {level}, RMSE [V]", published, f"{error:.4f}".lstrip("0")])
    return rows


def _silverbox() -> list[list[str]]:
    record = read("silverbox/snls80mv.csv")
    multisine, arrow = record.rows(40650, 127400), record.rows(100, 40575)
    train, test = multisine.split(0.75)
    model = _arx(train.rows(0, len(train) // 2), na=10, nb=10, nk=0)
    return [
        [f"Silverbox {what}, RMSE [mV]", published, f"{1e3 * _test_rmse(model, part, 50):.2f}"]
        for what, part, published in (("multisine", test, "6.95"), ("arrow", arrow, "14.23"))
    ]


def _arx(record: Record, na: int, nb: int, nk: int) -> Model:
    structure = ARX.from_orders({"na": na, "nb": nb, "nk": nk}, record.nu, record.ny)
    return fit(structure, [record], detrend=Detrend.means([record]))


def _test_rmse(model: Model, test: Record, skip: int) -> float:
    found = figures(model, [test], "test", None, Start.MEASURED, skip)
    (error,) = found.rmse.values()
    return error
