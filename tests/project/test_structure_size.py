"""A structure says what a model is, and no more: what else is known of it stands beside it."""

from sysid.structures.base import Structure

MOST_MEMBERS = 18


def test_a_structure_has_few_public_members() -> None:
    annotated = {name for c in Structure.__mro__ for name in getattr(c, "__annotations__", {})}
    public = {name for name in {*dir(Structure), *annotated} if not name.startswith("_")}
    assert len(public) <= MOST_MEMBERS, sorted(public)
