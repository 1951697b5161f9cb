"""The plainest base a diagnosis starts from, so that nothing it should reveal is absorbed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Record
from sysid.discrepancy.naming import NamingSearch, Node
from sysid.discrepancy.supermodel import SuperModel
from sysid.effects.base import Effect
from sysid.errors import DataError, ModelError
from sysid.estimation.contest import run_contest
from sysid.estimation.delays import choose_delay
from sysid.estimation.holdout import hold_out
from sysid.estimation.search import FitOptions

LARGEST_ORDER = 3


@dataclass(frozen=True, eq=False)
class Base:
    """The base of a diagnosis.

    Attributes:
        search: the naming search around it.
        node: the fitted base.
        scales: full drive of each track's command.
        delay: dead time in samples.
        level: whether a constant level belongs to the base (logs without physical zeros).
        words: what the base is, in words.
    """

    search: NamingSearch
    node: Node
    scales: Array
    delay: int
    level: bool
    words: str


def plain_base(
    estimation: Sequence[Record], held: Sequence[Record], effects: Sequence[Effect]
) -> Base:
    """Robot logs: per track its own command, first order, nk = 1, no offset. Others: OE up to
    third order with dead time and level chosen on the estimation part.

    Raises:
        DataError: numbers of inputs and outputs differ.
        ModelError: the base cannot be fitted.
    """
    first = estimation[0]
    if first.nu != first.ny:
        raise DataError(
            f"{first.name} has {first.nu} inputs and {first.ny} outputs; a diagnosis needs one "
            "command a track: choose them with --input and --output"
        )
    everything = np.concatenate([r.u for r in estimation])
    scales = (
        np.full(first.nu, 20000.0)
        if first.is_robot_log
        else np.maximum(np.max(np.abs(everything), axis=0), 1e-12)
    )
    speed = np.quantile(np.abs(np.concatenate([r.y for r in estimation])), 0.95, axis=0)
    speed = np.maximum(speed, 1e-9)
    if first.is_robot_log:
        order, delay, level = 1, 1, False
        words = "per track its own command, first order, one sample of delay, no offset"
    else:
        order, delay = _order_and_delay(estimation)
        level = True
        words = f"output error of order {order} with {delay} samples of delay and a level"
    model = SuperModel(effects, order, first.ny, speed, first.dt)
    search = NamingSearch(model, estimation, held, scales, delay, level)
    node = search.base(_starts(model, estimation, scales, delay))
    if not np.isfinite(node.held_rmse):
        raise ModelError("the base model cannot be simulated on this log; look at sysid inspect")
    return Base(search, node, scales, delay, level, words)


def _order_and_delay(records: Sequence[Record]) -> tuple[int, int]:
    detrend = Detrend.means(records)
    nk = choose_delay(hold_out([detrend.remove(r) for r in records]))
    delay = int(np.max(nk)) if isinstance(nk, list) else int(nk)
    delay = max(delay, 1)
    grid = [{"nb": n, "nf": n, "nk": delay} for n in range(1, LARGEST_ORDER + 1)]
    found = run_contest(("oe",), records, FitOptions(stable=True), detrend, grid=grid)
    return int(np.max(found.entries[0].model.structure.order_values()["nf"])), delay


def _starts(model: SuperModel, records: Sequence[Record], scales: Array, delay: int) -> Array:
    """Several gains and time constants; the static gain from the largest readings."""
    drive = np.concatenate([r.u for r in records]) / scales
    y = np.concatenate([r.y for r in records])
    gain = np.array(
        [float(d @ v) / max(float(d @ d), 1e-12) for d, v in zip(drive.T, y.T, strict=True)]
    )
    size = np.quantile(np.abs(y), 0.95, axis=0) / np.maximum(
        np.quantile(np.abs(drive), 0.95, axis=0), 1e-9
    )
    rows = []
    for pole in (0.5, 0.8, 0.95):
        for k in (gain, size):
            q = model.null.copy()
            for i in range(model.tracks):
                q[model.place["core", "gain", i]] = k[i] if abs(k[i]) > 1e-9 else size[i]
                poles = [pole * 0.6**j for j in range(model.order)]
                for j, c in enumerate(np.poly(poles)[1:]):
                    q[model.place["core", f"f{j + 1}", i]] = float(c)
            rows.append(q)
    return np.array(rows)
