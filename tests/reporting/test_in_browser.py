"""Pages in a real browser: what is clicked, dragged and slid changes the picture, and no more."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.slow

NAMES = ("chromium", "chromium-browser", "google-chrome")
SOFTWARE = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
NO_WEBGL = ["--disable-3d-apis"]


def launched(playwright: Any, options: list[str]) -> Any:
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("Chromium is not installed")
    # In containers there is none, and pages are our own.
    args = ["--no-sandbox", *options]
    return playwright.chromium.launch(executable_path=program, args=args)


@pytest.fixture(scope="module")
def playwright() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        yield playwright


@pytest.fixture(scope="module")
def browser(playwright) -> Iterator[Any]:
    browser = launched(playwright, SOFTWARE)
    yield browser
    browser.close()


@pytest.fixture
def opened(browser) -> Iterator[Any]:
    """Open a page, and fail in the end if it asked for anything, or complained."""
    asked: list[str] = []
    said: list[str] = []
    context = browser.new_context(viewport={"width": 1000, "height": 800}, offline=True)

    def call(path: Path) -> Any:
        page = context.new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto(path.as_uri())
        page.wait_for_function("document.getElementById('view').dataset.drawn > 0")
        return page

    yield call
    context.close()
    assert [url for url in asked if not url.startswith(("data:", "file:"))] == []
    assert len([url for url in asked if url.startswith("file:")]) == 1
    assert said == []


def picture(page: Any) -> bytes:
    return page.locator(".stage").screenshot(animations="disabled")


def test_something_is_drawn(opened, made) -> None:
    page = opened(made.copy)
    drawn = picture(page)
    page.evaluate("document.querySelector('canvas').style.visibility = 'hidden'")
    assert picture(page) != drawn


def test_buttons_choose_colours_and_show_their_key(opened, made) -> None:
    page = opened(made.copy)
    seen = {picture(page)}
    for name, key in (("Surface", None), ("Parts", ".legend"), ("Distance", ".bar")):
        button = page.get_by_role("button", name=name)
        button.click()
        assert button.get_attribute("aria-pressed") == "true"
        assert page.locator("[aria-pressed=true]").count() == 1
        for each in (".legend", ".bar"):
            assert page.locator(each).is_visible() == (each == key)
        seen.add(picture(page))
    # The last button was pressed at first, too.
    assert len(seen) == 3


def test_the_slider_shows_frames_and_tells_which(opened, made) -> None:
    page = opened(made.copy)
    first = picture(page)
    slider = page.get_by_label("Frame", exact=True)
    slider.focus()
    page.keyboard.press("ArrowRight")
    assert page.locator("output[for=frame]").inner_text() == "2 of 3, time code 2"
    assert slider.get_attribute("aria-valuetext") == "2 of 3, time code 2"
    assert page.locator("#view").get_attribute("data-frame") == "1"
    assert picture(page) != first


def test_dragging_and_arrow_keys_turn_the_mesh(opened, made) -> None:
    page = opened(made.copy)
    canvas = page.locator("canvas")
    seen = [picture(page)]
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 330, box["y"] + 230, steps=4)
    page.mouse.up()
    seen.append(picture(page))
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    seen.append(picture(page))
    page.keyboard.press("ArrowUp")
    seen.append(picture(page))
    assert len(set(seen)) == 4


def test_the_wheel_scrolls_the_page_until_the_view_is_chosen(opened, made) -> None:
    page = opened(made.copy)
    page.locator("canvas").hover()
    page.mouse.wheel(0, 120)
    page.wait_for_function("window.scrollY > 0")


def test_before_and_after_are_wiped_and_displacements_magnified(opened, made) -> None:
    page = opened(made.mark)
    seen = [picture(page)]
    for name, value in (("wipe", "20"), ("magnify", page.locator("#magnify").get_attribute("max"))):
        page.locator(f"#{name}").fill(value)
        seen.append(picture(page))
    assert len(set(seen)) == 3
    assert page.locator("output[for=wipe]").inner_text() == "20 %"
    # Both sides are drawn.
    both = int(page.locator("#view").get_attribute("data-drawn"))
    page.locator("#wipe").fill("0")
    assert int(page.locator("#view").get_attribute("data-drawn")) * 2 == both


def test_a_screen_reader_hears_the_verdict_first(opened, made) -> None:
    page = opened(made.copy)
    heard = page.locator("body").aria_snapshot()
    lines = [line.strip() for line in heard.splitlines()]
    headings = [line for line in lines if "heading " in line]
    assert "Marked: this is the copy made for ACME" in headings[0]
    assert "[level=1]" in headings[0]
    assert lines.index(headings[0]) < next(i for i, line in enumerate(lines) if "img " in line)
    assert '- slider "Frame"' in heard
    assert 'button "Surface"' in heard
    assert "log10 p of 3 frames" in heard


def test_nothing_is_wider_than_a_phone(opened, made) -> None:
    page = opened(made.copy)
    page.set_viewport_size({"width": 360, "height": 700})
    assert page.evaluate("document.documentElement.scrollWidth") == 360
    page.wait_for_function("document.querySelector('canvas').clientWidth < 360")


def test_on_paper_there_is_a_picture_and_all_is_unfolded(opened, made) -> None:
    page = opened(made.copy)
    assert page.pdf(format="A4").startswith(b"%PDF")
    assert page.locator("details:not([open])").count() == 0
    page.emulate_media(media="print")
    assert page.locator(".stage img").is_visible()
    assert not page.locator("canvas").is_visible()
    assert not page.get_by_role("button", name="Surface").is_visible()


@pytest.mark.parametrize("kind", ["copy", "mark"])
def test_without_webgl_the_still_is_shown_and_the_page_says_so(playwright, made, kind) -> None:
    browser = launched(playwright, NO_WEBGL)
    page = browser.new_page()
    page.goto(getattr(made, kind).as_uri())
    page.wait_for_selector("#view.still-only")
    assert page.locator(".stage img").is_visible()
    assert page.locator(".stage img").evaluate("image => image.naturalWidth") > 0
    assert page.get_by_text("shows no 3D view").is_visible()
    assert not page.locator("canvas").is_visible()
    assert not page.locator("#frame").is_visible()
    assert page.get_by_role("heading", level=1).is_visible()
    browser.close()
