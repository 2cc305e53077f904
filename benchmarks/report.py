"""The report of a five-axis solution with 10,000 samples: how large, how long to write, how soon seen, how quick to the hand.

    python -m benchmarks.report [SOLUTION.h5 …]

Without files: the bundled R-test campaign, and an R-test with 3,000 tracker distances of the same machine's linear axes (the
mixed case of the timings), each fitted and refitted 10,000 times. "Written" is from the solution to the file, "processor" the
processor time of that, "command" the whole of `volid report` in a process of its own. The page is then opened by Chromium with
software rendering: "first view" is its first paint, "drawn" how long each drawing in 3-D takes from coming into view, the library
unpacked by the first one; a step of the slider and a change of the compensation are medians until the picture stands.
"""

from __future__ import annotations

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

import volid

TRIALS = 10_000
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
FIRST = """() => {
  const paint = performance.getEntriesByType("paint").find((e) => e.name === "first-contentful-paint");
  return paint ? paint.startTime : performance.getEntriesByType("navigation")[0].domInteractive;
}"""
STEPS = """async (what) => {
  const root = document.querySelector("[data-scene=field]");
  const form = root.querySelector("form"), canvas = root.querySelector(".scene-canvas");
  const frame = () => new Promise(requestAnimationFrame);
  const rest = async () => {
    while (canvas.getAttribute("aria-busy") === "true") await frame();
    await frame();
    await frame();
  };
  const times = [];
  for (let i = 0; i < 10; i++) {
    const start = performance.now();
    if (what === "slider") {
      form.elements.magnification.value = Number(form.elements.magnification.value) + (i % 2 ? 1 : -1);
      form.elements.magnification.dispatchEvent(new Event("input", { bubbles: true }));
    } else {
      const states = [...form.elements.state];
      states[i % states.length].checked = true;
      states[i % states.length].dispatchEvent(new Event("change", { bubbles: true }));
    }
    await rest();
    times.push(performance.now() - start);
  }
  return times;
}"""


def solutions(folder: Path) -> list[Path]:
    """The two solutions with samples, as files."""
    from benchmarks.cases import mixed

    campaigns = {"R-test": volid.load_campaign("datasets/five_axis_rtest/campaign.toml"), "mixed": mixed().campaign}
    paths = []
    for name, campaign in campaigns.items():
        paths.append(folder / f"{name}.h5")
        volid.fit(campaign).monte_carlo(TRIALS).save(paths[-1])
    return paths


def written(path: Path, page: Path) -> dict[str, float]:
    """Seconds to write the page of a solution, by itself and by the whole command, and its size [MB]."""
    solution = volid.load_solution(path)
    start, processor = time.perf_counter(), time.process_time()
    volid.save_report(solution, page, overwrite=True)
    seconds, processor = time.perf_counter() - start, time.process_time() - processor
    start = time.perf_counter()
    command = [sys.executable, "-m", "volid", "report", str(path), "-o", str(page), "--force"]
    subprocess.run(command, check=False, capture_output=True)
    whole = time.perf_counter() - start
    return {"written/s": seconds, "processor/s": processor, "command/s": whole, "size/MB": page.stat().st_size / 1e6}


def opened(page: Path) -> dict[str, float]:
    """Seconds until the page is seen and drawn, and seconds of a step."""
    program = next(p for p in map(shutil.which, CHROMIUM) if p)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=OPTIONS)
        shown = browser.new_page(viewport={"width": 1280, "height": 900})
        shown.goto(page.as_uri())
        found = {"first view/s": shown.evaluate(FIRST) / 1e3}
        for name in ("stations", "field"):
            start = time.perf_counter()
            shown.evaluate(f"document.querySelector('[data-scene={name}]').scrollIntoView()")
            shown.wait_for_function(
                f"document.querySelector('[data-scene={name}]').dataset.state === 'drawn'", timeout=60_000
            )
            found[f"{name} drawn/s"] = time.perf_counter() - start
        for what in ("slider", "compensation"):
            found[f"{what}/s"] = statistics.median(shown.evaluate(STEPS, what)) / 1e3
        browser.close()
    return found


def main() -> None:
    """Measure and print one row a solution."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [Path(p) for p in sys.argv[1:]] or solutions(folder)
        for path in paths:
            row = written(path, folder / "report.html") | opened(folder / "report.html")
            print(path.stem, *(f"{key} {value:.2f}" for key, value in row.items()), sep="; ", flush=True)


if __name__ == "__main__":
    main()
