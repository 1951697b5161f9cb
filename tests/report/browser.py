"""Chromium as a judge of pages: what sticks out of a frame, and how many pictures are seen."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")

MEASURE = """<script>addEventListener("load", () => {
  const wide = [...document.querySelectorAll("body *:not(svg *):not(.letters)")]
    .filter(e => e.getBoundingClientRect().right > innerWidth + 0.5 ||
      e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX != "visible")
    .map(e => e.tagName + " " + e.textContent.slice(0, 40));
  const seen = q => [...document.querySelectorAll(q)]
    .filter(e => e.getBoundingClientRect().width > 0).length;
  parent.postMessage(JSON.stringify({inner: innerWidth,
    full: document.documentElement.scrollWidth, wide,
    pictures: seen("figure > svg")}), "*"); });</script></body>"""


def dumped(page: str, folder: Path, name: str = "page.html") -> str:
    """The document after its scripts have run."""
    (folder / name).write_text(page, encoding="utf-8")
    assert BROWSER is not None
    return subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
         "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync", "--hide-scrollbars", f"--user-data-dir={folder / 'profile'}",
         "--virtual-time-budget=10000", "--dump-dom", (folder / name).as_uri()],
        capture_output=True, text=True, timeout=120, check=False,
    ).stdout  # fmt: skip


def laid_out(page: str, folder: Path, width: int = 360) -> dict[str, Any]:
    """{inner, full, wide, pictures} of a page in a frame so many pixels wide."""
    (folder / "page.html").write_text(page.replace("</body>", MEASURE), encoding="utf-8")
    frame = (
        '<!DOCTYPE html><body><pre id="said"></pre><script>addEventListener("message", '
        'e => { document.getElementById("said").textContent = e.data; });</script>'
        f'<iframe src="page.html" style="width:{width}px;height:800px;border:0"></iframe></body>'
    )
    seen = dumped(frame, folder, "frame.html")
    said = re.search(r'<pre id="said">(.*?)</pre>', seen, re.S)
    assert said, seen[-500:]
    document: dict[str, Any] = json.loads(said[1].replace("&amp;", "&"))
    return document
