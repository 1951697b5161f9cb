"""Expressions in lagged signals, such as ``|u(t-1)|`` or ``y(t-1)*sign(u2(t-1))``: a safe grammar.

    sum     := product (('+' | '-') product)*
    product := sign (('*' | '/') sign)*
    sign    := '-' sign | power
    power   := atom ('^' digits)?
    atom    := number | signal | name '(' sum (',' sum)* ')' | '(' sum ')' | '|' sum '|'
    signal  := ('y' | 'u' | 'e') digits? ('(' 't' ('-' digits)? ')')?

Read by recursive descent into a tree of four kinds of node; nothing is ever executed as code.
Every expression is finite for finite signals: only numbers divide, exponents are whole numbers,
the root is that of the positive part and the exponential is capped.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from sysid.errors import UsageError
from sysid.outside_text import whole
from sysid.structures.difference_equations.signals import Signal
from sysid.structures.orders import MAX_ORDER

MAX_TEXT = 300
MAX_DEPTH = 30
MAX_POWER = 6
EXPONENT_CAP = 30.0


@dataclass(frozen=True)
class Number:
    """A constant."""

    value: float


@dataclass(frozen=True)
class EveryLag:
    """A signal written without a time: it stands for each lag that the orders name in turn."""

    kind: str
    channel: int


@dataclass(frozen=True)
class Call:
    """A function of expressions: one of FUNCTIONS, or an operator ``+ - * / ^ minus``."""

    name: str
    args: "tuple[Expression, ...]"


Expression = Number | Signal | EveryLag | Call
Values = Any
"""A number, or an array of numpy or jax.numpy."""

FUNCTIONS: Mapping[str, tuple[int, Callable[..., Values], str]] = {
    "abs": (1, lambda xp, a: xp.abs(a), "magnitude; also written |…|"),
    "sign": (1, lambda xp, a: xp.sign(a), "-1, 0 or 1"),
    "pos": (1, lambda xp, a: xp.maximum(a, 0.0), "positive part"),
    "neg": (1, lambda xp, a: xp.minimum(a, 0.0), "negative part"),
    "sqrt": (1, lambda xp, a: xp.sqrt(xp.maximum(a, 0.0)), "root of the positive part"),
    "exp": (1, lambda xp, a: xp.exp(xp.minimum(a, EXPONENT_CAP)), "exponential, capped"),
    "tanh": (1, lambda xp, a: xp.tanh(a), "hyperbolic tangent"),
    "sin": (1, lambda xp, a: xp.sin(a), "sine"),
    "cos": (1, lambda xp, a: xp.cos(a), "cosine"),
    "min": (2, lambda xp, a, b: xp.minimum(a, b), "smaller of two"),
    "max": (2, lambda xp, a, b: xp.maximum(a, b), "larger of two"),
}
"""Name → (number of arguments, value over an array namespace, meaning)."""

_OPERATORS: Mapping[str, Callable[..., Values]] = {
    "+": lambda xp, a, b: a + b,
    "-": lambda xp, a, b: a - b,
    "*": lambda xp, a, b: a * b,
    "/": lambda xp, a, b: a / b,
    "^": lambda xp, a, b: a ** int(b),
    "minus": lambda xp, a: -a,
}

_TOKEN = re.compile(r"\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|[^\W\d]\w*|[-+*/^(),|])")
_SIGNAL = re.compile(r"([yue])(\d*)")


def evaluate(e: Expression, lookup: Callable[[Signal], Values], xp: Any) -> Values:
    """Value of the expression where ``lookup`` gives those of the signals."""
    if isinstance(e, Number):
        return e.value
    if isinstance(e, Signal):
        return lookup(e)
    if isinstance(e, EveryLag):
        raise ValueError(f"{e} has no lag")
    if e.name == "^":
        exponent = e.args[1]
        assert isinstance(exponent, Number)
        return evaluate(e.args[0], lookup, xp) ** int(exponent.value)
    values = [evaluate(a, lookup, xp) for a in e.args]
    operator = _OPERATORS.get(e.name)
    if operator is not None:
        return operator(xp, *values)
    return FUNCTIONS[e.name][1](xp, *values)


def signals(e: Expression) -> Iterator[Signal]:
    """Every signal in it, from left to right."""
    if isinstance(e, Signal):
        yield e
    elif isinstance(e, Call):
        for a in e.args:
            yield from signals(a)


def without_time(e: Expression) -> Iterator[EveryLag]:
    """Every signal in it that has no time, from left to right."""
    if isinstance(e, EveryLag):
        yield e
    elif isinstance(e, Call):
        for a in e.args:
            yield from without_time(a)


Leaf = TypeVar("Leaf", Signal, EveryLag)


def replaced(e: Expression, kind: type[Leaf], change: Callable[[Leaf], Expression]) -> Expression:
    """The expression with something else in the places of its leaves of one kind."""
    if isinstance(e, kind):
        return change(e)
    if isinstance(e, Call):
        return Call(e.name, tuple(replaced(a, kind, change) for a in e.args))
    return e


def _generic(s: Signal | EveryLag) -> str:
    return f"{s.kind}{s.channel + 1}"


def written(e: Expression, name: Callable[[Signal | EveryLag], str] = _generic) -> str:
    """The expression as text that ``parse`` reads back; ``name`` gives the signals' names."""
    return _written(e, name, 0)


_LEVEL = {"+": 1, "-": 1, "*": 2, "/": 2, "minus": 3, "^": 4}


def _written(e: Expression, name: Callable[[Signal | EveryLag], str], binding: int) -> str:
    if isinstance(e, Number):
        return repr(e.value)
    if isinstance(e, EveryLag):
        return name(e)
    if isinstance(e, Signal):
        return f"{name(e)}(t)" if e.lag == 0 else f"{name(e)}(t-{e.lag})"
    binding_of_operator = _LEVEL.get(e.name, 9)
    if e.name == "abs":
        return f"|{_written(e.args[0], name, 0)}|"
    if e.name == "minus":
        text = "-" + _written(e.args[0], name, binding_of_operator)
    elif e.name == "^":
        exponent = e.args[1]
        assert isinstance(exponent, Number)
        text = f"{_written(e.args[0], name, binding_of_operator + 1)}^{int(exponent.value)}"
    elif e.name in _OPERATORS:
        left, right = (_written(a, name, binding_of_operator + k) for k, a in enumerate(e.args))
        text = f"{left}{e.name}{right}"
    else:
        return f"{e.name}({', '.join(_written(a, name, 0) for a in e.args)})"
    return f"({text})" if binding_of_operator < binding else text


# ----------------------------------------------------------------------------- reading


EXAMPLES: Mapping[str, str] = {
    "regressors": "|u(t-1)|, y(t-1)*sign(u(t-1))",
    "terms": 'products such as "y(t-1)^2*u2(t-1)", or constant',
}
"""What may be written in each option that holds expressions."""


def cannot_read(option: str, text: str, why: str) -> UsageError:
    """The one sentence about an expression that cannot be read."""
    return UsageError(
        f"`structure_options[{option!r}]`: cannot read {text.strip()!r}: {why}; write for example "
        f"{EXAMPLES[option]}"
    )


def parse(
    text: str, nu: int, ny: int, option: str = "regressors", error_of: int | None = None
) -> Expression:
    """Read one expression; y and u without a number are the first channel.

    Args:
        nu, ny: inputs and outputs that there are.
        option: the option that holds it, for sentences about what is wrong.
        error_of: output whose past errors e may occur, e without a number being those; none where
            None.
    """
    if len(text) > MAX_TEXT:
        raise UsageError(
            f"`structure_options[{option!r}]`: an expression of {len(text)} characters is longer "
            f"than {MAX_TEXT}; split it"
        )
    reader = _Reader(text, {"u": nu, "y": ny, "e": 0 if error_of is None else ny}, option)
    reader.first["e"] = error_of or 0
    expression = reader.sum(0)
    if reader.now is not None:
        raise reader.error(f"nothing can follow before {reader.now!r}")
    if not any(True for _ in (*signals(expression), *without_time(expression))):
        raise reader.error("it holds no signal; use y(t-1), u(t-1) …")
    return expression


class _Reader:
    """Recursive descent over the tokens of one expression."""

    def __init__(self, text: str, count: Mapping[str, int], option: str) -> None:
        self.text, self.count, self.option = text, count, option
        self.first = dict.fromkeys(count, 0)
        self.tokens: list[str] = []
        at = 0
        while at < len(text.rstrip()):
            match = _TOKEN.match(text, at)
            if match is None:
                raise self.error(f"the character {text[at:].lstrip()[0]!r} has no meaning here")
            self.tokens.append(match.group(1))
            at = match.end()
        self.at = 0

    @property
    def now(self) -> str | None:
        return self.tokens[self.at] if self.at < len(self.tokens) else None

    def error(self, why: str) -> UsageError:
        return cannot_read(self.option, self.text, why)

    def take(self, token: str) -> None:
        if self.now != token:
            raise self.error(
                f"{token!r} is missing" + (f" before {self.now!r}" if self.now else "")
            )
        self.at += 1

    def next(self) -> str:
        if self.now is None:
            raise self.error("it ends too early")
        self.at += 1
        return self.tokens[self.at - 1]

    def sum(self, depth: int) -> Expression:
        if depth > MAX_DEPTH:
            raise self.error(f"it is nested deeper than {MAX_DEPTH}")
        expression = self.product(depth + 1)
        while self.now in ("+", "-"):
            expression = Call(self.next(), (expression, self.product(depth + 1)))
        return expression

    def product(self, depth: int) -> Expression:
        expression = self.signed(depth)
        while self.now in ("*", "/"):
            operator = self.next()
            right = self.signed(depth)
            if operator == "/" and not (isinstance(right, Number) and right.value != 0.0):
                raise self.error("only a number other than 0 may divide")
            expression = Call(operator, (expression, right))
        return expression

    def signed(self, depth: int) -> Expression:
        if depth > MAX_DEPTH:
            raise self.error(f"it is nested deeper than {MAX_DEPTH}")
        if self.now == "-":
            self.at += 1
            return Call("minus", (self.signed(depth + 1),))
        expression = self.atom(depth)
        if self.now == "^":
            self.at += 1
            exponent = self.next()
            if not 1 <= (whole(exponent) or 0) <= MAX_POWER:
                raise self.error(
                    f"the exponent {exponent!r} is no whole number of at most {MAX_POWER}"
                )
            expression = Call("^", (expression, Number(float(exponent))))
        return expression

    def atom(self, depth: int) -> Expression:
        token = self.next()
        if token[0].isdigit():
            value = float(token)
            if not math.isfinite(value):
                raise self.error(f"{token} is too large")
            return Number(value)
        if token == "(":
            expression = self.sum(depth + 1)
            self.take(")")
            return expression
        if token == "|":
            expression = self.sum(depth + 1)
            self.take("|")
            return Call("abs", (expression,))
        if token in FUNCTIONS:
            return self.call(token, depth)
        match = _SIGNAL.fullmatch(token)
        if match is None:
            known = ", ".join(FUNCTIONS)
            raise self.error(
                f"{token!r} is no signal (a name of the log, or y, u, y2 …) "
                f"and no function ({known})"
            )
        return self.signal(match.group(1), match.group(2), token)

    def call(self, name: str, depth: int) -> Expression:
        self.take("(")
        args = [self.sum(depth + 1)]
        while self.now == ",":
            self.at += 1
            args.append(self.sum(depth + 1))
        self.take(")")
        if len(args) != FUNCTIONS[name][0]:
            raise self.error(f"{name} takes {FUNCTIONS[name][0]}, not {len(args)}")
        return Call(name, tuple(args))

    def signal(self, kind: str, number: str, token: str) -> Expression:
        channel = int(number) - 1 if number else self.first[kind]
        if not 0 <= channel < self.count[kind]:
            what = {"u": "inputs", "y": "outputs", "e": "past errors"}[kind]
            raise self.error(f"{token!r} is not there, the log has {self.count[kind]} {what}")
        if self.now != "(":
            return EveryLag(kind, channel)
        self.at += 1
        if self.next() != "t":
            raise self.error(f"after {token} only a time such as (t-1) can follow")
        lag = 0
        if self.now == "-":
            self.at += 1
            digits = self.next()
            number_read = whole(digits)
            if number_read is None or number_read > MAX_ORDER:
                raise self.error(f"the lag {digits!r} is no whole number to {MAX_ORDER}")
            lag = number_read
        self.take(")")
        if kind != "u" and lag == 0:
            raise self.error(f"{token}(t) is what the equation is to give; lag it")
        return Signal(kind, channel, lag)
