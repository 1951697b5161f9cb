"""Pictures in half the bytes: a report with two dozen of them should stay small."""

import re
from pathlib import Path


def made_small(file: Path) -> None:
    """Write an SVG of ours again without what a browser does not need.

    Comments, metadata and indents go, names that nothing refers to as well; letters are placed by
    ``x`` instead of a transform, styles that come again and again become classes, and a tenth of a
    point is as fine as anything is drawn.
    """
    svg = file.read_text(encoding="utf-8")
    start = svg.index("<svg")
    head, svg = svg[:start], svg[start:]
    svg = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", svg, flags=re.S)
    svg = re.sub(r'(<use [^>]*?) transform="translate\(([-\d.]+) 0\)"', r'\1 x="\2"', svg)
    svg = _short_names(svg)
    svg = _classes(svg)
    svg = re.sub(r' d="[^"]*"', _tenths, svg)
    svg = re.sub(r"\n\s*", "\n", svg)
    svg = re.sub(r">\n+<", "><", svg)
    svg = re.sub(r"<g>(<g[ >])", r"<g>\1", svg)
    file.write_text(head + svg.replace("><", ">\n<"), encoding="utf-8", newline="\n")


def _tenths(path: re.Match[str]) -> str:
    """The outline of a path to a tenth; letters are whole numbers in a frame of their own."""

    def rounded(match: re.Match[str]) -> str:
        return f"{float(match[0]):.1f}".rstrip("0").rstrip(".")

    return re.sub(r"-?\d+\.\d+", rounded, path[0])


def _short_names(svg: str) -> str:
    """Number what is referred to; drop the other names."""
    used = dict.fromkeys(re.findall(r'url\(#([^)]+)\)|"#([^"]+)"', svg))
    short = {a or b: f"i{k:x}" for k, (a, b) in enumerate(used)}

    def name(match: re.Match[str]) -> str:
        return f' id="{short[match[1]]}"' if match[1] in short else ""

    svg = re.sub(r' id="([^"]*)"', name, svg)
    svg = re.sub(r"url\(#([^)]+)\)", lambda m: f"url(#{short[m[1]]})", svg)
    return re.sub(r'"#([^"]+)"', lambda m: f'"#{short[m[1]]}"', svg)


def _classes(svg: str) -> str:
    """Give styles that occur more than once a class each."""
    styles = re.findall(r' style="([^"]*)"', svg)
    often = [s for s in dict.fromkeys(styles) if styles.count(s) > 1]
    names = {s: f"s{k:x}" for k, s in enumerate(often)}

    def name(match: re.Match[str]) -> str:
        return f' class="{names[match[1]]}"' if match[1] in names else match[0]

    svg = re.sub(r' style="([^"]*)"', name, svg)
    rules = "".join(f".{n}{{{s}}}" for s, n in names.items())
    return svg.replace("</style>", f"{rules}</style>", 1)
