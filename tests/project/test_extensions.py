"""A package that adds something broken is named in one sentence, whatever it adds."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from command_line import Capture, run

from sysid.criteria import table
from sysid.effects import catalogue
from sysid.errors import UsageError
from sysid.export.registry import exporter
from sysid.extensions import points
from sysid.robot.mission.registry import law_class
from sysid.structures.registry import structure_classes

USES: dict[str, Callable[[], object]] = {
    "sysid.structures": structure_classes,
    "sysid.effects": catalogue.catalogue,
    "sysid.criteria": lambda: table.criterion("motion.foreign"),
    "sysid.exporters": lambda: exporter("motion.foreign"),
    "sysid.mission": lambda: law_class("motion", "foreign"),
}
"""Group → what imports an extension of it."""


@pytest.fixture(params=USES)
def group(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[str]:
    """A group in which an installed package names a module that cannot be imported."""
    about = tmp_path / "site" / "foreign_parts-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign-parts\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        f"[{request.param}]\nmotion.foreign = foreign_parts:THING\n"
    )
    (tmp_path / "site" / "foreign_parts.py").write_text("raise RuntimeError('no licence')\n")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    _forget()
    yield request.param
    monkeypatch.undo()
    _forget()


def _forget() -> None:
    table._others.cache_clear()
    table._loaded.cache_clear()
    catalogue.catalogue.cache_clear()


def test_a_broken_extension_is_one_sentence_with_its_package(group: str) -> None:
    assert "motion.foreign" in points(group)
    said = r"'motion.foreign' of the package foreign-parts cannot be imported \(no licence\); mend"
    with pytest.raises(UsageError, match=said) as caught:
        USES[group]()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("group", ["sysid.structures"], indirect=True)
@pytest.mark.usefixtures("group")
def test_the_command_line_says_it_without_a_traceback(capsys: Capture) -> None:
    done = run(capsys, "structures")
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "the structure 'motion.foreign' of the package foreign-parts" in done.err
