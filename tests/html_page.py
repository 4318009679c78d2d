"""Pages as a browser sees them: parsed, and laid out by a real one."""

import html
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

VOID = {"meta", "img", "source", "link", "br"}
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_SECONDS = 60

_MEASURE = """<script>
const outside = [...document.querySelectorAll("main *")].filter(
  (e) => !e.closest(".wide, pre") && e.getBoundingClientRect().right > innerWidth + 0.5);
parent.postMessage({
  width: innerWidth,
  scroll: document.documentElement.scrollWidth,
  outside: outside.map((e) => e.outerHTML.slice(0, 80)),
  pictures: [...document.images].map((e) => [e.getBoundingClientRect().width, e.getBoundingClientRect().height]),
  background: getComputedStyle(document.body).backgroundColor,
}, "*");
</script></body>"""


class Page(HTMLParser):
    """What a browser would see: elements that nest as they should, their attributes, their text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.elements if name == tag]


def assert_self_contained(text: str, page: Page) -> None:
    """Elements nest, and nothing is fetched or run."""
    assert page.open == []
    for tag, attributes in page.elements:
        for name in ("src", "srcset", "href", "data", "poster"):
            assert attributes.get(name, "data:").startswith("data:"), (tag, name)
    assert not re.search(r"url\(|@import|<script|<link|https?://", text)


def laid_out(text: str, width: int, folder: Path, *, dark: bool = False) -> dict[str, Any]:
    """What a browser makes of a page in a window of that width, in CSS pixels.

    A frame has the width, as windows without a head are never narrower than 500.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"looking at pages takes a browser: one of {', '.join(BROWSERS)}")
    inner = html.escape(text.replace("</body>", _MEASURE))
    outer = (
        "<!doctype html><pre></pre><script>onmessage = (m) => document.querySelector('pre').textContent = "
        f'JSON.stringify(m.data)</script><iframe width={width} height=800 style="border:0" srcdoc="{inner}"></iframe>'
    )
    place = folder / "laid-out.html"
    place.write_text(outer, encoding="utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000", "--dump-dom"]
    command += [f"--user-data-dir={folder / 'profile'}", f"--blink-settings=preferredColorScheme={0 if dark else 1}"]
    done = subprocess.run([*command, place.as_uri()], capture_output=True, text=True, timeout=_SECONDS, check=True)
    found = re.search(r"<pre>(.+?)</pre>", done.stdout)
    assert found, done.stderr
    measured: dict[str, Any] = json.loads(html.unescape(found[1]))
    return measured
