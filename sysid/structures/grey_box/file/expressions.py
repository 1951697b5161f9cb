"""Expressions of a file of equations: a safe grammar, read into a tree and evaluated over ``xp``.

    choice  := both ('or' both)*
    both    := truth ('and' truth)*
    truth   := 'not' truth | sum (('<' | '<=' | '>' | '>=') sum)?
    sum     := product (('+' | '-') product)*
    product := signed (('*' | '/') signed)*
    signed  := ('-' | '+') signed | power
    power   := atom (('^' | '**') signed)?
    atom    := number | name | function '(' choice (',' choice)* ')' | '(' choice ')'

Read by recursive descent; nothing is ever executed as code. A root, logarithm or broken power is
that of the positive part, so that slopes stay finite at zero.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

MAX_DEPTH = 200
"""Calls in calls while it is read; a pair of brackets takes five."""

MAX_TOKENS = 300
"""Words and signs of one expression: trees are walked by recursion, a step a sign."""

MAX_POWER = 20.0

TINY = 1e-30
"""Below it roots and broken powers take their argument for this, where their slope is infinite."""

EXPONENT_CAP = 700.0

Values = Any
"""A number, or an array of the namespace in use."""


class ExpressionError(Exception):
    """What is wrong with an expression, and at which of its characters, counted from 0."""

    def __init__(self, sentence: str, at: int) -> None:
        super().__init__(sentence)
        self.at = at


@dataclass(frozen=True)
class Expression:
    """A node: an operator or function of ``args``; a ``name``; or a ``number``.

    Attributes:
        kind: ``number``, ``name``, or a key of OPERATORS or FUNCTIONS.
        at: character of the text at which it begins.
    """

    kind: str
    at: int
    args: "tuple[Expression, ...]" = ()
    name: str = ""
    number: float = 0.0


def _power(xp: Any, a: Values, b: Values) -> Values:
    if type(b) is float and b.is_integer() and abs(b) <= 8.0:
        return _whole_power(a, int(b))
    return xp.maximum(a, TINY) ** b


def _whole_power(a: Values, n: int) -> Values:
    """a·a·…: exact, and with a slope at zero."""
    if n < 0:
        return 1.0 / _whole_power(a, -n)
    out = 1.0
    for _ in range(n):
        out = out * a
    return out


OPERATORS: Mapping[str, Callable[..., Values]] = MappingProxyType(
    {
        "+": lambda xp, a, b: a + b,
        "-": lambda xp, a, b: a - b,
        "*": lambda xp, a, b: a * b,
        "/": lambda xp, a, b: a / b,
        "^": _power,
        "minus": lambda xp, a: -a,
        "<": lambda xp, a, b: a < b,
        "<=": lambda xp, a, b: a <= b,
        ">": lambda xp, a, b: a > b,
        ">=": lambda xp, a, b: a >= b,
        "and": lambda xp, a, b: a & b,
        "or": lambda xp, a, b: a | b,
        "not": lambda xp, a: xp.logical_not(a),
    }
)

FUNCTIONS: Mapping[str, tuple[int, Callable[..., Values]]] = MappingProxyType(
    {
        "sqrt": (1, lambda xp, a: xp.sqrt(xp.maximum(a, TINY))),
        "exp": (1, lambda xp, a: xp.exp(xp.minimum(a, EXPONENT_CAP))),
        "log": (1, lambda xp, a: xp.log(xp.maximum(a, TINY))),
        "sin": (1, lambda xp, a: xp.sin(a)),
        "cos": (1, lambda xp, a: xp.cos(a)),
        "tanh": (1, lambda xp, a: xp.tanh(a)),
        "abs": (1, lambda xp, a: xp.abs(a)),
        "sign": (1, lambda xp, a: xp.sign(a)),
        "min": (2, lambda xp, a, b: xp.minimum(a, b)),
        "max": (2, lambda xp, a, b: xp.maximum(a, b)),
        "clip": (3, lambda xp, a, low, high: xp.minimum(xp.maximum(a, low), high)),
        "if": (3, lambda xp, c, a, b: xp.where(c, a, b)),
    }
)
"""Name → (number of arguments, value over an array namespace)."""

TRUTHS = frozenset({"<", "<=", ">", ">=", "and", "or", "not"})
"""Kinds of node that are true or false instead of a number."""

WORDS = frozenset({*FUNCTIONS, "and", "or", "not"})
"""Words that cannot be names."""

_TOKEN = re.compile(r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[^\W\d]\w*|\*\*|[<>]=?|[-+*/^(),])")


def evaluate(e: Expression, values: Mapping[str, Values], xp: Any) -> Values:
    """Value of the expression where ``values`` gives those of the names."""
    if e.kind == "number":
        return e.number
    if e.kind == "name":
        return values[e.name]
    args = [evaluate(a, values, xp) for a in e.args]
    of = OPERATORS.get(e.kind)
    return of(xp, *args) if of is not None else FUNCTIONS[e.kind][1](xp, *args)


def nodes(e: Expression) -> Iterator[Expression]:
    """The node and all below it, from left to right."""
    yield e
    for a in e.args:
        yield from nodes(a)


def names_in(e: Expression) -> frozenset[str]:
    """Names that it reads."""
    return frozenset(n.name for n in nodes(e) if n.kind == "name")


def degree(e: Expression, of: Mapping[str, int]) -> int:
    """Degree as a polynomial: 0 constant, 1 affine, 2 for everything else.

    Args:
        of: degrees of names; others have 0.
    """
    if e.kind in ("number", "name"):
        return of.get(e.name, 0)
    parts = [degree(a, of) for a in e.args]
    if e.kind in ("+", "-", "minus"):
        return max(parts)
    if e.kind == "*":
        return min(sum(parts), 2)
    if e.kind == "/":
        return 2 if parts[1] else parts[0]
    return 2 if any(parts) else 0


def parse(text: str) -> Expression:
    """Read one expression.

    Raises:
        ExpressionError: the text is none.
    """
    reader = _Reader(text)
    expression = reader.choice(0)
    if reader.now is not None:
        raise reader.error(f"nothing can follow before {reader.now!r}")
    return expression


class _Reader:
    """Recursive descent over the tokens of one expression."""

    def __init__(self, text: str) -> None:
        self.tokens: list[tuple[str, int]] = []
        self.end, self.k, at = len(text), 0, 0
        while text[at:].strip():
            match = _TOKEN.match(text, at)
            if match is None:
                at += len(text[at:]) - len(text[at:].lstrip())
                raise ExpressionError(f"the character {text[at]!r} has no meaning here", at)
            self.tokens.append((match[1], match.start(1)))
            at = match.end()
            if len(self.tokens) > MAX_TOKENS:
                raise ExpressionError(f"it has more than {MAX_TOKENS} parts: split it by let", at)

    @property
    def now(self) -> str | None:
        return self.tokens[self.k][0] if self.k < len(self.tokens) else None

    @property
    def at(self) -> int:
        return self.tokens[self.k][1] if self.k < len(self.tokens) else self.end

    def error(self, why: str) -> ExpressionError:
        return ExpressionError(why, self.at)

    def take(self, token: str) -> None:
        if self.now != token:
            before = f" before {self.now!r}" if self.now else " at the end"
            raise self.error(f"{token!r} is missing{before}")
        self.k += 1

    def _joined(
        self, tokens: tuple[str, ...], part: Callable[[int], Expression], depth: int
    ) -> Expression:
        """Parts joined from the left by operators of one rank."""
        if depth > MAX_DEPTH:
            raise self.error("it is nested too deep: split it by let")
        left = part(depth + 1)
        while self.now in tokens:
            operator, at = self.tokens[self.k]
            self.k += 1
            left = Expression(operator, at, (left, part(depth + 1)))
        return left

    def choice(self, depth: int) -> Expression:
        return self._joined(("or",), self.both, depth)

    def both(self, depth: int) -> Expression:
        return self._joined(("and",), self.truth, depth)

    def truth(self, depth: int) -> Expression:
        if self.now == "not":
            at = self.at
            self.k += 1
            return Expression("not", at, (self.truth(depth + 1),))
        left = self.sum(depth)
        if self.now in ("<", "<=", ">", ">="):
            operator, at = self.tokens[self.k]
            self.k += 1
            return Expression(operator, at, (left, self.sum(depth)))
        return left

    def sum(self, depth: int) -> Expression:
        return self._joined(("+", "-"), self.product, depth)

    def product(self, depth: int) -> Expression:
        return self._joined(("*", "/"), self.signed, depth)

    def signed(self, depth: int) -> Expression:
        if depth > MAX_DEPTH:
            raise self.error("it is nested too deep: split it by let")
        if self.now in ("-", "+"):
            sign, at = self.tokens[self.k]
            self.k += 1
            inner = self.signed(depth + 1)
            return Expression("minus", at, (inner,)) if sign == "-" else inner
        base = self.atom(depth)
        if self.now in ("^", "**"):
            at = self.at
            self.k += 1
            exponent = _folded(self.signed(depth + 1))
            if not abs(exponent.number) <= MAX_POWER:
                raise ExpressionError(f"the exponent is beyond {MAX_POWER:g}", exponent.at)
            return Expression("^", at, (base, exponent))
        return base

    def atom(self, depth: int) -> Expression:
        token, at = self.now, self.at
        if token is None:
            raise self.error("it ends too early")
        self.k += 1
        if token == "(":
            inner = self.choice(depth + 1)
            self.take(")")
            return inner
        if token[0].isdigit() or token[0] == ".":
            value = float(token)
            if not math.isfinite(value):
                raise ExpressionError(f"{token} is too large", at)
            return Expression("number", at, number=value)
        if token in FUNCTIONS:
            return self.call(token, at, depth)
        if not (token[0].isalpha() or token[0] == "_") or token in WORDS:
            raise ExpressionError(f"a number, a name or a bracket is missing before {token!r}", at)
        if self.now == "(":
            known = ", ".join(FUNCTIONS)
            raise ExpressionError(f"{token!r} is no function; there are {known}", at)
        return Expression("name", at, name=token)

    def call(self, name: str, at: int, depth: int) -> Expression:
        self.take("(")
        args = [self.choice(depth + 1)]
        while self.now == ",":
            self.k += 1
            args.append(self.choice(depth + 1))
        self.take(")")
        if len(args) != FUNCTIONS[name][0]:
            raise ExpressionError(f"{name} takes {FUNCTIONS[name][0]}, not {len(args)}", at)
        return Expression(name, at, tuple(args))


def _folded(e: Expression) -> Expression:
    """A number made of numbers alone, such as -1 or 1/2, as one."""
    if e.kind == "number" or any(n.kind == "name" or n.kind in TRUTHS for n in nodes(e)):
        return e
    if not all(n.kind in ("number", "minus", "+", "-", "*", "/") for n in nodes(e)):
        return e
    try:
        return Expression("number", e.at, number=float(evaluate(e, {}, None)))
    except ZeroDivisionError:
        raise ExpressionError("the exponent divides by 0", e.at) from None
