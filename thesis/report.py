"""``thesis.md``: the thesis figure by figure, what is published beside the same made here.

The inventory of all figures and tables stands in ``thesis/inventory.py``; each module
``thesis/chapter*.py`` has one small function for every picture and the rows that go with it.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from sysid.report.markdown import table
from sysid.report.plots import write_picture
from thesis import bench_motor, chapter2, chapter4, chapter5, chapter6, chapter7, chapter8, pendulum
from thesis.entries import DISAGREES, DRAWN, MISPRINT, Item, Kind, Row, Sheet
from thesis.inventory import CHAPTERS, ITEMS
from thesis.small import made_small

SHEETS: Mapping[int, Sequence[Callable[[], Sheet]]] = {
    2: (*chapter2.SHEETS, bench_motor.characteristic),
    4: chapter4.SHEETS,
    5: (bench_motor.constants, bench_motor.loads, *chapter5.SHEETS, pendulum.swing),
    6: (bench_motor.simulation, *chapter6.SHEETS),
    7: (chapter7.body,),
    8: chapter8.SHEETS,
}
"""Chapter → the functions that make its pictures and rows, in the order of the thesis."""

HEAD = """# The thesis, figure by figure

Every figure and table of the thesis behind this workbench: what it publishes, and what we get.
*{drawn}* stands where the thesis has a curve and prints no number of it. What needs the robot's own
logs is made with the bundled twin, whose tracks are not the thesis's: such rows test the method,
not the digits.

Four robots drive the missions: a NARX network of the thesis's structure and orders, identified
from `multilevel` (in the place of its Simulink model), a twin with two equal tracks and, *by
forces*, the planar dynamics with Gazebo's mass and friction (both of its model in Gazebo), and the
twin seen through sensors and a Kalman filter (of the robot). Nothing was tuned to the published
outcomes. The same missions with the model that the workbench chooses by itself
are in [missions.md](missions.md), its gains in [tuning.md](tuning.md).

"""

MISPRINT_HEAD = """
## Misprints

"""

DISAGREE_HEAD = """
## Described by the thesis, and not so here

"""

COUNT_HEAD = ["chapter", "figures and tables", "computed", "picture or diagram", "not computable"]


def write(folder: Path) -> Mapping[str, str]:
    """The page; the pictures go into the folder ``thesis`` beside it."""
    made = {chapter: [sheet() for sheet in sheets] for chapter, sheets in SHEETS.items()}
    for sheets in made.values():
        for sheet in sheets:
            draw(folder / "thesis", sheet)
    return {"thesis.md": page(made)}


def draw(folder: Path, sheet: Sheet) -> None:
    """Draw the picture of a sheet, if it has one."""
    if sheet.picture is None:
        return
    file = folder / sheet.file
    file.parent.mkdir(parents=True, exist_ok=True)
    write_picture(file, sheet.picture)
    made_small(file)


def page(made: Mapping[int, Sequence[Sheet]]) -> str:
    """The text of the report."""
    text = HEAD.format(drawn=DRAWN) + _counts()
    rows = [row for chapter in CHAPTERS for sheet in made.get(chapter, ()) for row in sheet.rows]
    text += MISPRINT_HEAD + _chosen(rows, MISPRINT) + DISAGREE_HEAD + _chosen(rows, DISAGREES)
    for chapter, title in CHAPTERS.items():
        text += f"\n## {chapter} {title}\n" + _chapter(chapter, made.get(chapter, ()))
    return text


def items(chapter: int) -> list[Item]:
    """The figures and tables of a chapter."""
    return [i for i in ITEMS if re.search(r"\d+", i.number)[0] == str(chapter)]  # type: ignore[index]


def shown(rows: Iterable[Row]) -> str:
    """Rows as a table."""
    headers = ["figure", "what", "published", "ours", "difference", "why"]
    cells = [[r.figure, r.what, r.published, r.ours, r.difference, r.why] for r in rows]
    return table(headers, cells)


def _chosen(rows: Iterable[Row], difference: str) -> str:
    """The rows whose difference says so."""
    cells = [
        [r.figure, r.what, r.published, r.ours, r.why]
        for r in rows
        if r.difference.startswith(difference)
    ]
    return table(["figure", "what", "published", "ours", "why"], cells)


def _counts() -> str:
    rows = []
    for chapter, title in CHAPTERS.items():
        kinds = [i.kind for i in items(chapter)]
        computed, missing = kinds.count(Kind.COMPUTED), kinds.count(Kind.MISSING)
        counts = (len(kinds), computed, len(kinds) - computed - missing, missing)
        rows.append([f"{chapter} {title}", *map(str, counts)])
    totals = (str(sum(int(r[k]) for r in rows)) for k in range(1, 5))
    return table(COUNT_HEAD, [*rows, ["all", *totals]], "lrrrr")


def _chapter(chapter: int, sheets: Sequence[Sheet]) -> str:
    text = ""
    for sheet in sheets:
        if sheet.file:
            name = sheet.file.rpartition("/")[2].removesuffix(".svg").replace("_", " ")
            text += f"\n![{name}](thesis/{sheet.file})\n"
        text += "\n" + shown(sheet.rows)
    mine = items(chapter)
    partly = [[i.number, i.missing] for i in mine if i.kind is Kind.COMPUTED and i.missing]
    if partly:
        text += "\nComputed as far as it goes:\n\n" + table(["figure", "not printed"], partly)
    rest = [i for i in mine if i.kind is not Kind.COMPUTED]
    if rest:
        cells = [[i.number, i.title, i.kind.value, i.missing or "–"] for i in rest]
        text += "\nNot computed:\n\n" + table(["figure", "what", "because", "not printed"], cells)
    return text
