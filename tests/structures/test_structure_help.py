"""``sysid structures NAME`` tells what can be asked of a structure; nothing else is accepted."""

import pytest
from sysid_cli.structures import _facts

from sysid.errors import UsageError
from sysid.structures.registry import structure_classes

CLASSES = structure_classes()
ORDERS = {
    "narx-wavelet": {"na": 1, "nb": 1},
    "narmax": {"na": 1, "nb": 1},
    "arx": {"na": 1, "nb": 1},
    "armax": {"na": 1, "nb": 1, "nc": 1},
    "oe": {"nb": 1, "nf": 1},
    "bj": {"nb": 1, "nc": 1, "nd": 1, "nf": 1},
}


def _refusal(name: str, option: str) -> str:
    with pytest.raises(UsageError) as caught:
        CLASSES[name].from_orders(ORDERS.get(name, {}), 1, 1, {option: "no-such-value %"})
    return str(caught.value)


@pytest.mark.parametrize("name", CLASSES)
def test_every_option_is_described_and_no_other_is_accepted(name: str) -> None:
    refusal = _refusal(name, "no_such_option")
    assert f"{name} has no option 'no_such_option'" in refusal
    for option, meaning in CLASSES[name].traits.options.items():
        assert len(meaning.split()) > 3, option
        assert option in refusal
        assert "has no option" not in _refusal(name, option)  # known: only the value is wrong


@pytest.mark.parametrize("name", CLASSES)
def test_the_description_is_complete(name: str) -> None:
    facts = _facts(CLASSES[name])
    assert all(facts[key] for key in ("title", "when", "equation", "description"))
    assert [o["name"] for o in facts["options"]] == list(CLASSES[name].traits.options)
    assert [o["name"] for o in facts["orders"]] == list(CLASSES[name].traits.order_names)
    assert all(o["meaning"] for o in facts["orders"])
    assert all(c["meaning"] for c in facts["constants"])


def test_the_constants_of_grey_boxes_are_listed() -> None:
    motor = {c["name"]: c for c in _facts(CLASSES["dc-motor"])["constants"]}
    assert motor["gain"]["estimated"] == "always"
    assert motor["breakaway"]["estimated"] == "where held-out data pay for it"
    assert motor["coulomb_back"]["estimated"] == "if option free names it"
    assert motor["coupling"]["meaning"]
    assert not _facts(CLASSES["arx"])["constants"]
