"""The page as its reader meets it, in Chromium without a window: in 3-D, on a phone, on paper, by keyboard, with no script."""

import re
import time
from pathlib import Path

import numpy as np
import pytest
from support.browser import BY_THE_LIBRARY, CONTROLS, FOCUSED, NO_3D, PROGRAM, TEXTS, WIDE, contrast, opened
from support.places import DATASETS

import volid
from volid.report.contents.deviation_field import deviation_fields

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="no Chromium on this machine"),
]
PAPER = 595.3, 841.9  # A4 [points of 1/72 inch]
TOOL = (0.0, 0.0, -180.0)


@pytest.fixture(scope="module")
def solution():
    return volid.fit(volid.load_campaign(DATASETS / "five_axis_rtest" / "campaign.toml"))


@pytest.fixture(scope="module")
def report(solution, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    volid.save_report(solution, path, tool=TOOL)
    return path


@pytest.fixture(scope="module")
def playwright():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as found:
        yield found


@pytest.fixture(scope="module")
def shown(playwright, report):
    """The page with everything drawn, and how far the field was drawn when it was opened."""
    with opened(playwright, report) as watched:
        at_first = watched.page.locator("[data-scene=field]").get_attribute("data-state")
        watched.draw("stations", "field")
        yield watched, at_first


@pytest.fixture
def fresh(shown):
    """The page as it was at first, 1000 px wide: what other tests changed is undone."""
    watched, _ = shown
    watched.page.emulate_media(media="screen")
    watched.page.set_viewport_size({"width": 1000, "height": 900})
    watched.page.evaluate("""() => { for (const form of document.forms) {
      form.reset();
      form.querySelector("select").dispatchEvent(new Event("change", { bubbles: true }));
    } }""")
    return watched


def ours(console: list[str]) -> list[str]:
    return [line for line in console if BY_THE_LIBRARY not in line]


def different(one: np.ndarray, other: np.ndarray) -> float:
    """Share of the pixels that differ visibly."""
    return float((np.abs(one - other).max(axis=2) > 0.1).mean())


def until(fresh, name: str, holds, seconds: float = 8.0) -> np.ndarray:
    """The pixels of a drawing as soon as they are as they should be, else as they are at last: drawing takes its time."""
    end = time.monotonic() + seconds
    while True:
        now = fresh.canvas(name)
        if holds(now) or time.monotonic() > end:
            return now


def test_slider_and_switches_move_the_field_and_nothing_is_asked_for(report, shown, fresh):
    assert shown[1] is None  # the first view waits for nothing
    page = fresh.page
    form = page.locator("[data-scene=field] form")
    first = fresh.canvas("field")
    form.locator("input[type=range]").focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    larger = until(fresh, "field", lambda now: different(first, now) > 0.005)
    assert different(first, larger) > 0.005
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    again = until(fresh, "field", lambda now: different(first, now) < 0.001)
    assert different(first, again) < 0.001  # where it was
    before = first
    for what, do in (
        ("arrows", lambda: form.locator("[name=arrows]").uncheck()),
        ("after R-POR", lambda: form.get_by_label("R-POR", exact=True).check()),
        ("own scale", lambda: form.locator("[name=own]").check()),
        ("rotary axes", lambda: form.locator("[name=place]").select_option(index=3)),
        ("rigid motion", lambda: form.locator("[name=rigid]").check()),
        ("view", lambda: form.locator("[data-view=Z]").click()),
        ("distance", lambda: form.locator("[data-zoom='1.25']").click()),
    ):
        do()
        after = until(fresh, "field", lambda now, before=before: different(before, now) > 0.002)
        assert different(before, after) > 0.002, what
        before = after
    plain = fresh.canvas("stations")
    page.locator("[data-scene=stations] select").select_option("size")
    assert different(plain, until(fresh, "stations", lambda now: different(plain, now) > 0.002)) > 0.002
    assert ours(fresh.console) == []
    assert {u for u in fresh.requests if not u.startswith("data:")} == {report.as_uri()}


def test_the_numbers_of_the_field_are_those_of_the_library(fresh, solution):
    found = deviation_fields(solution, TOOL)
    form, line = fresh.page.locator("[data-scene=field] form"), fresh.page.locator(".scene-state")
    for state, place in ((0, 0), (found.states.index(("R-POR",)), 2), (len(found.states) - 1, 5)):
        form.locator("[name=place]").select_option(index=place)
        form.locator("[name=state]").nth(state).check()
        node = found.largest(0, place, state)
        size = 1e3 * np.linalg.norm(found.values[0, place, state, node])
        digits = 1 if size >= 1 else 2 if size >= 0.1 else 3
        fresh.page.wait_for_function(
            "text => document.querySelector('.scene-state').textContent.includes(text)",
            arg=f"largest at a node {size:.{digits}f} µm",
        )
        said = line.text_content().split("largest at a node")[1]
        numbers = [float(n.replace("−", "-")) for n in re.findall(r"−?\d+(?:\.\d+)?", said)]
        assert len(numbers) == 11, said  # size, place, three values with their U, k
        # 65,000 steps and two decimal places [µm]
        np.testing.assert_allclose(numbers[1:4], found.lattice.points[node], atol=0.051)
        np.testing.assert_allclose(
            numbers[4:10:2], 1e3 * found.values[0, place, state, node], atol=0.0051 + size / 65_000
        )
        np.testing.assert_allclose(numbers[5:10:2], 2e3 * found.u[0, place, node], atol=0.0051)


def test_readable_on_a_phone(fresh):
    fresh.page.set_viewport_size({"width": 390, "height": 844})
    fresh.canvas("field")
    assert fresh.page.evaluate("document.documentElement.scrollWidth") <= 390, fresh.page.evaluate(WIDE)
    texts = fresh.page.evaluate(TEXTS)
    assert len(texts) > 100
    small = [t for t in texts if t["size"] < (9.0 if t["drawn"] else 12.0) - 1e-6]
    assert not small, small[:3]


def test_verdict_deviation_and_squareness_are_on_the_first_screen(playwright, rich_solution, tmp_path):
    volid.save_report(rich_solution, tmp_path / "report.html", tool=TOOL)
    with opened(playwright, tmp_path / "report.html") as watched:
        for width, height in ((390, 844), (1280, 800)):
            watched.page.set_viewport_size({"width": width, "height": height})
            for part in (".headline", ".card.first .big", ".card.second tbody tr:nth-child(3)"):
                box = watched.page.locator(part).bounding_box()
                assert box["y"] + box["height"] <= height, (part, width)


def test_contrast_is_enough_everywhere(fresh):
    """WCAG 2.1 AA: 4.5 : 1, large texts 3 : 1."""
    texts = fresh.page.evaluate(TEXTS)
    large = [t["size"] >= 24.0 or (t["bold"] and t["size"] >= 18.66) for t in texts]
    limits = [3.0 if big else 4.5 for big in large]
    assert [t for t, limit in zip(texts, limits, strict=True) if contrast(t["colour"], t["ground"]) < limit] == []


def test_every_control_is_reached_by_tab_and_shows_it(fresh):
    page = fresh.page
    page.evaluate("() => { document.activeElement.blur(); window.scrollTo(0, 0); }")
    page.mouse.click(3, 3)
    controls = page.evaluate(CONTROLS)
    assert len(controls) > 20
    reached: dict[int, bool] = {}
    for _ in range(2 * len(controls) + 10):
        page.keyboard.press("Tab")
        focus = page.evaluate(FOCUSED)
        if focus["number"] is not None:
            reached.setdefault(int(focus["number"]), focus["outline"])
        if len(reached) == len(controls):
            break
    assert [c for i, c in enumerate(controls) if i not in reached] == []
    assert [controls[i] for i, outline in reached.items() if not outline] == []


def test_prints_on_a4_with_page_numbers_and_the_drawn_field(fresh, tmp_path):
    pypdf = pytest.importorskip("pypdf")
    fresh.page.pdf(path=tmp_path / "report.pdf", prefer_css_page_size=True)
    fresh.page.emulate_media(media="print")
    visible = "l => l.map((e) => e.checkVisibility())"
    assert not any(fresh.page.locator(".scene-canvas").evaluate_all(visible))
    assert all(fresh.page.locator(".scene-drawn svg").evaluate_all(visible))
    pages = pypdf.PdfReader(tmp_path / "report.pdf").pages
    assert len(pages) > 1
    for number, page in enumerate(pages, start=1):
        assert (float(page.mediabox.width), float(page.mediabox.height)) == pytest.approx(PAPER, abs=1.5)
        text = page.extract_text()
        assert f"{number} / {len(pages)}" in text
        drawn = len(page.get_contents().get_data())  # bytes
        assert len(text.split()) > 25 or drawn > 20_000, f"page {number} is blank"


@pytest.mark.parametrize(("options", "script", "words"), [(NO_3D, True, "WebGL"), ((), False, "JavaScript")])
def test_without_3d_or_script_there_is_a_sentence_and_the_drawing(playwright, report, options, script, words):
    with opened(playwright, report, *options, script=script) as watched:
        root = watched.page.locator("[data-scene=field]")
        root.scroll_into_view_if_needed()
        said = root.locator(".scene-none" if script else "noscript p")
        assert said.is_visible()
        assert words in said.text_content()
        assert root.locator(".scene-drawn svg").first.is_visible()
        assert not root.locator("form").is_visible()
        assert not root.locator(".scene-start").is_visible()
        assert ours(watched.console) == []
