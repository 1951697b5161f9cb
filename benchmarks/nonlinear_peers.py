"""Packages that a user might pick instead for a nonlinear model, and ours, behind one call.

Each adapter fits as the package's documentation does for such data, with its defaults where there
are any, and returns what runs freely on a second record, of which only the inputs and the first
samples are given.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FreeRun = Callable[[Array, Array], Array]
"""(u (N, nu), y (N, ny), of which only the head is looked at) → free run (N, ny)."""

Fit = Callable[[Array, Array], FreeRun]
"""(u (N, nu), y (N, ny)) → what runs freely."""

HEAD = 20
"""Samples at the head of the second record that may set the initial state and do not count."""

LAGS = 2


@dataclass(frozen=True)
class Contestant:
    """One way to a nonlinear model.

    Attributes:
        title: how the table calls it.
        distribution: the package on PyPI, empty for ours.
        load: imports what is needed; what it gives is timed.
        words: what it is asked for.
    """

    title: str
    distribution: str
    load: Callable[[], Fit]
    words: str


def ours(
    name: str, orders: Mapping[str, Any], options: Mapping[str, str], focus: str = "prediction"
) -> Fit:
    """A structure of this package with given orders and options."""
    from sysid.data.record import Channel, Record
    from sysid.estimation.assessment.figures import Start, outputs
    from sysid.estimation.pem import fit
    from sysid.fitting.options import FitOptions
    from sysid.fitting.problem import Focus
    from sysid.structures.registry import structure_class

    pwm = (Channel("pwm_l", "µs"), Channel("pwm_r", "µs"))
    omega = (Channel("omega_l", "rad/s"), Channel("omega_r", "rad/s"))

    def estimate(u: Array, y: Array) -> FreeRun:
        structure = structure_class(name).from_orders(orders, 2, 2, options)
        how = FitOptions(focus=Focus(focus))
        model = fit(structure, [Record(u, y, 0.1, pwm, omega)], how)

        def run(u: Array, y: Array) -> Array:
            return outputs(model, Record(u, y, 0.1, pwm, omega), None, Start.ESTIMATED, HEAD)

        return run

    return estimate


def frols(degree: int) -> Fit:
    """SysIdentPy: forward regression, the number of terms by AIC; one model an output."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    def estimate(u: Array, y: Array) -> FreeRun:
        models = []
        for i in range(y.shape[1]):
            model = FROLS(
                order_selection=True,
                n_info_values=40,
                ylag=LAGS,
                xlag=[list(range(1, LAGS + 1))] * u.shape[1],
                basis_function=Polynomial(degree=degree),
                estimator=LeastSquares(),
                info_criteria="aic",
            )
            model.fit(X=u, y=y[:, i : i + 1])
            models.append(model)

        def run(u: Array, y: Array) -> Array:
            runs = [m.predict(X=u, y=y[:LAGS, i : i + 1]) for i, m in enumerate(models)]
            return np.hstack(runs)

        return run

    return estimate


def sindy(degree: int) -> Fit:
    """pysindy: a sparse discrete-time polynomial in two lags of scaled outputs, and the inputs."""
    import pysindy

    def estimate(u: Array, y: Array) -> FreeRun:
        mean, scale = y.mean(axis=0), y.std(axis=0)
        full = np.abs(u).max()

        def states(y: Array) -> Array:
            z = (y - mean) / scale
            return np.hstack([z[1:], z[:-1]])

        model = pysindy.DiscreteSINDy(
            optimizer=pysindy.STLSQ(threshold=0.01),
            feature_library=pysindy.PolynomialLibrary(degree=degree),
        )
        model.fit(states(y), t=1, u=u[1:] / full)

        def run(u: Array, y: Array) -> Array:
            later = model.simulate(states(y[:2])[0], t=len(u) - 1, u=u[1:] / full)
            z = np.vstack([(y[:1] - mean) / scale, np.asarray(later)[:, : y.shape[1]]])
            return np.asarray(mean + scale * z[: len(y)])

        return run

    return estimate


def jax_sysid(neurons: int, epochs: int) -> Fit:
    """jax-sysid: a state-space model with one hidden layer, Adam and then L-BFGS."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from jax_sysid.models import Model

    def estimate(u: Array, y: Array) -> FreeRun:
        nu, ny = u.shape[1], y.shape[1]
        nx = 2 * ny
        mean, scale, full = y.mean(axis=0), y.std(axis=0), np.abs(u).max()

        @jax.jit
        def state(x: Any, u: Any, params: Any) -> Any:
            A, B, _, W1, W2, W3, b1, b2 = params
            return A @ x + B @ u + W3 @ jnp.arctan(W1 @ x + W2 @ u + b1) + b2

        @jax.jit
        def output(x: Any, u: Any, params: Any) -> Any:
            return params[2] @ x

        model = Model(nx, ny, nu, state_fcn=state, output_fcn=output)
        rng = np.random.default_rng(0)
        shapes = [(nx, nu), (ny, nx), (neurons, nx), (neurons, nu), (nx, neurons), neurons, nx]
        model.init(params=[0.5 * np.eye(nx), *(0.1 * rng.standard_normal(s) for s in shapes)])
        model.loss(rho_x0=1e-4, rho_th=1e-4)
        model.optimization(adam_epochs=epochs, lbfgs_epochs=epochs, iprint=-1)
        model.fit((y - mean) / scale, u / full)

        def run(u: Array, y: Array) -> Array:
            head = (y[:HEAD] - mean) / scale
            x0 = model.learn_x0(u[:HEAD] / full, head, verbosity=False)
            found, _ = model.predict(x0, u / full)
            return np.asarray(mean + scale * np.asarray(found))

        return run

    return estimate


_ARX = {"na": 2, "nb": 2, "nk": 1}
_OE = {"nb": 2, "nf": 2, "nk": 1}
_STATICS = {"input": "dead-zone", "output": "identity"}
_CURVES = {"input": "piecewise:8", "output": "piecewise:8"}

CONTESTANTS: Mapping[str, Contestant] = {
    "narx": Contestant(
        "sysid narx-wavelet", "", partial(ours, "narx-wavelet", _ARX, {"units": "20"}),
        "na = nb = 2, 20 units an output, the rest by default",
    ),
    "narx-one-step": Contestant(
        "sysid narx-wavelet", "",
        partial(ours, "narx-wavelet", _ARX, {"units": "20", "refine": "none"}),
        "the same by least squares only",
    ),
    "hw": Contestant(
        "sysid hammerstein-wiener", "", partial(ours, "hammerstein-wiener", _OE, _STATICS),
        "nb = nf = 2, dead zones at the inputs",
    ),
    "hw-curves": Contestant(
        "sysid hammerstein-wiener", "", partial(ours, "hammerstein-wiener", _OE, _CURVES),
        "nb = nf = 2, eight points at every input and output",
    ),
    "frols": Contestant(
        "SysIdentPy FROLS", "sysidentpy", partial(frols, 2),
        "degree 2 in two lags of own output and inputs, up to 40 terms by AIC",
    ),
    "sindy": Contestant(
        "pysindy", "pysindy", partial(sindy, 3), "degree 3 in two lags, STLSQ with threshold 0.01"
    ),
    "jax-sysid": Contestant(
        "jax-sysid", "jax-sysid", partial(jax_sysid, 20, 1000),
        "4 states, 20 neurons, 1000 epochs of Adam and 1000 of L-BFGS",
    ),
}  # fmt: skip
