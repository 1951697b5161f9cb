"""No input breaks a parser: drawn faults of valid inputs, plain noise, and what once broke."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from parsers import PARSERS
from trials import drawn, fault, valid

CORPUS = [
    json.loads(line)
    for line in Path(__file__).with_name("corpus.jsonl").read_text(encoding="utf-8").splitlines()
]
"""Inputs that ended in a traceback or not at all, the shortest of each place, and how."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n == "command" else ()) for n in PARSERS]
)
def test_faults_begin_from_what_is_read(name: str, folder: Path) -> None:
    assert valid(name, folder) == []


@pytest.mark.parametrize("half", [0, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", PARSERS)
def test_a_fault_in_an_input_is_a_sentence(name: str, half: int, folder: Path) -> None:
    seeds = range(half, PARSERS[name].share, 2)
    contents = ((seed, drawn(name, seed)) for seed in seeds)
    faults = ((seed, fault(name, content, folder)) for seed, content in contents)
    assert [f for f in faults if f[1]] == []


@pytest.mark.parametrize("found", CORPUS, ids=lambda found: f"{found['parser']}: {found['was']}")
def test_what_once_broke_is_a_sentence(found: dict[str, str], folder: Path) -> None:
    assert fault(found["parser"], found["input"].encode("latin-1"), folder) == ""


NOISE = st.binary(max_size=300) | st.text(max_size=120).map(lambda t: t.encode("utf-8"))


@settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(name=st.sampled_from(sorted(PARSERS.keys() - {"command", "first commands"})), content=NOISE)
def test_noise_is_a_sentence(name: str, content: bytes, folder: Path) -> None:
    assert fault(name, content, folder) == ""
