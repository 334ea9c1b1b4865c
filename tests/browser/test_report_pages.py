"""Reports in a real browser: what they show, what they do by key, and what they must never do."""

import statistics
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from browsing import chromium, main_thread, opened, until
from report_scenes import HOSTILE, hostile_document, long_episode, on_the_road
from sandra.reach import Status
from sandra.view.report import decision_document, write

ROWS = "[role=radio]"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pages")
    write(decision_document(on_the_road()), folder / "decision.html")
    write(hostile_document(), folder / "hostile.html")
    write(long_episode(), folder / "long.html")
    return folder


def url(pages: Path, name: str) -> str:
    return (pages / f"{name}.html").as_uri()


def pixels(page: Any) -> str:
    """What the map shows, as text."""
    return str(page.evaluate("document.querySelector('canvas.map').toDataURL()"))


def settled(page: Any) -> None:
    page.evaluate("() => new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")


def test_a_pair_shows_its_set_and_its_cause(browser: Any, pages: Path) -> None:
    decision = on_the_road()
    with opened(browser, url(pages, "decision")) as seen:
        page = seen.page
        assert page.locator(ROWS).count() == 12
        rejected = next(v for v in decision.verdicts if v.status is Status.UNSAFE)
        before = pixels(page)
        page.click(f"{ROWS}[data-pair='{rejected.pair}']")
        settled(page)
        assert pixels(page) != before
        assert rejected.reason is not None
        shown = page.inner_text("#detail").lower()
        assert rejected.reason.lower() in shown
        assert "✗ unsafe" in shown
        assert "g(v ≤ 13.9)" in shown
        assert page.inner_text("pre[aria-label='User text']") == decision.prompt.user
        assert "be quick" in page.inner_text("header")
        seen.check("file://")


def test_the_slider_and_the_keys_move_the_time(browser: Any, pages: Path) -> None:
    with opened(browser, url(pages, "decision")) as seen:
        page = seen.page
        before = pixels(page)
        page.fill("#ahead", "0.6")
        page.evaluate("document.activeElement.blur()")
        settled(page)
        moved = pixels(page)
        assert moved != before
        assert "step 3 of 8" in page.inner_text("output[for=ahead]")
        page.locator("body").press("ArrowRight")
        settled(page)
        assert "step 4 of 8" in page.inner_text("output[for=ahead]")
        page.locator("body").press("Home")
        settled(page)
        assert pixels(page) == before
        page.locator("body").press("Space")
        until(page, "document.getElementById('ahead').value > 0.3")
        assert "Pause" in page.inner_text(".play")
        page.locator("body").press("j")
        page.locator("body").press("?")
        assert page.locator("dialog[open]").count() == 1
        page.click("dialog >> text=Close")
        assert page.locator("dialog[open]").count() == 0
        seen.check("file://")


def test_it_works_by_tab_and_is_named(browser: Any, pages: Path) -> None:
    """Every control can be reached by Tab, shows that it has the focus, and says what it is."""
    with opened(browser, url(pages, "decision")) as seen:
        page = seen.page
        reached = []
        for _ in range(40):
            page.keyboard.press("Tab")
            told = page.evaluate(
                """() => { const e = document.activeElement; const s = getComputedStyle(e);
                return { tag: e.tagName, role: e.getAttribute('role'), outline: s.outlineStyle,
                  name: e.getAttribute('aria-label') || e.labels?.[0]?.textContent
                    || e.textContent }; }"""
            )
            if told["tag"] == "BODY":
                break
            reached.append(told)
        assert all(x["name"].strip() for x in reached), reached
        assert all(x["outline"] != "none" for x in reached), reached
        tags = {x["tag"] for x in reached}
        assert {"A", "BUTTON", "CANVAS", "INPUT", "SELECT", "SUMMARY", "PRE"} <= tags
        assert sum(x["role"] == "radio" for x in reached) == 1, "arrow keys move among the pairs"
        page.locator(f"{ROWS}[tabindex='0']").press("ArrowDown")
        assert page.evaluate("document.activeElement.getAttribute('aria-checked')") == "true"
        unnamed = page.evaluate(
            """() => [...document.querySelectorAll('svg, canvas, img, input, select, button')]
            .filter((e) => !e.closest('[aria-hidden=true]') && !e.getAttribute('aria-hidden'))
            .filter((e) => !(e.getAttribute('aria-label') || e.labels?.length || e.alt
              || e.textContent.trim())).length"""
        )
        assert unnamed == 0
        assert page.evaluate("document.documentElement.lang") == "en"
        levels = page.eval_on_selector_all("h1, h2, h3", "all => all.map((h) => +h.tagName[1])")
        assert levels[0] == 1
        assert all(b - a <= 1 for a, b in pairwise(levels)), levels


def test_nothing_is_cut_off_at_the_side(browser: Any, pages: Path) -> None:
    for name in ("decision", "hostile"):
        with opened(browser, url(pages, name)) as seen:
            for wide in (1300, 900, 360):
                seen.page.set_viewport_size({"width": wide, "height": 800})
                settled(seen.page)
                assert seen.page.evaluate("document.documentElement.scrollWidth") <= wide, name


def test_the_dark_is_dark_and_paper_is_white(browser: Any, pages: Path) -> None:
    ground = "getComputedStyle(document.body).backgroundColor"
    with opened(browser, url(pages, "decision"), color_scheme="dark") as seen:
        page = seen.page
        assert page.evaluate(ground) == "rgb(16, 19, 22)"
        dark = pixels(page)
        page.locator("body").press("t")  # light
        settled(page)
        assert page.evaluate(ground) == "rgb(244, 245, 247)"
        assert pixels(page) != dark
        page.evaluate("dispatchEvent(new Event('beforeprint'))")
        page.emulate_media(media="print")
        assert page.evaluate(ground) == "rgb(255, 255, 255)"
        assert page.locator("details:not([open])").count() == 0
        assert not page.is_visible(".controls")
        page.evaluate("dispatchEvent(new Event('afterprint'))")
        seen.check("file://")


def test_hostile_words_are_words(browser: Any, pages: Path) -> None:
    """Of a model, of a scenario's name, of a command: no dialog, no request, no broken policy."""
    with opened(browser, url(pages, "hostile")) as seen:
        page = seen.page
        page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
        assert HOSTILE[:40] in page.inner_text("h1")
        answer = page.inner_text("pre[aria-label='Answer of the ranker']")
        assert answer.startswith(HOSTILE[:60])
        assert len(answer) <= 200_000
        assert "The first 200000 of 1000" in page.inner_text("#answer")
        assert (
            page.locator("main img, header img, main a[href^=javascript], main script").count() == 0
        )
        assert page.evaluate("document.scripts.length") == 2
        page.wait_for_timeout(100)
        seen.check("file://")


def test_the_policy_stops_what_would_get_in(browser: Any, pages: Path) -> None:
    """If something did get into the page as HTML, it would not run, and nothing could be sent."""
    with opened(browser, url(pages, "decision")) as seen:
        page = seen.page
        page.evaluate(
            """() => { const d = document.createElement('div');
            d.innerHTML = '<img src="https://example.invalid/x" onerror="alert(1)">';
            document.body.append(d);
            const s = document.createElement('script'); s.textContent = 'alert(2)';
            document.body.append(s);
            fetch('https://example.invalid/').catch(() => {}); }"""
        )
        page.wait_for_timeout(200)
        assert seen.dialogs == []
        broken = page.evaluate("window.broken")
        assert {x.split("-")[0] for x in broken} >= {"img", "script", "connect"}


def test_a_long_episode_opens_and_scrubs_quickly(browser: Any, pages: Path) -> None:
    """300 decisions, 40 others: under 10 MB, open within 3 s, pictures for 30 a second.

    CPU time of the page's thread is what counts, as other tests are at work beside this one.
    """
    file = pages / "long.html"
    assert file.stat().st_size < 10e6
    with opened(browser, "about:blank") as seen:
        page = seen.page
        cpu = main_thread(page)
        before = cpu()
        page.goto(file.as_uri())
        until(page, "globalThis.sandraPage && sandraPage.page.stage.times.length > 0")
        to_open = cpu() - before
        assert page.evaluate("document.documentElement.scrollWidth") <= 1300
        assert page.evaluate("sandraPage.page.model.decisions.length") == 300
        # The real slider, one step for each picture: the lists, the charts, the map.
        steps, before = 60, cpu()
        page.evaluate(
            """(steps) => new Promise((done) => {
            const slider = document.getElementById('time');
            let i = 0;
            const next = () => {
              if (i === steps) return done();
              i += 1;
              slider.value = i;
              slider.dispatchEvent(new Event('input'));
              requestAnimationFrame(next);
            };
            next(); })""",
            steps,
        )
        each = (cpu() - before) / steps
        assert page.evaluate("sandraPage.state.index") == 299
        draw = statistics.median(page.evaluate("sandraPage.page.stage.times"))
        print(
            f"{file.stat().st_size / 1e6:.1f} MB, {to_open:.2f} s, {1e3 * each:.1f} ms a picture,"
        )
        print(f"of which the map {draw:.1f} ms on the clock")
        assert to_open < 3.0
        assert each < 1 / 30
        seen.check("file://")
