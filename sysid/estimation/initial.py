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

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter
from scipy.special import fdtri

from sysid.data.record import Array, Record
from sysid.estimation import normal_equations as ne
from sysid.estimation.output_error import (
    own_poles,
    passing,
    pole_grid,
    reflected,
    run_cost,
    sriv,
)
from sysid.estimation.uncertainty import portmanteau_white
from sysid.structures.base import Focus, Structure
from sysid.structures.polynomial import PolynomialStructure
from sysid.structures.predictor import RowErrors, RowLayout

Starts = Sequence[tuple[str, Array]]
Starter = Callable[[Structure, Sequence[Record], Focus], Starts]

SHRINKS = 400
"""Times the poles are shrunk by 3 % at most: enough for any radius that float64 tells apart."""

NOISY = 0.02
"""Fraction of the output's power left unexplained beyond which the pole grid is searched too.

With one or two poles SRIV never missed below it (0 of 600 simulated records, against 40 % at a
signal-to-noise ratio of 0.3); with three it missed 20 % even at one per cent of noise.
"""

FEW_POLES = 2
"""Number of poles up to which ``NOISY`` decides; with more the grid is always searched."""

PLENTY = 5000
"""Samples from which a start that leaves nothing to predict spares the search of the others."""

SETTLED = 0.95
"""Confidence up to which a long ARX may predict better by chance."""


def starts(structure: Structure, records: Sequence[Record], focus: Focus) -> Starts:
    """Named starting values of θ; the registry below says how for each structure."""
    starter = _STARTERS.get(structure.name)
    return starter(structure, records, focus) if starter else ()


def register(name: str, starter: Starter) -> None:
    """Give a structure of another package its starting values."""
    _STARTERS.setdefault(name, starter)


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


def arx_row(records: Sequence[Record], lay: RowLayout) -> Array:
    """Least squares of one ARX row: [a…, b…] in the row's order."""
    ny = records[0].ny
    terms = [(j, k) for j, n in enumerate(lay.na) for k in range(1, n + 1)]
    terms += [
        (ny + j, k)
        for j, (nb, nk) in enumerate(zip(lay.nb, lay.nk, strict=True))
        for k in range(nk, nk + nb)
    ]
    used = {lay.output, *(s for s, _ in terms)}
    gram = ne.lag_gram(records, max(lay.start, 1), lay.start, used)
    solved = ne.solve(gram, gram.column(lay.output, 0), [gram.column(s, k) for s, k in terms])
    if solved is None:
        solved = ne.solve_by_blocks(records, max(lay.start, 1), lay.output, terms)
    theta = solved.theta.copy()
    theta[: sum(lay.na)] *= -1.0
    return theta


def _arx_starts(structure: Structure, records: Sequence[Record], focus: Focus) -> Starts:
    assert isinstance(structure, PolynomialStructure)
    rows = [_plain(structure.layout(i)) for i in range(structure.ny)]
    found = [("least squares", np.concatenate([arx_row(records, lay) for lay in rows]))]
    if focus is Focus.SIMULATION:
        found += _common_pole_starts(records, rows)
    return found


def _with_moving_average(records: Sequence[Record], lay: RowLayout, theta: Array) -> Array:
    """[a…, b…, c] from [a…, b…]: C is the moving average that A y − B u is."""
    plain = _plain(lay)
    noise = []
    for r in records:
        v = ne.residual_row(r, plain.start, lay.output, _terms(plain, theta, r.ny))
        noise.append(passing(np.zeros((len(v), 0)), v, r.dt))
    return np.concatenate([theta, _hannan_rissanen(noise, _noise_row(lay))])


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
    found = [("SRIV", refined)]
    if any(_doubtful(records, lay, row) for lay, row in zip(alone, refined, strict=True)):
        found.append(("pole grid", [pole_grid(records, lay) for lay in alone]))
    return [
        (kind, np.concatenate([_coupled(lay, row) for lay, row in zip(rows, thetas, strict=True)]))
        for kind, thetas in found
    ]


def _coupled(lay: RowLayout, theta: Array) -> Array:
    """[a…, b…] with zeros for the other outputs, from [a, b…] of an uncoupled row."""
    before, own = sum(lay.na[: lay.output]), lay.na[lay.output]
    after = sum(lay.na) - before - own
    return np.concatenate([np.zeros(before), theta[:own], np.zeros(after), theta[own:]])


def _doubtful(records: Sequence[Record], lay: RowLayout, theta: Array) -> bool:
    """Whether SRIV may have missed: many poles, or much of the output left unexplained."""
    poles = lay.na[lay.output]
    if not 0 < poles <= FEW_POLES:
        return poles > 0
    power = sum(float(np.sum(r.y[lay.start :, lay.output] ** 2)) for r in records)
    return run_cost(records, lay, theta) > NOISY * power


def _armax_starts(structure: Structure, records: Sequence[Record], focus: Focus) -> Starts:
    assert isinstance(structure, PolynomialStructure)
    layouts = [structure.layout(i) for i in range(structure.ny)]
    plain = [np.concatenate([arx_row(records, _plain(lay)), np.zeros(lay.nc)]) for lay in layouts]
    long = [_long_arx_errors(records, _plain(lay)) for lay in layouts]
    rows = [_hannan_rissanen(records, lay, e) for lay, e in zip(layouts, long, strict=True)]
    found = [("Hannan-Rissanen", np.concatenate(rows)), ("ARX", np.concatenate(plain))]
    if focus is Focus.PREDICTION and all(
        _settled(records, lay, row, e) for lay, row, e in zip(layouts, rows, long, strict=True)
    ):
        return found
    if focus is Focus.SIMULATION or not structure.orders.coupled:
        # with a sensor's noise C is near A, and both regressions start far off
        ends = np.cumsum([lay.n - lay.nc for lay in layouts])[:-1]
        for kind, theta in _common_pole_starts(records, [_plain(lay) for lay in layouts]):
            rows = [
                _with_moving_average(records, lay, row)
                for row, lay in zip(np.split(theta, ends), layouts, strict=True)
            ]
            found.append((kind, np.concatenate(rows)))
    return found


def _settled(
    records: Sequence[Record], lay: RowLayout, theta: Array, long_errors: Sequence[Array]
) -> bool:
    """Whether a start leaves nothing to predict, so that no other can lead to a better end.

    Its errors are white, and a long ARX, which has many times the freedom, does not predict
    significantly better (F-test). Short records decide nothing, and searching them costs nothing.
    """
    if sum(len(r) for r in records) < PLENTY:
        return False
    problem = RowErrors(lay, np.arange(lay.n), [(r.u, r.y) for r in records], False)
    with_start = np.split(problem.residual(theta), np.cumsum(problem.lengths)[:-1])
    long = _long_layout(records, _plain(lay))
    errors = [e[long.start - problem.skipped :] for e in with_start]
    more, left = long.n - lay.n, sum(len(e) for e in errors) - long.n
    if more < 1 or left < 1 or not portmanteau_white(errors):
        return False
    floor = sum(float(e @ e) for e in long_errors)
    excess = sum(float(e @ e) for e in errors) - floor
    return bool(excess / more <= fdtri(more, left, SETTLED) * floor / left)


def _output_error_starts(structure: Structure, records: Sequence[Record], focus: Focus) -> Starts:
    assert isinstance(structure, PolynomialStructure)
    layouts = [structure.layout(i) for i in range(structure.ny)]
    rows: list[dict[str, Array]] = []
    for lay in layouts:
        common = _shared_poles(lay)
        arx = arx_row(records, common)
        clean = _long_arx_output(records, lay)
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


_STARTERS: dict[str, Starter] = {
    "arx": _arx_starts,
    "armax": _armax_starts,
    "oe": _output_error_starts,
    "bj": _output_error_starts,
}


def _plain(lay: RowLayout) -> RowLayout:
    """The ARX part of a row."""
    return replace(lay, nc=0, nd=0, nf=(0,) * len(lay.nf))


def _shared_poles(lay: RowLayout) -> RowLayout:
    """The ARX row whose A stands for the largest F of an output-error row."""
    na = tuple(max(lay.nf) if j == lay.output else 0 for j in range(len(lay.na)))
    return replace(lay, na=na, nc=0, nd=0, nf=(0,) * len(lay.nf))


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
    return np.concatenate([theta[n:], *tails])


def _hannan_rissanen(
    records: Sequence[Record], lay: RowLayout, long_errors: Sequence[Array] | None = None
) -> Array:
    """ARMAX row by two regressions: [a…, b…, c]; the first one may be done already."""
    plain = _plain(lay)
    if long_errors is None:
        long_errors = _long_arx_errors(records, plain)
    errors = [
        passing(r.u, np.column_stack([r.y, e]), r.dt)
        for r, e in zip(records, long_errors, strict=True)
    ]
    ny = records[0].ny
    wide = replace(plain, na=(*plain.na, lay.nc))
    theta = arx_row([r.rows(_long_order(records, plain), len(r)) for r in errors], wide)
    n_a = sum(plain.na)
    c = reflected(np.concatenate([[1.0], -theta[n_a : n_a + lay.nc]]))[1:]
    assert wide.na[ny] == lay.nc
    return np.concatenate([theta[:n_a], theta[n_a + lay.nc :], c])


def _long_order(records: Sequence[Record], lay: RowLayout) -> int:
    """Order of the long ARX: grows with the record, leaves twenty samples a coefficient."""
    n = sum(len(r) for r in records)
    signals = 1 + sum(1 for nb in lay.nb if nb) + sum(1 for na in lay.na if na)
    return int(np.clip(n // (20 * signals), max(lay.start, 2), 3 * max(lay.start, 8)))


def _long_layout(records: Sequence[Record], lay: RowLayout) -> RowLayout:
    order = _long_order(records, lay)
    na = tuple(order if n or j == lay.output else 0 for j, n in enumerate(lay.na))
    nb = tuple(max(order + 1 - nk, nb) if nb else 0 for nb, nk in zip(lay.nb, lay.nk, strict=True))
    return replace(_plain(lay), na=na, nb=nb)


def _long_arx_errors(records: Sequence[Record], lay: RowLayout) -> list[Array]:
    """Errors of a long ARX, zero where its regressors reach before the record."""
    long = _long_layout(records, lay)
    theta = arx_row(records, long)
    out = []
    for r in records:
        e = np.zeros(len(r))
        e[long.start :] = ne.residual_row(r, long.start, lay.output, _terms(long, theta, r.ny))
        out.append(e)
    return out


def _terms(lay: RowLayout, theta: Array, ny: int) -> list[tuple[int, int, float]]:
    """(signal, lag, coefficient) of ŷ = Σ coefficient · signal(t − lag)."""
    a, b, *_ = lay.slices()
    terms = [(j, k, -float(v)) for j, s in enumerate(a) for k, v in enumerate(theta[s], 1)]
    return terms + [
        (ny + j, k, float(v)) for j, s in enumerate(b) for k, v in enumerate(theta[s], lay.nk[j])
    ]


def _long_arx_output(records: Sequence[Record], lay: RowLayout) -> list[Record]:
    """The records with the row's output replaced by the free run of a long ARX (noise gone)."""
    common = _shared_poles(lay)
    long = _long_layout(records, common)
    theta = arx_row(records, long)
    a, b, *_ = long.slices()
    A = reflected(np.concatenate([[1.0], theta[a[lay.output]]]))
    out = []
    for r in records:
        drive = np.zeros(len(r))
        for j, s in enumerate(b):
            if s.stop > s.start:
                drive += lfilter(np.concatenate([np.zeros(lay.nk[j]), theta[s]]), [1.0], r.u[:, j])
        y = np.array(r.y)
        y[:, lay.output] = lfilter([1.0], A, drive)
        usable = np.all(np.isfinite(y)) and np.max(np.abs(y)) < 1e6 * np.max(np.abs(r.y))
        out.append(replace(r, y=y) if usable else r)
    return out


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
    dc = _hannan_rissanen(noise, row) if lay.nc else arx_row(noise, row)
    D = reflected(np.concatenate([[1.0], dc[: lay.nd]]))[1:]
    return np.concatenate([theta[:n_b], dc[lay.nd :], D, theta[n_b:]])
