"""How a structure is fitted is looked up by its classes, or brought by the package that has it."""

from typing import Any, ClassVar

import pytest

from sysid.errors import ModelError, UsageError
from sysid.methods import table
from sysid.methods.method import Method
from sysid.methods.search import METHOD as SEARCH
from sysid.methods.search import by_search
from sysid.structures.linear.families import ARX
from sysid.structures.registry import structure_classes


class _Theirs(ARX):
    """A structure of another package that is one of ours in all else."""

    name: ClassVar[str] = "theirs"


THEIRS = _Theirs.from_orders({"na": 1, "nb": 1}, 1, 1)


class _Point:
    """An entry point that gives an object."""

    name, dist, value = "theirs", None, "theirs.fit:METHOD"

    def __init__(self, given: object) -> None:
        self.given = given

    def load(self) -> Any:
        return self.given


@pytest.mark.parametrize("name", [n for n, c in structure_classes().items() if c.traits.options])
def test_a_family_that_chooses_has_a_method_of_its_own(name: str) -> None:
    cls = structure_classes()[name]
    nu = int(cls.traits.takes_inputs)
    needed = {"na": {"na": 1, "nb": 1}, "n": {"n": 1}, "np": {"np": 1}}
    orders = next((o for k, o in needed.items() if k in cls.traits.order_names), {})
    assert table.method_of(cls.from_orders(orders, nu, 1)).fit is not by_search


def test_a_structure_of_another_package_is_fitted_as_the_nearest_of_its_classes() -> None:
    assert table.method_of(THEIRS) is table.method_of(ARX.from_orders({"na": 1, "nb": 1}, 1, 1))


def test_a_package_may_bring_a_method(monkeypatch: pytest.MonkeyPatch) -> None:
    brought = Method(by_search, takes_method=False)
    monkeypatch.setattr(table, "points", lambda group: {"theirs": _Point(brought)})
    assert table.method_of(THEIRS) is brought


def test_what_is_no_method_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table, "points", lambda group: {"theirs": _Point(by_search)})
    with pytest.raises(UsageError, match=r"method 'theirs' .* is not a sysid\.methods\.method"):
        table.method_of(THEIRS)


def test_a_structure_that_cannot_be_searched_says_so() -> None:
    narx = structure_classes()["narx-wavelet"].from_orders({"na": 1, "nb": 1}, 1, 1)
    with pytest.raises(ModelError, match=r"name a Method in the entry-point group sysid\.methods"):
        SEARCH.fit(narx, (), None, (), ())  # type: ignore[arg-type]
