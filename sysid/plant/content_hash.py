"""The hash of a package's content, which reveals changes after the export."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

KEY = "content_sha256"
"""Where plant.json holds the hash."""


def content_hash(described: Mapping[str, Any], files: Mapping[str, bytes]) -> str:
    """SHA-256 of what a plant package says: plant.json without the hash itself, and its files.

    Of the canonical form, so that the way JSON is laid out and the ends of lines, which tools for
    versions and for zips change without asking, do not count.

    Args:
        files: the other files that count, by name.

    Returns:
        64 hexadecimal digits.
    """
    content = {k: v for k, v in described.items() if k != KEY}
    digests = {
        name: hashlib.sha256(data.replace(b"\r\n", b"\n")).hexdigest()
        for name, data in files.items()
    }
    canonical = json.dumps([content, digests], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()
