"""Chromium without a window, for tests of pages: what it says, what it asks for, and what a reader meets on a page."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

PROGRAM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p), None)
QUIET = ("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking")
SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
NO_3D = ("--disable-gpu", "--disable-3d-apis")
BY_THE_LIBRARY = (
    "willReadFrequently"  # advice of the browser about how plotly measures texts; nothing that we can change
)

# What a reader meets: texts with their size, colour and ground. Ground: the nearest one that is not transparent.
TEXTS = """() => {
  const numbers = (colour) => {
    const found = colour.match(/[\\d.]+/g).map(Number);
    const most = colour.startsWith("color(") ? 255 : 1;
    return { rgb: found.slice(0, 3).map((v) => most * v), alpha: found[3] ?? 1 };
  };
  const ground = (element) => {
    for (let e = element; e; e = e.parentElement) {
      const { rgb, alpha } = numbers(getComputedStyle(e).backgroundColor);
      if (alpha > 0.5) return rgb;
    }
    return [255, 255, 255];
  };
  const isShown = (e) => e.checkVisibility({ visibilityProperty: true })
    && !e.closest("script, style, noscript, title, defs, .skip");
  const out = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode, text = node.textContent.trim(), element = node.parentElement;
    if (!text || !isShown(element)) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const box = range.getBoundingClientRect();
    if (!box.width || !box.height) continue;
    const style = getComputedStyle(element), drawn = element.closest("svg text");
    const scale = drawn ? Math.hypot(drawn.getScreenCTM().a, drawn.getScreenCTM().b) : 1;
    out.push({
      text, drawn: Boolean(drawn), size: parseFloat(style.fontSize) * scale, bold: Number(style.fontWeight) >= 600,
      colour: numbers(drawn ? style.fill : style.color).rgb, ground: ground(element),
      where: element.closest("section")?.id ?? element.tagName,
    });
  }
  return out;
}"""
# Everything that can be used, of radio buttons the chosen one.
CONTROLS = """() => [...document.querySelectorAll("a[href], button, input, select, summary")]
  .filter((e) => e.checkVisibility({ visibilityProperty: true }) && !e.disabled && !e.closest("svg"))
  .filter((e) => e.type !== "radio" || e.checked)
  .map((e, i) => { e.dataset.number = i; return e.outerHTML.slice(0, 90); })"""
FOCUSED = """() => {
  const e = document.activeElement, style = getComputedStyle(e);
  return { number: e.dataset.number ?? null, outline: style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 1 };
}"""
# What reaches beyond the right edge, but for what can be scrolled by itself.
WIDE = """() => [...document.querySelectorAll("body *")]
  .filter((e) => e.getBoundingClientRect().right > innerWidth + 0.5 && !e.closest("nav, .scroll, .skip"))
  .map((e) => e.outerHTML.slice(0, 120))"""


@dataclass
class Watched:
    """A page, what it wrote to the console and what it asked for."""

    page: Any
    console: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def draw(self, *names: str) -> None:
        """Bring drawings in 3-D into view and wait until they are there."""
        for name in names:
            root = self.page.locator(f"[data-scene={name}]")
            root.scroll_into_view_if_needed()
            self.page.wait_for_function(
                f"['drawn', 'failed'].includes(document.querySelector('[data-scene={name}]').dataset.state)",
                timeout=60_000,
            )
            assert root.get_attribute("data-state") == "drawn", self.console

    def canvas(self, name: str) -> np.ndarray:
        """The pixels of a drawing, (height, width, 3), when it no longer changes."""
        from matplotlib.image import imread

        root = self.page.locator(f"[data-scene={name}] .scene-canvas")
        before = np.zeros(0)
        for _ in range(20):
            self.page.wait_for_function("() => !document.querySelector('.scene-canvas[aria-busy=true]')")
            self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            now = imread(BytesIO(root.screenshot()))[:, :, :3]
            if before.shape == now.shape and np.array_equal(before, now):
                return now
            before = now
        raise AssertionError("the drawing does not come to rest")


@contextmanager
def opened(playwright: Any, path: Path, *options: str, width: int = 1000, script: bool = True):
    """A page of a file in Chromium, as `Watched`; `playwright`: as `sync_playwright` gives it."""
    browser = playwright.chromium.launch(executable_path=PROGRAM, args=[*QUIET, *(options or SOFTWARE)])
    context = browser.new_context(viewport={"width": width, "height": 900}, java_script_enabled=script)
    watched = Watched(context.new_page())
    watched.page.on("console", lambda m: watched.console.append(f"{m.type}: {m.text}"))
    watched.page.on("pageerror", lambda e: watched.console.append(f"error: {e}"))
    watched.page.on("request", lambda r: watched.requests.append(r.url))
    watched.page.goto(path.as_uri())
    try:
        yield watched
    finally:
        browser.close()


def contrast(one: list[float], other: list[float]) -> float:
    """Contrast of two colours (WCAG 2.1), 1 … 21."""
    lighter, darker = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (lighter + 0.05) / (darker + 0.05)


def _luminance(colour: list[float]) -> float:
    shares = np.asarray(colour) / 255.0
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])
