"""LiveFit: gain, time constant, dead zone, excitation and changes of a plant while it runs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sysid.data.preprocess import Detrend
from sysid.data.record import Array, Channel
from sysid.errors import DataError, Termination
from sysid.estimation.assessment.step_response import StepResponse, step_responses
from sysid.estimation.online.arx import Changed, RecursiveARX, RecursiveEstimate
from sysid.estimation.online.change import FALSE_ALARMS
from sysid.estimation.online.dead_zone import DeadZone, changed_beyond, dead_zone
from sysid.estimation.online.excitation import Excitation, excitation
from sysid.estimation.online.live_state import (
    LiveChange,
    LivePair,
    LiveState,
    Numbers,
    followed_by,
    pair_of,
    parameters_of,
    time_constant,
)
from sysid.estimation.online.order_choice import chosen_orders
from sysid.structures.linear.families import ARX
from sysid.structures.model import Model

FIRST_ORDERS = 200
"""Rows after which orders that are not given are chosen; before, first order without dead time."""

AGAIN = 4
"""The choice is made again when there are so many times more rows."""

ORDER_ROWS = 12_000
"""Newest rows that choose: as many as an order search of a batch fit looks at."""

DEAD_ZONE_ROWS = 20_000
"""Newest rows that show a dead zone: 20 s at 1 kHz, a batch fit of 50 ms."""

SPREAD_ROWS = 5_000
"""Newest rows by which signals are judged to move."""


class LiveFit:
    """Follows a plant row by row.

    ::

        live = LiveFit((Channel("volts", "V"),), (Channel("speed", "rad/s"),), dt=0.01)
        live.update(u, y)
        print(live.state().pairs[0].gain)

    Attributes:
        dt: sample time [s].
    """

    def __init__(
        self,
        inputs: Sequence[Channel],
        outputs: Sequence[Channel],
        dt: float,
        orders: Mapping[str, Any] | None = None,
        *,
        forgetting: float = 1.0,
        level: bool = False,
        false_alarms: float = FALSE_ALARMS,
    ) -> None:
        """Args:
            dt: sample time [s].
            orders: na, nb, nk; None to choose them from the rows, delays up to 20 samples.
            forgetting: λ; 1 weighs all rows alike.
            level: whether each output has a constant of its own, as signals about an operating
                point need.
            false_alarms: chance of ever saying that an unchanged plant has changed.

        Raises:
            UsageError: orders, forgetting or the false alarm rate cannot be.
            DataError: the sample time cannot be, or there is no input or no output.
        """
        if not (np.isfinite(dt) and dt > 0.0):
            raise DataError(f"the sample time must be positive, got {dt:g}")
        if not inputs or not outputs:
            raise DataError("a plant that is followed needs an input and an output")
        self.inputs, self.outputs, self.dt = tuple(inputs), tuple(outputs), float(dt)
        self._given = orders is not None
        self._forgetting, self._level, self._false_alarms = forgetting, level, false_alarms
        self._changes: list[LiveChange] = []
        self._earlier = 0
        self._next_choice = FIRST_ORDERS
        self.recursion = self._new(orders or {"na": 1, "nb": 1, "nk": 1})

    def update(self, u: ArrayLike, y: ArrayLike) -> tuple[LiveChange, ...]:
        """One row, (nu,) and (ny,), or several; returns the changes that they made certain.

        Raises:
            UsageError: the shapes do not fit, or a number is not finite.
        """
        rows, ny = self.recursion.rows(u, y), len(self.outputs)
        inputs, outputs = rows[:, ny : ny + len(self.inputs)], rows[:, :ny]
        seen = len(self._changes)
        while len(inputs):
            # orders are chosen at a row, not wherever the rows that came at once happen to end
            room = len(inputs) if self._given else max(self._next_choice - self.recursion.since, 1)
            for change in self.recursion.update(inputs[:room], outputs[:room]):
                self._remember(change)
            inputs, outputs = inputs[room:], outputs[room:]
            if not self._given and self.recursion.since >= self._next_choice:
                self._next_choice *= AGAIN
                self._choose_orders()
        return tuple(self._changes[seen:])

    def interrupt(self) -> None:
        self.recursion.interrupt()

    @property
    def rows(self) -> int:
        return self._earlier + self.recursion.total + self.recursion.waiting

    def state(self) -> LiveState:
        model = self.model()
        linear = step_responses(model)
        changes = self._changes
        if changes:
            changes = [*changes[:-1], followed_by(changes[-1], linear)]
        errors = [float(np.sqrt(v)) for v in np.diag(model.noise_covariance)]
        rows = self.rows
        return LiveState(
            rows=rows,
            seconds=rows * self.dt,
            since_change=self.recursion.since,
            orders=model.structure.order_values(),
            pairs=self._pairs(model, linear),
            parameters=parameters_of(model),
            noise=dict(zip((c.name for c in self.outputs), errors, strict=True)),
            excitation=self._excitations(),
            changes=tuple(changes),
        )

    def model(self) -> Model:
        """The linear model of now, without figures; a level is left out of it."""
        return self._model_of(self.recursion.estimate())

    def _new(self, orders: Mapping[str, Any], looks: Sequence[int] = ()) -> RecursiveARX:
        structure = ARX.from_orders(orders, len(self.inputs), len(self.outputs))
        if self._level:
            structure = structure.with_constant((True,) * structure.ny)
        return RecursiveARX(
            structure,
            self._forgetting,
            false_alarms=self._false_alarms,
            looks=looks,
            confirm=self._is_change,
        )

    def _model_of(self, estimate: RecursiveEstimate) -> Model:
        wide = self.recursion.structure
        places = wide.constant_places()[0] if self._level else np.zeros(0, dtype=np.intp)
        kept = np.setdiff1d(np.arange(len(estimate.theta)), places)
        covariance = estimate.covariance[np.ix_(kept, kept)]
        return self._model(
            estimate.theta[kept], covariance, estimate.null[kept], estimate.noise_variance
        )

    def _model(self, theta: Array, covariance: Array, null: Array, noise: Array) -> Model:
        structure = self.recursion.structure.without_constant()
        parameters = structure.parameters(self.inputs, self.outputs)
        names = [p.name for p in parameters]
        return Model(
            structure=structure,
            theta=theta,
            covariance=covariance,
            parameters=parameters,
            dt=self.dt,
            inputs=self.inputs,
            outputs=self.outputs,
            detrend=Detrend.none(structure.nu, structure.ny),
            noise_covariance=np.diag(noise),
            n_estimated=len(theta),
            criteria={},
            termination=Termination.CLOSED_FORM,
            null_directions=tuple(
                {names[k]: float(v) for k, v in enumerate(column) if abs(v) > 1e-3}
                for column in null.T
            ),
        )

    def _is_change(self, output: int, back: int) -> bool:
        """Whether an alarm is more than a dead zone, which large commands show less."""
        s = self.recursion.structure
        terms = s.layout(output).terms
        pieces = self.recursion.pieces(DEAD_ZONE_ROWS)
        linear = step_responses(self.model())
        drive = _drives(linear, self.inputs, pieces, s.ny).get(self.outputs[output].name)
        if drive is None:
            return True
        signal = s.ny + [c.name for c in self.inputs].index(drive)
        zone = dead_zone(pieces, output, signal, terms)
        if zone is None or not zone.seen:
            return True
        parts = self.recursion.pieces(DEAD_ZONE_ROWS, back), self.recursion.pieces(back)
        return changed_beyond(zone, parts, (output, signal), terms)

    def _remember(self, change: Changed) -> None:
        before = step_responses(self._model_of(change.before))
        if self._changes:
            self._changes[-1] = followed_by(self._changes[-1], before)
        numbers = tuple(
            Numbers(r.input, r.output, r.gain, None, time_constant(r), None) for r in before
        )
        self._changes.append(
            LiveChange(
                time=(self._earlier + change.after) * self.dt,
                within=change.within * self.dt,
                seen=(self._earlier + change.seen) * self.dt,
                output=self.outputs[change.output].name,
                chance=change.alarm.probability,
                share=change.alarm.share,
                numbers=numbers,
            )
        )
        self._next_choice = FIRST_ORDERS

    def _choose_orders(self) -> None:
        """Orders by the rows since the last change; where others are better, all begins again."""
        recursion = self.recursion
        chosen = chosen_orders(recursion.pieces(ORDER_ROWS), self.inputs, self.outputs, self.dt)
        plain = recursion.structure.without_constant()
        if ARX.from_orders(chosen, len(self.inputs), len(self.outputs)) == plain:
            return
        pieces = recursion.pieces()
        ny, nu = len(self.outputs), len(self.inputs)
        self._earlier = self.rows - sum(map(len, pieces))
        self.recursion = self._new(chosen, recursion.looks)
        for k, piece in enumerate(pieces):
            if k:
                self.recursion.interrupt()
            for change in self.recursion.update(piece[:, ny : ny + nu], piece[:, :ny]):
                self._remember(change)

    def _excitations(self) -> tuple[Excitation, ...]:
        s = self.recursion.structure
        names = [c.name for c in (*self.outputs, *self.inputs)] + ["the offset"]
        pieces = self.recursion.pieces(SPREAD_ROWS)
        rows = np.concatenate(pieces) if pieces else np.zeros((0, s.ny + s.nu))
        u = rows[:, s.ny : s.ny + len(self.inputs)]
        return tuple(
            excitation(
                self.recursion.factor(i),
                [names[signal] for signal, _ in s.layout(i).terms],
                (out.name, [c.name for c in self.inputs]),
                (rows[:, i], u),
            )
            for i, out in enumerate(self.outputs)
        )

    def _pairs(self, model: Model, linear: Sequence[StepResponse]) -> tuple[LivePair, ...]:
        pieces = self.recursion.pieces(DEAD_ZONE_ROWS)
        drives = _drives(linear, self.inputs, pieces, len(self.outputs))
        pairs: list[LivePair] = []
        for i, out in enumerate(self.outputs):
            of_output = [r for r in linear if r.output == out.name]
            zone, signal = None, drives.get(out.name)
            if signal is not None:
                j = [c.name for c in self.inputs].index(signal)
                zone = self._dead_zone(pieces, i, j)
            if zone is not None and zone.seen:
                beyond = step_responses(self._beyond(model, zone, i))
                of_output = [r for r in beyond if r.output == out.name]
            pairs += [pair_of(r, zone if r.input == signal else None) for r in of_output]
        chosen = self._given or self.recursion.since >= FIRST_ORDERS
        return tuple(replace(p, settled=p.settled and chosen) for p in pairs)

    def _dead_zone(self, pieces: Sequence[Array], i: int, j: int) -> DeadZone | None:
        s = self.recursion.structure
        return dead_zone(pieces, i, s.ny + j, s.layout(i).terms)

    def _beyond(self, model: Model, zone: DeadZone, i: int) -> Model:
        """The model with the equation of output i as it is beyond the dead zone."""
        lay = self.recursion.structure.layout(i)
        sign = lay.signs
        plain = self.recursion.structure.without_constant()
        index = plain.row_index(i)
        kept = slice(0, len(index))  # the constant is the last of its equation
        theta, covariance = (
            model.theta.copy(),
            np.where(np.isfinite(model.covariance), model.covariance, 0.0),
        )
        theta[index] = (sign * zone.theta)[kept]
        covariance[index, :] = 0.0
        covariance[:, index] = 0.0
        covariance[np.ix_(index, index)] = (np.outer(sign, sign) * zone.covariance)[kept, kept]
        noise = np.diag(model.noise_covariance)
        return self._model(theta, covariance, np.zeros((len(theta), 0)), noise)


def _drives(
    linear: Sequence[StepResponse], inputs: Sequence[Channel], pieces: Sequence[Array], ny: int
) -> dict[str, str]:
    """Output → the input that moves it most, by gain and by how much that input moved."""
    if not pieces:
        return {}
    u = np.concatenate([p[:, ny:] for p in pieces])
    spread = {c.name: float(np.std(u[:, k])) for k, c in enumerate(inputs)}
    drives: dict[str, tuple[float, str]] = {}
    for r in linear:
        size = abs(r.gain.value) * spread[r.input]
        if size > drives.get(r.output, (0.0, ""))[0]:
            drives[r.output] = (size, r.input)
    return {output: name for output, (_, name) in drives.items()}
