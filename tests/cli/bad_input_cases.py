"""What the tests of bad input share."""

import re


def assert_one_sentence(text: str, line: str) -> None:
    """One line that a person can read: no traceback, nothing unforeseen, no loose end."""
    assert text.endswith("\n"), line
    assert text.count("\n") == 1, f"{line}: {text}"
    assert "Traceback" not in text
    assert "unexpected" not in text, text
    sentence = text.strip()
    assert re.search(r"[\w).`'’\]%…}\"+?]$", sentence), f"{line}: {sentence}"
    assert len(sentence) > 20, sentence
    assert "  " not in sentence, sentence
