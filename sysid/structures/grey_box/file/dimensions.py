"""Units of a file of equations: what each expression has, and where two do not go together."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import isclose, pi

from sysid.data.unit_words import plain
from sysid.structures.grey_box.file.expressions import TRUTHS, Expression, ExpressionError

_BASE = ("m", "kg", "s", "A", "K", "mol")
_DERIVED: Mapping[str, tuple[float, tuple[int, ...]]] = {
    # factor to SI, exponents of _BASE
    "rad": (1.0, ()), "1": (1.0, ()), "%": (0.01, ()), "deg": (pi / 180.0, ()),
    "rev": (2.0 * pi, ()), "rpm": (pi / 30.0, (0, 0, -1)), "Hz": (1.0, (0, 0, -1)),
    "g": (1e-3, (0, 1)), "min": (60.0, (0, 0, 1)), "h": (3600.0, (0, 0, 1)),
    "degC": (1.0, (0, 0, 0, 0, 1)), "N": (1.0, (1, 1, -2)), "Nm": (1.0, (2, 1, -2)),
    "J": (1.0, (2, 1, -2)), "W": (1.0, (2, 1, -3)), "Pa": (1.0, (-1, 1, -2)),
    "bar": (1e5, (-1, 1, -2)), "C": (1.0, (0, 0, 1, 1)), "V": (1.0, (2, 1, -3, -1)),
    "ohm": (1.0, (2, 1, -3, -2)), "H": (1.0, (2, 1, -2, -2)), "F": (1.0, (-2, -1, 4, 2)),
    "Wb": (1.0, (2, 1, -2, -1)), "T": (1.0, (0, 1, -2, -1)), "l": (1e-3, (3,)), "L": (1e-3, (3,)),
}  # fmt: skip
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 0.1, "k": 1e3, "M": 1e6, "G": 1e9}
_TOKEN = re.compile(r"\s*([A-Za-zΩ%]+|1|[*/()]|\^-?\d)")


@dataclass(frozen=True)
class Dimension:
    """A unit: its factor to SI and its exponents of m, kg, s, A, K, mol."""

    factor: float = 1.0
    exponents: tuple[Fraction, ...] = (Fraction(0),) * len(_BASE)

    def __mul__(self, other: "Dimension") -> "Dimension":
        both = zip(self.exponents, other.exponents, strict=True)
        return Dimension(self.factor * other.factor, tuple(a + b for a, b in both))

    def __pow__(self, n: Fraction) -> "Dimension":
        return Dimension(self.factor ** float(n), tuple(e * n for e in self.exponents))

    def like(self, other: "Dimension") -> bool:
        """Whether quantities of both may be added."""
        return self.exponents == other.exponents and isclose(
            self.factor, other.factor, rel_tol=1e-9
        )

    def __str__(self) -> str:
        parts = [(b, e) for b, e in zip(_BASE, self.exponents, strict=True) if e]

        def side(sign: int) -> str:
            return "·".join(b if abs(e) == 1 else f"{b}^{abs(e)}" for b, e in parts if e * sign > 0)

        above, below = side(1), side(-1)
        text = (above or "1") + (f"/{below}" if below and "·" not in below else "")
        text += f"/({below})" if "·" in below else ""
        return text if isclose(self.factor, 1.0) else f"{self.factor:.4g} {text}"


PURE = Dimension()
SECOND = Dimension(1.0, tuple(Fraction(int(b == "s")) for b in _BASE))


def dimension(text: str) -> Dimension | None:
    """The dimension of a unit such as ``N*m/A``; None, unknown, where none is given.

    Raises:
        ValueError: it cannot be read; the sentence says what.
    """
    written = plain(text)
    if not written:
        return None
    tokens, at = [], 0
    while written[at:].strip():
        match = _TOKEN.match(written, at)
        if match is None:
            raise ValueError(f"the unit {text!r} cannot be read: write it like kg*m^2/s")
        tokens.append(match[1])
        at = match.end()
    value, rest = _product(tokens, text)
    if rest:
        raise ValueError(f"the unit {text!r} has a bracket too many")
    return value


def _product(tokens: list[str], text: str) -> tuple[Dimension, list[str]]:
    value, sign = PURE, 1
    while tokens and tokens[0] != ")":
        token, *tokens = tokens
        if token in "*/":
            sign = 1 if token == "*" else -1
            continue
        if token == "(":
            part, tokens = _product(tokens, text)
            if not tokens:
                raise ValueError(f"the unit {text!r} has an open bracket")
            tokens = tokens[1:]
        elif token.startswith("^"):
            raise ValueError(f"the unit {text!r} has an exponent without a unit")
        else:
            part = _named(token, text)
        power = 1
        if tokens and tokens[0].startswith("^"):
            power, tokens = int(tokens[0][1:]), tokens[1:]
        value, sign = value * part ** Fraction(sign * power), 1
    return value, tokens


def _named(name: str, text: str) -> Dimension:
    name = {"Ω": "ohm", "Ohm": "ohm", "rads": "rad", "sec": "s"}.get(name, name)
    for prefix, scale in {"": 1.0, **_PREFIXES}.items():
        bare = name.removeprefix(prefix)
        if not name.startswith(prefix):
            continue
        if bare in _BASE and (bare != "kg" or not prefix):
            exponents = tuple(Fraction(int(b == bare)) for b in _BASE)
            return Dimension(scale, exponents)
        if bare in _DERIVED and not (prefix and bare in ("1", "%", "deg", "rev", "rpm", "min")):
            factor, few = _DERIVED[bare]
            exponents = tuple(Fraction(few[k] if k < len(few) else 0) for k in range(len(_BASE)))
            return Dimension(scale * factor, exponents)
    raise ValueError(f"{name!r} in the unit {text!r} is no unit that is known")


def dimension_of(e: Expression, known: Mapping[str, Dimension | None]) -> Dimension | None:
    """The dimension of an expression; None where it holds quantities without a unit.

    A zero goes with every unit; other numbers are pure.

    Raises:
        ExpressionError: two parts do not go together.
    """
    if e.kind == "number":
        return None if e.number == 0.0 else PURE
    if e.kind == "name":
        return known[e.name]
    parts = [dimension_of(a, known) for a in e.args]
    _require_truths(e)
    if e.kind in ("*", "/"):
        left, right = parts
        if left is None or right is None:
            return None
        return left * right ** Fraction(1 if e.kind == "*" else -1)
    if e.kind == "sqrt":
        return None if parts[0] is None else parts[0] ** Fraction(1, 2)
    if e.kind in ("exp", "log", "sin", "cos", "tanh"):
        return _without_unit(e, parts[0])
    if e.kind in ("sign", "not", "and", "or"):
        return PURE
    if e.kind == "^":
        return _powered(e, parts)
    return _same(e, parts[e.kind == "if" :])


def _require_truths(e: Expression) -> None:
    """Conditions where a function needs them, numbers elsewhere."""
    wanted = [True, False, False] if e.kind == "if" else [e.kind in ("and", "or", "not")] * 3
    for a, want in zip(e.args, wanted, strict=False):
        if (a.kind in TRUTHS) is not want:
            what = "a comparison" if want else "a number, not a comparison,"
            raise ExpressionError(f"{e.kind} needs {what} here", a.at)


def _without_unit(e: Expression, of: Dimension | None) -> Dimension:
    if of is not None and not of.like(PURE):
        raise ExpressionError(
            f"{e.kind} needs a number without unit (an angle in rad), this is {of}", e.args[0].at
        )
    return PURE


def _powered(e: Expression, parts: list[Dimension | None]) -> Dimension | None:
    base, exponent = parts
    if exponent is not None and not exponent.like(PURE):
        raise ExpressionError(f"the exponent has the unit {exponent}", e.args[1].at)
    if e.args[1].kind == "number":
        n = Fraction(e.args[1].number).limit_denominator(1000)
        return None if base is None else base**n
    if base is not None and not base.like(PURE):
        raise ExpressionError(
            f"{base} to a power that is no number: divide the base by a unit of its own first",
            e.args[0].at,
        )
    return base


def _same(e: Expression, parts: list[Dimension | None]) -> Dimension | None:
    stated = [p for p in parts if p is not None]
    for other in stated[1:]:
        if not other.like(stated[0]):
            word = {"+": "added to", "-": "subtracted from", "if": "chosen beside"}
            verb = word.get(e.kind, "compared with")
            hint = ""
            if PURE.like(stated[0]) or PURE.like(other):
                hint = "; a number with a unit is a parameter with fixed: true"
            one, two = (other, stated[0]) if e.kind != "+" else (stated[0], other)
            raise ExpressionError(f"{one} is {verb} {two}{hint}", e.at)
    if e.kind in TRUTHS:
        return PURE
    return stated[0] if stated else None
