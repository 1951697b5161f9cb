"""Spellings of units: behind a name, in brackets, in other languages, as endings."""

import re


def word_groups(*texts: str) -> tuple[tuple[str, ...], ...]:
    """The words of each text, which stand in it with blanks between."""
    return tuple(tuple(text.split()) for text in texts)


def word_set(text: str) -> frozenset[str]:
    """The words of a text, which stand in it with blanks between."""
    return frozenset(text.split())


SYNONYMS: dict[str, str] = {
    **dict.fromkeys(
        ("u/min", "1/min", "min^-1", "min-1", "/min", "tr/min", "r/min", "rev/min", "upm", "rpm"),
        "rpm",
    ),
    **dict.fromkeys(("u/s", "tr/s", "r/s", "rps", "turns/s"), "rev/s"),
    **dict.fromkeys(("deg/sec", "degs", "dps", "grad/s", "degree/s", "degrees/s"), "deg/s"),
    **dict.fromkeys(("degree", "degrees", "grad"), "deg"),
    **dict.fromkeys(("rads/s", "rad/sec", "rad s^-1", "rad*s^-1"), "rad/s"),
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("umdrehungen", "turns", "turn"), "rev"),
    **dict.fromkeys(("kmh", "km/std", "kph"), "km/h"),
    **dict.fromkeys(("m/sec", "m s^-1", "mps"), "m/s"),
    **dict.fromkeys(("knots", "knot", "kts", "kt"), "kn"),
    **dict.fromkeys(("meter", "metre", "meters", "metres"), "m"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("amp", "amps", "ampere"), "A"),
    **dict.fromkeys(("milliamp", "milliamps", "milliampere"), "mA"),
    **dict.fromkeys(("degc", "celsius", "deg c", "°c"), "degC"),
    **dict.fromkeys(("hertz",), "Hz"),
    **dict.fromkeys(("newton",), "N"),
    **dict.fromkeys(("n*m", "n m", "newtonmeter"), "Nm"),
    **dict.fromkeys(("sec", "secs", "second", "seconds", "sek", "sekunden"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds", "millisekunden"), "ms"),
}
"""Spelling in lower case, with signs put as ``plain`` puts them -> name in ``units.UNITS``."""

ENDINGS: dict[str, str] = {
    **dict.fromkeys(("rad_s", "rads", "radps"), "rad/s"),
    **dict.fromkeys(("rpm", "upm", "u_min", "1_min", "rev_min"), "rpm"),
    **dict.fromkeys(("deg_s", "degs", "degps", "dps"), "deg/s"),
    **dict.fromkeys(("rev_s", "rps"), "rev/s"),
    **dict.fromkeys(("m_s", "mps"), "m/s"),
    **dict.fromkeys(("km_h", "kmh", "kph"), "km/h"),
    **dict.fromkeys(("kts", "knots"), "kn"),
    **{"mm_s": "mm/s", "cm_s": "cm/s", "us": "us", "volt": "V"},
    **{u: u for u in ("rad", "deg", "m", "cm", "mm", "V", "mV", "A", "mA", "W", "N", "kN", "Nm")},
    **{u: u for u in ("kg", "Pa", "kPa", "bar", "degC", "K", "Hz")},
}
"""Ending of a name behind an underline -> its unit."""

_ANY_CASE = {e.lower(): u for e, u in ENDINGS.items() if len(e) > 2 or e in ("cm", "mm")}
"""Endings that cannot be mistaken for another one in capitals: ``RPM``, ``Deg``."""
_CAMEL = {"Deg": "deg", "Rad": "rad", "Rpm": "rpm", "RPM": "rpm", "Mm": "mm", "Cm": "cm"}
"""Endings without an underline: ``yawDeg``, ``speedRpm``."""


_BEARING = re.compile(r"deg[ _-]?(?!(?-i:[cCfFkKrR])$)([a-z]|true|mag|magnetic|rel|relative)", re.I)
"""An angle and what it is measured from: ``°T`` (true north), ``deg M`` (magnetic); no scale of
temperature."""


def plain(unit: str) -> str:
    """A unit as written in a file, in the signs that the tables use: ``[°/s]`` → ``deg/s``."""
    text = unit.strip().strip("[](){}<>").strip()
    for sign, letters in (("°C", "degC"), ("º", "°"), ("°", "deg"), ("µ", "u"), ("μ", "u")):
        text = text.replace(sign, letters)
    for sign, letters in (("⁻¹", "^-1"), ("²", "^2"), ("·", "*"), ("−", "-"), ("^(-1)", "^-1")):
        text = text.replace(sign, letters)
    return text


def synonym(unit: str) -> str:
    """The name in ``units.UNITS`` of a unit however it is spelt, or the unit as it is."""
    text = plain(unit)
    known = SYNONYMS.get(text.lower(), text)
    return "deg" if _BEARING.fullmatch(known) else known


def ending(name: str) -> tuple[str, str]:
    """A name without the unit it ends in, and that unit: ``u_V`` → (u, V); (name, "") if none.

    What stands behind a stroke is a part of another unit: ``EC mS/cm`` is no length.
    """
    written = name.replace("/", "_")  # speed_rad/s, Drehzahl_1/min
    for text, endings in ((written, ENDINGS), (written.lower(), _ANY_CASE)):
        for end in sorted(endings, key=len, reverse=True):
            if text.endswith("_" + end) and name[-len(end) - 1] != "/":
                return name[: -len(end) - 1], endings[end]
    for end, unit in _CAMEL.items():
        if name.endswith(end) and name[: -len(end)][-1:].islower():
            return name[: -len(end)], unit
    return name, ""


def without_unit(name: str) -> str:
    """A name without the unit it ends in."""
    return ending(name)[0]


def looks_like_unit(cell: str, known: frozenset[str]) -> bool:
    """Whether a cell below the header is a unit: in brackets, known, a sign for none."""
    text = cell.strip()
    if re.fullmatch(r"[\[(][^\[\]()]{0,12}[\])]", text) or text in ("-", "–", "%", "--"):
        return True
    name = synonym(text)
    return name in known or name.lower() in known


def ratio(top: str, bottom: str) -> str:
    """``rpm/V``, ``(rad/s)/V``, ``1/V``: a unit over another, empty where they cancel.

    Where the lower one has no unit the upper one stands alone.
    """
    if top == bottom:
        return ""
    return f"{bracketed(top) or '1'}/{bracketed(bottom)}" if bottom else top


def bracketed(unit: str) -> str:
    """A unit as part of a fraction: in brackets where it is a fraction or product itself."""
    return f"({unit})" if "/" in unit or "·" in unit else unit
