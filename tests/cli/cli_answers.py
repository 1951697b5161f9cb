"""What a command answers: exit code, both streams, and its one JSON document."""

import json
from collections.abc import Sequence

import pytest
from sysid_cli import app


def ask(capsys: pytest.CaptureFixture[str], argv: Sequence[str]) -> tuple[int, str, str]:
    code = app.main(list(argv))
    out, err = capsys.readouterr()
    return code, out, err


def answer(capsys: pytest.CaptureFixture[str], *argv: str, code: int = 0) -> dict[str, object]:
    """The JSON document of a command that prints nothing else on stdout."""
    got, out, err = ask(capsys, [*argv, "--json"])
    assert got == code, err

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    document = json.loads(out, parse_constant=refuse)
    assert isinstance(document, dict)
    return document
