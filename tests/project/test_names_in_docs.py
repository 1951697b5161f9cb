"""What the documentation names is there: files, modules and what they hold."""

import dataclasses
import importlib
import re
from pathlib import Path

import pytest

from sysid.structures.model import Model

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    page
    for place in ("*.md", "docs/*.md", "docs/structures/*.md", "[bdst]*/README.md")
    for page in ROOT.glob(place)
)
FILES = {"/" + p.relative_to(ROOT).as_posix() for p in ROOT.glob("*/**/*.py")}
GROUPS = {
    "sysid.structures",
    "sysid.criteria",
    "sysid.effects",
    "sysid.exporters",
    "sysid.mission",
}
"""Entry-point groups, which may be called as no package is."""


def there(name: str) -> bool:
    """Whether a dotted name is a module or something in one."""
    module, parts = None, name.split(".")
    for k in range(len(parts)):
        if module is not None and hasattr(module, parts[k]):
            module = getattr(module, parts[k])
            continue
        try:
            module = importlib.import_module(".".join(parts[: k + 1]))
        except ImportError:
            return False
    return True


OF_MODEL = {f.name for f in dataclasses.fields(Model)} | set(dir(Model))


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_files_and_modules_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    files = set(re.findall(r"(?<![\w*])[\w/]+\.py\b", text))
    missing = {f for f in files if not any(p.endswith("/" + f.lstrip("/")) for p in FILES)}
    names = set(re.findall(r"(?<!\w)(?:sysid|sysid_cli|sysid_datasets|studies)(?:\.\w+)+", text))
    assert not missing | {n for n in names - GROUPS if not there(n)}
    assert set(re.findall(r"(?<![\w./])model\.([a-z]\w*)", text)) <= OF_MODEL | {"json", "py"}
