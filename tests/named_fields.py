"""Fields that a message of the library names, as a script that believes it gives them."""

import ast
import re
from typing import Any


def arguments(text: str) -> dict[str, Any]:
    """Fields with values: ``"say `inputs='u', ts=0.1`"`` as ``{"inputs": "u", "ts": 0.1}``."""
    found: dict[str, Any] = {}
    for marked in re.findall(r"`([a-z_]+=[^`]*)`", text):
        call: Any = ast.parse(f"f({marked})", mode="eval").body
        found |= {k.arg: ast.literal_eval(k.value) for k in call.keywords}
    return found
