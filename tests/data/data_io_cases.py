"""What the tests of data io share."""

from pathlib import Path

GOOD = "t,u,y\n" + "".join(f"{0.1 * k:.1f},{k % 3},{k * k % 7}.5\n" for k in range(30))


def put(folder: Path, content: str | bytes, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def table(header: str, rows: list[tuple[object, ...]], sep: str = ",") -> str:
    return "\n".join([header, *(sep.join(str(c) for c in row) for row in rows)]) + "\n"
