"""A real browser for tests, and what it must not do: ask the network, run what is not ours."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_BROKEN = """
window.broken = [];
addEventListener("securitypolicyviolation", (e) => window.broken.push(e.violatedDirective));
"""


@contextlib.contextmanager
def chromium() -> Iterator[Any]:
    """SANDRA_CHROMIUM, a Chromium on the PATH, or Playwright's own; the test skips without one."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    given = os.environ.get("SANDRA_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
    with sync_api.sync_playwright() as playwright:
        path = given or playwright.chromium.executable_path
        if not Path(path).exists():
            pytest.skip("no Chromium: install one, or name it with SANDRA_CHROMIUM")
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield browser
        browser.close()


def main_thread(page: Any) -> Callable[[], float]:
    """CPU time of the thread that runs the page [s]; call it before the page is opened."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def spent() -> float:
        told = session.send("Performance.getMetrics")["metrics"]
        return float(next(x["value"] for x in told if x["name"] == "TaskDuration"))

    return spent


def until(page: Any, expression: str, timeout: float = 20.0) -> None:
    """Wait until something holds; Playwright's own way would need eval, which pages forbid."""
    end = time.monotonic() + timeout
    while not page.evaluate(expression):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(20)


@dataclass
class Watched:
    """A page, and all that went wrong on it."""

    page: Any
    errors: list[str] = field(default_factory=list)
    dialogs: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def check(self, origin: str) -> None:
        """Nothing was asked of anybody but `origin`, nothing foreign was run, nothing broke."""
        assert self.errors == []
        assert self.dialogs == []
        assert [url for url in self.requests if not url.startswith((origin, "data:"))] == []
        assert self.page.evaluate("window.broken") == []


@contextlib.contextmanager
def opened(browser: Any, url: str, **options: Any) -> Iterator[Watched]:
    """A page of its own context; `options` as of Playwright's `new_context`."""
    options = {"viewport": {"width": 1300, "height": 900}, **options}
    context = browser.new_context(**options)
    page = context.new_page()
    page.set_default_timeout(20_000)
    page.add_init_script(_BROKEN)
    seen = Watched(page)
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
    page.on("request", lambda request: seen.requests.append(request.url))

    def dismiss(dialog: Any) -> None:
        seen.dialogs.append(dialog.message)
        dialog.dismiss()

    page.on("dialog", dismiss)
    page.goto(url)
    yield seen
    context.close()
