"""Starting values of the polynomial structures, one function a structure, all tried and recorded.

ARX        linear least squares
ARMAX      Hannan & Rissanen (1982): a long ARX gives ê, then least squares on y, u, ê;
           where that leaves something to predict, the starts of OE with a moving average
           fitted to what they leave
OE, BJ     SRIV, the simplified refined instrumental variable method (Young 1985), with poles
           reflected into the unit circle; from the ARX start and from the output of a long ARX;
           where much stays unexplained also the best poles of a grid
BJ noise   Hannan & Rissanen on v = y − (B/F) u
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.filtering import lfilter
from sysid.data.record import Array, Record
from sysid.fitting import normal_equations as ne
from sysid.fitting.problem import Focus
from sysid.structures.linear.long_arx import (
    arx_row,
    hannan_rissanen,
    long_arx_errors,
    long_arx_output,
    plain_row,
    settled,
    shared_poles,
)
from sysid.structures.linear.output_error import (
    own_poles,
    passing,
    pole_grid,
    reflected,
    run_cost,
    sriv,
)
from sysid.structures.linear.polynomial import PolynomialStructure
from sysid.structures.linear.predictor import RowLayout

Starts = Sequence[tuple[str, Array]]

SHRINKS = 400
"""Times the poles are shrunk by 3 % at most: enough for any radius that float64 distinguishes."""

NOISY = 0.02
"""Fraction of the output's power left unexplained beyond which the pole grid is searched too.

With one or two poles SRIV never missed below it (0 of 600 simulated records, against 40 % at a
signal-to-noise ratio of 0.3); with three it missed 20 % even at one per cent of noise.
"""

FEW_POLES = 2
"""Number of poles up to which ``NOISY`` decides; with more the grid is always searched."""


def stabilised(structure: PolynomialStructure, theta: Array) -> Array:
    """θ with a stable free run: A and F reflected row by row, then shrunk if that is not enough.

    Rows may still couple, and multiple roots on the circle round to either side of it.
    Multiplying every a_k and f_k by ρᵏ multiplies all poles by ρ.
    """
    out = theta.copy()
    for i in range(structure.ny):
        lay, index = structure.layout(i), structure.row_index(i)
        a, _, _, _, f = lay.slices()
        for s in (a[i], *f):
            out[index[s]] = reflected(np.concatenate([[1.0], out[index[s]]]))[1:]
    for _ in range(SHRINKS):
        if structure.stable(out):
            break
        for i in range(structure.ny):
            lay, index = structure.layout(i), structure.row_index(i)
            a, _, _, _, f = lay.slices()
            for s in (*a, *f):
                out[index[s]] *= 0.97 ** np.arange(1, s.stop - s.start + 1)
    return out


def starts_of(structure: PolynomialStructure, records: Sequence[Record], focus: Focus) -> Starts:
    """Named starting values of θ, by the polynomials of the structure."""
    if "f" in structure.letters:
        return output_error_starts(structure, records, focus)
    if "c" not in structure.letters:
        return arx_starts(structure, records, focus)
    return armax_starts(structure, records, focus)


def arx_starts(structure: PolynomialStructure, records: Sequence[Record], focus: Focus) -> Starts:
    """Least squares; with the simulation focus also output-error starts."""
    rows = [plain_row(structure.layout(i)) for i in range(structure.ny)]
    starts = [("least squares", np.concatenate([arx_row(records, lay) for lay in rows]))]
    if focus is Focus.SIMULATION:
        starts += _common_pole_starts(records, rows)
    return starts


def _with_moving_average(records: Sequence[Record], lay: RowLayout, theta: Array) -> Array:
    """[a…, b…, c] from [a…, b…]: C is the moving average that A y − B u is."""
    plain = plain_row(lay)
    noise = []
    for r in records:
        terms = plain.weighed(theta)
        v = ne.residual_row((*r.y.T, *r.u.T), plain.start, lay.output, terms)
        noise.append(passing(np.zeros((len(v), 0)), v, r.dt))
    return np.concatenate([theta, hannan_rissanen(noise, _noise_row(lay))])


def _noise_row(lay: RowLayout) -> RowLayout:
    """The row D v = C e of a disturbance on its own."""
    return RowLayout(0, (lay.nd,), (), (), lay.nc, 0, ())


def _common_pole_starts(
    records: Sequence[Record], rows: Sequence[RowLayout]
) -> list[tuple[str, Array]]:
    """Starts of the free run; outputs that feed each other start uncoupled."""
    alone = [
        replace(lay, na=tuple(n if j == lay.output else 0 for j, n in enumerate(lay.na)))
        for lay in rows
    ]
    refined = [sriv(records, lay, arx_row(records, lay)) for lay in alone]
    starts = [("SRIV", refined)]
    if any(_doubtful(records, lay, row) for lay, row in zip(alone, refined, strict=True)):
        starts.append(("pole grid", [pole_grid(records, lay) for lay in alone]))
    return [
        (kind, np.concatenate([_coupled(lay, row) for lay, row in zip(rows, thetas, strict=True)]))
        for kind, thetas in starts
    ]


def _coupled(lay: RowLayout, theta: Array) -> Array:
    """[a…, b…] with zeros for the other outputs, from [a, b…] of an uncoupled row."""
    before, lags = sum(lay.na[: lay.output]), lay.na[lay.output]
    after = sum(lay.na) - before - lags
    return np.concatenate([np.zeros(before), theta[:lags], np.zeros(after), theta[lags:]])


def _doubtful(records: Sequence[Record], lay: RowLayout, theta: Array) -> bool:
    """Whether SRIV may have missed: many poles, or much of the output left unexplained."""
    poles = lay.na[lay.output]
    if not 0 < poles <= FEW_POLES:
        return poles > 0
    power = sum(float(np.sum(r.y[lay.start :, lay.output] ** 2)) for r in records)
    return run_cost(records, lay, theta) > NOISY * power


def armax_starts(structure: PolynomialStructure, records: Sequence[Record], focus: Focus) -> Starts:
    """Hannan & Rissanen, ARX, and where these leave something to predict, output-error starts."""
    layouts = [structure.layout(i) for i in range(structure.ny)]
    plain = [
        np.concatenate([arx_row(records, plain_row(lay)), np.zeros(lay.nc)]) for lay in layouts
    ]
    long = [long_arx_errors(records, plain_row(lay)) for lay in layouts]
    rows = [hannan_rissanen(records, lay, e) for lay, e in zip(layouts, long, strict=True)]
    driven = structure.traits.takes_inputs
    regression = "ARX" if driven else "AR"
    starts = [("Hannan-Rissanen", np.concatenate(rows)), (regression, np.concatenate(plain))]
    if not driven or (
        focus is Focus.PREDICTION
        and all(
            settled(records, lay, row, e) for lay, row, e in zip(layouts, rows, long, strict=True)
        )
    ):
        return starts
    if focus is Focus.SIMULATION or not structure.orders.coupled:
        # with a sensor's noise C is near A, and both regressions start far off
        ends = np.cumsum([lay.n - lay.nc for lay in layouts])[:-1]
        for kind, theta in _common_pole_starts(records, [plain_row(lay) for lay in layouts]):
            rows = [
                _with_moving_average(records, lay, row)
                for row, lay in zip(np.split(theta, ends), layouts, strict=True)
            ]
            starts.append((kind, np.concatenate(rows)))
    return starts


def output_error_starts(
    structure: PolynomialStructure, records: Sequence[Record], focus: Focus
) -> Starts:
    """SRIV on the records and on the output of a long ARX, ARX, and a pole grid in doubt."""
    layouts = [structure.layout(i) for i in range(structure.ny)]
    rows: list[dict[str, Array]] = []
    for lay in layouts:
        common = shared_poles(lay)
        arx = arx_row(records, common)
        clean = long_arx_output(records, lay)
        refined = sriv(records, common, arx)
        smooth = sriv(clean, common, arx_row(clean, common))
        kinds = {
            "SRIV": own_poles(records, lay, _split(common, lay, refined)),
            "SRIV on a long ARX": own_poles(clean, lay, _split(common, lay, smooth)),
            "ARX": _split(common, lay, arx),
        }
        best = min((refined, smooth), key=lambda row: run_cost(records, common, row))
        if _doubtful(records, common, best):
            grid = _split(common, lay, pole_grid(records, common))
            kinds["pole grid"] = own_poles(records, lay, grid)
        rows.append({kind: _with_noise(records, lay, row) for kind, row in kinds.items()})
    names = dict.fromkeys(kind for row in rows for kind in row)
    # an output that needed no pole grid keeps its SRIV start there
    return [(k, np.concatenate([row.get(k, row["SRIV"]) for row in rows])) for k in names]


def _split(common: RowLayout, lay: RowLayout, theta: Array) -> Array:
    """[b…, f…] of an output-error row from [a, b…]: every input starts with the same poles."""
    n = common.na[common.output]
    poles = np.roots(reflected(np.concatenate([[1.0], theta[:n]])))
    slow_first = poles[np.argsort(-np.abs(poles), kind="stable")]
    tails = []
    for nb, nf in zip(lay.nb, lay.nf, strict=True):
        kept = slow_first[: nf if nb else 0]
        tail = np.real(np.poly(kept))[1:] if len(kept) else np.zeros(0)
        tails.append(np.concatenate([tail, np.zeros(nf - len(tail))]))
    b = theta[n:].copy()
    if lay.constant and lay.nb[-1]:
        # in the common-pole row the constant passes the poles, in this one it does not
        b[-1] /= float(np.real(np.prod(1.0 - poles)))
    return np.concatenate([b, *tails])


def _with_noise(records: Sequence[Record], lay: RowLayout, theta: Array) -> Array:
    """Insert C and D, found from v = y − (B/F) u, between B and F."""
    if not (lay.nc or lay.nd):
        return theta
    n_b = sum(lay.nb)
    _, b, _, _, f = replace(lay, nc=0, nd=0).slices()
    noise = []
    for r in records:
        v = np.array(r.y[:, lay.output])
        for j in range(r.nu):
            if lay.nb[j]:
                top = np.concatenate([np.zeros(lay.nk[j]), theta[b[j]]])
                v -= lfilter(top, np.concatenate([[1.0], theta[f[j]]]), r.u[:, j])
        noise.append(passing(np.zeros((len(v), 0)), v, r.dt))
    row = _noise_row(lay)
    dc = hannan_rissanen(noise, row) if lay.nc else arx_row(noise, row)
    D = reflected(np.concatenate([[1.0], dc[: lay.nd]]))[1:]
    return np.concatenate([theta[:n_b], dc[lay.nd :], D, theta[n_b:]])
