"""Expressions in the log's own channel names, translated to y2, u1 for the grammars.

What a model prints, ``|pwm_l(t-1)|`` or ``omega_l(t−1)²·left motor [V](t−2)``, is read back.
"""

import re
from collections.abc import Mapping, Sequence

from sysid.data.record import Channel
from sysid.structures.difference_equations.expressions import FUNCTIONS

EXPRESSIONS = ("regressors", "terms")
"""Options of structures that hold expressions in signals."""

_PRINTED = str.maketrans({"·": "*", "−": "-"})
_SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹"
_POWER = re.compile(f"[{_SUPERSCRIPTS}]+")
_AT_A_TIME = re.compile(r"\s*\(\s*t\s*[-−)]")
_IN_A_NAME = re.compile(r"[\w.]")


def in_generic_names(text: str, inputs: Sequence[Channel], outputs: Sequence[Channel]) -> str:
    """The text with ``u1``, ``y2`` … in the places of the channels' names.

    The longest name that stands at a place counts, so that names may hold brackets, blanks,
    umlauts and signs of arithmetic. A channel called like a function is one only at a time, as in
    ``sin(t-1)``; a channel called ``u2`` or ``y`` is itself and no number of a channel.

    Args:
        text: expressions, divided by commas and semicolons.
    """
    generic = {c.name: f"y{k}" for k, c in enumerate(outputs, 1)}
    generic |= {c.name: f"u{k}" for k, c in enumerate(inputs, 1)}
    names = sorted((n for n in generic if n and not n.isdigit()), key=len, reverse=True)
    errors = {f"e_{c.name}": f"e{k}" for k, c in enumerate(outputs, 1)}
    written, at = "", 0
    while at < len(text):
        time = _AT_A_TIME.match(text, at)
        if time is not None:  # a channel may be called t, too
            written, at = written + time[0], time.end()
            continue
        error = next((n for n in errors if text.startswith(n, at)), None)
        name = error or next((n for n in names if _stands(n, text, at)), None)
        if name is not None:
            written += errors[name] if error else generic[name]
            at += len(name)
            continue
        step = 1
        if _IN_A_NAME.match(text[at]):  # another word is passed over whole: no name begins inside
            while at + step < len(text) and _IN_A_NAME.match(text[at + step]):
                step += 1
        written += text[at : at + step]
        at += step
    powers = _POWER.sub(lambda m: "^" + "".join(str(_SUPERSCRIPTS.index(c)) for c in m[0]), written)
    return powers.translate(_PRINTED)


def _stands(name: str, text: str, at: int) -> bool:
    """Whether a channel's name stands here as a whole."""
    end = at + len(name)
    if not text.startswith(name, at):
        return False
    after = text[end : end + 1]
    if _IN_A_NAME.match(name[-1]) and after and _IN_A_NAME.match(after):
        return after in _SUPERSCRIPTS
    timed = _AT_A_TIME.match(text, end) is not None
    called = text[end:].lstrip().startswith("(") and not timed
    return not called and (timed or name not in FUNCTIONS)


def options_in_generic_names(
    options: Mapping[str, str], inputs: Sequence[Channel], outputs: Sequence[Channel]
) -> dict[str, str]:
    """A structure's options, their expressions in generic names."""
    return {
        name: in_generic_names(text, inputs, outputs) if name in EXPRESSIONS else text
        for name, text in options.items()
    }
