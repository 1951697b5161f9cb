"""What a file of equations says: read, checked, and its expressions as trees."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any, Literal

from pydantic import Field, ValidationError, field_validator, model_validator

from sysid.data.yaml_files.problems import first_problem, keys_of
from sysid.data.yaml_files.settings import Settings
from sysid.data.yaml_files.source import Place, YamlSource, shown, yaml_of
from sysid.errors import DataError
from sysid.structures.grey_box.file.dimensions import (
    PURE,
    SECOND,
    Dimension,
    dimension,
    dimension_of,
)
from sysid.structures.grey_box.file.expressions import (
    TRUTHS,
    WORDS,
    Expression,
    ExpressionError,
    degree,
    names_in,
    nodes,
    parse,
)
from sysid.structures.grey_box.physics import MAX_SUBSTEPS


def _as_text(value: Any) -> Any:
    """An equation or unit that is a number, as YAML reads ``0``, as its text."""
    return f"{value:.17g}" if isinstance(value, float) else value


class StateSection(Settings):
    """A state: its unit, and where a log begins.

    Attributes:
        initial: expression in parameters and in outputs, which are their first samples; the
            output that shows the state, or 0, where none is given.
        known: whether that is exact, so that it is not estimated.
    """

    unit: str = ""
    initial: str | None = None
    known: bool = False

    _texts = field_validator("unit", "initial", mode="before")(_as_text)


class OutputSection(Settings):
    """An output: its unit and its equation in states and parameters."""

    unit: str = ""
    equation: str

    _texts = field_validator("unit", "equation", mode="before")(_as_text)


class ParameterSection(Settings):
    """A parameter.

    Attributes:
        start: where searches begin, and its value where it is fixed.
        bounds: lowest and highest value.
        fixed: whether it stays at ``start``.
        per_experiment: whether every log has its own.
    """

    unit: str = ""
    meaning: str = ""
    start: float = Field(ge=-1e100, le=1e100)
    bounds: tuple[float, float] | None = Field(default=None, strict=False)
    fixed: bool = False
    per_experiment: bool = False

    _texts = field_validator("unit", mode="before")(_as_text)

    @field_validator("bounds", mode="before")
    @classmethod
    def _ends(cls, value: Any) -> Any:
        """Two numbers, the lower one first; ``.inf`` and ``-.inf`` are allowed."""
        if value is None:
            return value
        ends = value if isinstance(value, list | tuple) else ()
        if len(ends) != 2 or not all(isinstance(v, float) for v in ends) or not ends[0] < ends[1]:
            raise ValueError(f"bounds is {shown(value)}: write [lowest, highest]")
        return tuple(min(max(v, -1e300), 1e300) for v in ends)

    @model_validator(mode="after")
    def _consistent(self) -> "ParameterSection":
        if self.bounds and not self.bounds[0] <= self.start <= self.bounds[1]:
            low, high = self.bounds
            raise ValueError(f"start {self.start:g} is outside the bounds {low:g} … {high:g}")
        if self.per_experiment and (self.fixed or self.bounds):
            raise ValueError("a parameter per experiment has neither bounds nor fixed: omit them")
        return self


class EquationFile(Settings):
    """The whole file; every section maps names to what is said of them."""

    title: str = ""
    time: Literal["continuous", "discrete"] = "continuous"
    substeps: int = Field(default=0, ge=0, le=MAX_SUBSTEPS)
    inputs: dict[str, str]
    states: dict[str, StateSection]
    parameters: dict[str, ParameterSection]
    let: dict[str, str] = Field(default_factory=dict)
    equations: dict[str, str]
    outputs: dict[str, OutputSection]
    after: dict[str, str] = Field(default_factory=dict)

    @field_validator("inputs", mode="before")
    @classmethod
    def _units(cls, value: Any) -> Any:
        """An input without a unit has nothing, or ``{}``, behind its name."""
        if not isinstance(value, dict):
            return value
        return {k: "" if v is None or v == {} else _as_text(v) for k, v in value.items()}

    @field_validator("let", "equations", "after", mode="before")
    @classmethod
    def _texts(cls, value: Any) -> Any:
        return {k: _as_text(v) for k, v in value.items()} if isinstance(value, dict) else value

    @field_validator("substeps", mode="before")
    @classmethod
    def _whole(cls, value: Any) -> Any:
        return int(value) if isinstance(value, float) and value.is_integer() else value


@dataclass(frozen=True, eq=False)
class Definition:
    """A checked file.

    Attributes:
        said: the file as it is written.
        inputs, outputs: unit by name.
        states: those with an equation, then the parameters that every log has of its own.
        let: what is computed first, in this order.
        rates: right-hand side of each state with an equation.
        readings: equation of each output.
        after: what states are put to at the end of each step.
        initial: first value of a state.
        linear: whether it is linear in states and inputs.
    """

    said: EquationFile
    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    states: tuple[str, ...]
    let: Mapping[str, Expression]
    rates: tuple[Expression, ...]
    readings: tuple[Expression, ...]
    after: Mapping[str, Expression]
    initial: Mapping[str, Expression]
    linear: bool

    @property
    def parameters(self) -> Mapping[str, ParameterSection]:
        """Parameters that all logs share."""
        return {k: p for k, p in self.said.parameters.items() if not p.per_experiment}


@lru_cache(maxsize=64)
def definition_of(text: str, name: str = "equations") -> Definition:
    """Read and check the text of a file of equations."""
    source = yaml_of(text, name)
    _refuse_cut(source)
    try:
        said = EquationFile.model_validate(source.values)
    except ValidationError as error:
        raise DataError(
            first_problem(error, source, _known_keys, "the file of equations", _EXAMPLES)
        ) from None
    return _Checker(source, said).definition()


def _refuse_cut(source: YamlSource) -> None:
    """Refuse an equation that YAML has cut at a comma, before its pieces are unknown keys."""
    for place in source.lines:
        if place and str(place[-1]).count(")") > str(place[-1]).count("("):
            raise DataError(
                f"{source.where(place)}: YAML ends an equation at a comma inside {{…}}: write the "
                'equation in quotes, as in equation: "min(x, 1)"'
            )


_EXAMPLES = {
    "inputs": "inputs: {u: V}",
    "states": "states: {speed: {unit: rad/s}}",
    "parameters": "parameters: {gain: {unit: rad/s/V, start: 1}}",
    "equations": "equations: {speed: (gain*u - speed)/tau}",
    "outputs": "outputs: {w: {unit: rad/s, equation: speed}}",
    "start": "start: 1",
    "equation": "equation: an expression such as 2*angle",
}

_SECTIONS: Mapping[str, type[Settings]] = {
    "states": StateSection,
    "parameters": ParameterSection,
    "outputs": OutputSection,
}


def _known_keys(place: Place) -> list[str]:
    if len(place) == 2 and place[0] in _SECTIONS:
        return keys_of(_SECTIONS[str(place[0])], ())
    return keys_of(EquationFile, ())


class _Checker:
    """Checks of what the sections say of each other."""

    def __init__(self, source: YamlSource, said: EquationFile) -> None:
        self.source, self.said = source, said

    def error(self, place: Place, sentence: str, at: int = 0) -> DataError:
        """The sentence at a character of the text at a place."""
        line, column = self.source.texts.get(place, (0, 0))
        where = f"{self.source.name}:{line}:{column + at}" if line else self.source.where(place)
        return DataError(f"{where}: {sentence}")

    def definition(self) -> Definition:
        """The whole; see ``definition_of``."""
        said = self.said
        self._names()
        own = tuple(k for k, p in said.parameters.items() if p.per_experiment)
        units = self._dimensions()
        known = {k: v for k, v in units.items() if k in said.states or k not in said.outputs}
        let: dict[str, Expression] = {}
        moving = dict.fromkeys((*said.inputs, *said.states, *own), 1)
        driven = set(said.inputs)
        for name in said.let:
            let[name] = self._parsed(("let", name), said.let[name], known, set(known))
            known[name] = self._dimension(("let", name), let[name], known)
            moving[name] = degree(let[name], moving)
            driven |= {name} if names_in(let[name]) & driven else set()
        everything = set(known)
        scale = SECOND if said.time == "continuous" else PURE
        rates = []
        for state in said.states:
            place: Place = ("equations", state)
            e = self._parsed(place, said.equations[state], known, everything)
            wanted = units[state]
            rate = None if wanted is None else wanted * scale ** Fraction(-1)
            self._require(place, e, known, rate, f"the rate of {state}")
            rates.append(e)
        quiet = everything - driven
        readings = []
        for name, output in said.outputs.items():
            place = ("outputs", name, "equation")
            e = self._parsed(place, output.equation, known, quiet, "an output reads states")
            self._require(place, e, known, units[name], name)
            readings.append(e)
        after = {}
        for name, text in said.after.items():
            place = ("after", name)
            if name not in said.states:
                raise self._no_state("after", name)
            after[name] = self._parsed(place, text, known, quiet, "it acts between samples")
            self._require(place, after[name], known, units[name], name)
        initial = self._initial(units, readings)
        linear = said.time == "continuous" and not after
        linear &= all(degree(e, moving) <= 1 for e in rates)
        return Definition(
            said,
            said.inputs,
            {k: o.unit for k, o in said.outputs.items()},
            (*said.states, *own),
            let,
            tuple(rates),
            tuple(readings),
            after,
            initial,
            linear,
        )

    def _names(self) -> None:
        """Names are words, each used once; every state has an equation."""
        said = self.said
        seen: dict[str, str] = {}
        for section in ("inputs", "states", "parameters", "let", "outputs"):
            if not getattr(said, section) and section in ("inputs", "states", "outputs"):
                raise self.error((section,), f"{section} is empty: name at least one")
            for name in getattr(said, section):
                place = (section, name)
                if not name.isidentifier() or name in WORDS:
                    raise self.error(place, f"{name!r} cannot be a name: write a word like k1")
                # an output may be called like the state that it shows
                if name in seen and not (section == "outputs" and seen[name] == "states"):
                    raise self.error(place, f"{name!r} is among {seen[name]}, too: rename one")
                seen.setdefault(name, section)
        for name in sorted({*said.equations} ^ {*said.states}):
            if name in said.states:
                raise self.error(("states", name), f"{name!r} has no equation: add it to equations")
            raise self._no_state("equations", name)

    def _no_state(self, section: str, name: str) -> DataError:
        known = ", ".join(self.said.states)
        return self.error((section, name), f"{name!r} is no state: it has {known}")

    def _dimensions(self) -> dict[str, Dimension | None]:
        """Dimension by name of everything that has a unit of its own."""
        said = self.said
        written: list[tuple[Place, str, str]] = [
            *((("inputs", k), k, v) for k, v in said.inputs.items()),
            *((("states", k, "unit"), k, v.unit) for k, v in said.states.items()),
            *((("parameters", k, "unit"), k, v.unit) for k, v in said.parameters.items()),
            *((("outputs", k, "unit"), k, v.unit) for k, v in said.outputs.items()),
        ]
        found: dict[str, Dimension | None] = {}
        for place, name, unit in written:
            try:
                of = dimension(unit)
            except ValueError as error:
                raise self.error(place, str(error)) from None
            if name in found and (of is None or found[name] is None):
                of = found[name] or of
            found[name] = of
        return found

    def _initial(
        self, units: Mapping[str, Dimension | None], readings: list[Expression]
    ) -> dict[str, Expression]:
        """First values as the file says, else the output that shows the state by itself."""
        said = self.said
        shared = {k for k, p in said.parameters.items() if not p.per_experiment}
        shown_by = {e.name: n for e, n in zip(readings, said.outputs, strict=True) if e.name}
        found = {}
        for name, state in said.states.items():
            place = ("states", name, "initial")
            if state.initial is not None:
                e = self._parsed(
                    place, state.initial, units, shared | set(said.outputs),
                    "it may hold parameters and outputs",
                )  # fmt: skip
                if e.kind != "number":  # which is in the unit of the state
                    self._require(place, e, units, units[name], name)
                found[name] = e
            elif name in shown_by:
                found[name] = Expression("name", 0, name=shown_by[name])
        return found

    def _parsed(
        self,
        place: Place,
        text: str,
        known: Mapping[str, Any],
        allowed: set[str],
        why: str = "",
    ) -> Expression:
        try:
            e = parse(text)
            for n in nodes(e):
                if n.kind == "name" and n.name not in allowed:
                    if n.name in known and why:
                        raise ExpressionError(f"{n.name} cannot stand here: {why}", n.at)
                    there = ", ".join(sorted(allowed))
                    raise ExpressionError(f"{n.name!r} is not defined; there are {there}", n.at)
            if e.kind in TRUTHS:
                raise ExpressionError("a comparison is no number: use if(…, 1, 0)", e.at)
        except ExpressionError as error:
            raise self.error(place, str(error), error.at) from None
        return e

    def _dimension(
        self, place: Place, e: Expression, known: Mapping[str, Dimension | None]
    ) -> Dimension | None:
        try:
            return dimension_of(e, known)
        except ExpressionError as error:
            raise self.error(place, f"the units do not agree: {error}", error.at) from None

    def _require(
        self,
        place: Place,
        e: Expression,
        known: Mapping[str, Dimension | None],
        wanted: Dimension | None,
        what: str,
    ) -> None:
        found = self._dimension(place, e, known)
        if found is not None and wanted is not None and not found.like(wanted):
            raise self.error(place, f"{what} must be in {wanted}, this is in {found}")
