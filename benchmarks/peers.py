"""One adapter a package that a user might pick instead, for second-order models with nk = 1.

Each adapter calls the package as its documentation does, with its defaults, and turns the answer
into rows. A package that is not installed is left out of the study, and the study says so.
"""

import contextlib
import io
import os
import platform
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from references import ONE, Array, Row, delayed, monic

Estimator = Callable[[Array, Array], tuple[Row, ...]]
"""(u (N, nu), y (N, ny)) → one row an output."""


def processor() -> str:
    """Processor, its cores and the Python that runs."""
    cpu, info = platform.processor() or platform.machine(), Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text().splitlines()
        cpu = next((x.split(":")[1].strip() for x in lines if x.startswith("model name")), cpu)
    return f"{cpu}, {os.cpu_count()} cores, Python {platform.python_version()}"


@dataclass(frozen=True)
class Peer:
    """A package and what of it is measured.

    Attributes:
        title: how the table calls it.
        distribution: its name on PyPI.
        module: what to import before the clock starts.
        structures: structure → estimator given the imported module.
        several: whether it takes several inputs and outputs.
    """

    title: str
    distribution: str
    module: str
    structures: dict[str, Callable[[Any], Estimator]]
    several: bool = False

    def estimator(self, structure: str, outputs: int) -> Estimator | None:
        """What estimates this structure, None where the package cannot or is not installed."""
        if structure not in self.structures or (outputs > 1 and not self.several):
            return None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return self.structures[structure](import_module(self.module))
            except ImportError:
                return None

    @property
    def label(self) -> str:
        """Title and version, or that it is not installed."""
        try:
            return f"{self.distribution} {version(self.distribution)}"
        except ImportError:
            return f"{self.distribution} (not installed)"


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """No warnings, and nothing on stdout: neither from Python nor from compiled code."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def _sarimax(module: Any) -> Estimator:
    """ARMAX exactly: moving-average errors, lags of the output among the regressors.

    ``order=(2, 0, 2)`` with lags of u would be a regression with ARMA errors, another model.
    Rows decouple, so several outputs are as many fits; VARMAX has no diagonal form and took
    several times as long without converging.
    """

    def estimate(u: Array, y: Array) -> tuple[Row, ...]:
        rows = []
        lags = [x[2 - k : len(x) - k] for x in u.T for k in (1, 2)]
        for own in y.T:
            past = [-own[2 - k : len(own) - k] for k in (1, 2)]
            model = module.SARIMAX(own[2:], exog=np.column_stack(past + lags), order=(0, 0, 2))
            p = np.asarray(model.fit(disp=False).params)
            b = p[2 : 2 + len(lags)].reshape(-1, 2)
            c = p[2 + len(lags) : 4 + len(lags)]
            rows.append(Row(monic(p[:2]), tuple(delayed(x, 1) for x in b), monic(c)))
        return tuple(rows)

    return estimate


def _pysib(name: str, orders: tuple[int, ...]) -> Callable[[Any], Estimator]:
    def load(module: Any) -> Estimator:
        def estimate(u: Array, y: Array) -> tuple[Row, ...]:
            _, m = getattr(module, name)(u[:, 0], y[:, 0], *orders, 1)
            return (Row(m["A"], (m["B"],), m["C"], m["D"], (m["F"],)),)

        return estimate

    return load


def _sippy(name: str, letters: int) -> Callable[[Any], Estimator]:
    """All orders 2; SIPPY counts the delay beyond the first sample."""

    def load(module: Any) -> Estimator:
        def estimate(u: Array, y: Array) -> tuple[Row, ...]:
            nu, ny = u.shape[1], y.shape[1]
            entries: list[Any] = [[2] * ny for _ in range(letters)]
            entries[1 if name == "ARMAX" else 0] = [[2] * nu] * ny
            orders = [*entries, [[0] * nu] * ny]
            options = {f"{name}_orders": orders}
            m = module.system_identification(y.T.copy(), u.T.copy(), name, **options)
            rows = []
            for i in range(ny):
                den = [np.array(d, dtype=float) for d in m.DENOMINATOR[i]]
                num = [np.array(b, dtype=float) for b in m.NUMERATOR[i]]
                # powers of z: a numerator one shorter than its denominator is one sample late
                B = tuple(delayed(b, len(d) - len(b)) for b, d in zip(num, den, strict=True))
                C = np.array(m.NUMERATOR_H[i][0], dtype=float)
                if name == "ARMAX":
                    rows.append(Row(den[0], B, C))
                else:
                    D = np.array(m.DENOMINATOR_H[i][0], dtype=float) if name == "BJ" else ONE
                    rows.append(Row(ONE, B, C, D, tuple(den)))
            return tuple(rows)

        return estimate

    return load


def _frols(module: Any) -> Estimator:
    """Four terms of a linear polynomial in two lags, chosen by forward regression."""
    basis = import_module("sysidentpy.basis_function").Polynomial(degree=1)
    squares = import_module("sysidentpy.parameter_estimation").LeastSquares

    def estimate(u: Array, y: Array) -> tuple[Row, ...]:
        m = module.FROLS(
            ylag=2,
            xlag=2,
            basis_function=basis,
            estimator=squares(),
            model_type="NARMAX",
            order_selection=False,
            n_terms=4,
        )
        m.fit(X=u, y=y)
        # a term is coded 1000·signal + lag, the output being signal 1
        found = {int(k): float(v) for k, v in zip(m.final_model[:, 0], m.theta[:, 0], strict=True)}
        A = monic(np.array([-found.get(1000 + k, 0.0) for k in (1, 2)]))
        return (Row(A, (np.array([0.0, *(found.get(2000 + k, 0.0) for k in (1, 2))]),)),)

    return estimate


PEERS = (
    Peer(
        "statsmodels SARIMAX",
        "statsmodels",
        "statsmodels.tsa.statespace.sarimax",
        {"armax": _sarimax},
        several=True,
    ),
    Peer(
        "pysib",
        "pysib",
        "pysib",
        {
            "armax": _pysib("armax", (2, 2, 2)),
            "oe": _pysib("oe", (2, 2)),
            "bj": _pysib("bj", (2, 2, 2, 2)),
        },
    ),
    Peer(
        "SIPPY",
        "sippy-unipi",
        "sippy_unipi",
        {"armax": _sippy("ARMAX", 3), "oe": _sippy("OE", 2), "bj": _sippy("BJ", 4)},
        several=True,
    ),
    Peer(
        "SysIdentPy FROLS",
        "sysidentpy",
        "sysidentpy.model_structure_selection",
        {"arx": _frols},
    ),
)
