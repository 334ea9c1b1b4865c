"""How long a page of `sandra report` takes to open, and to show another place in time.

    PYTHONPATH=tests python scripts/measure_page.py episode.html

In a headless Chromium without a GPU: CPU time of the page's thread, and time on the clock, for
opening it and for its time slider moved by a decision in each picture.
"""

from __future__ import annotations

import statistics
import sys
from itertools import pairwise
from pathlib import Path

from browsing import chromium, main_thread, opened, until

STEPS = 300
_SCRUB = """(steps) => new Promise((done) => {
  const slider = document.getElementById('time');
  const end = Number(slider.max), times = [];
  const next = (now) => {
    times.push(now);
    if (times.length > steps) return done(times);
    slider.value = (end * times.length) / steps;
    slider.dispatchEvent(new Event('input'));
    requestAnimationFrame(next);
  };
  requestAnimationFrame(next); })"""


def main(file: Path) -> None:
    with chromium() as browser, opened(browser, "about:blank") as seen:
        page = seen.page
        cpu = main_thread(page)
        before = cpu()
        page.goto(file.resolve().as_uri())
        until(page, "globalThis.sandraPage && sandraPage.page.stage.times.length > 0")
        clock = page.evaluate("performance.getEntriesByType('navigation')[0].loadEventEnd")
        print(f"{file.stat().st_size / 1e6:.1f} MB")
        print(f"open: {cpu() - before:.2f} s of CPU time, {clock / 1e3:.2f} s on the clock")
        before = cpu()
        times = page.evaluate(_SCRUB, STEPS)
        each = 1e3 * (cpu() - before) / STEPS
        told = f"scrub: {each:.1f} ms of CPU time a picture; on the clock "
        pauses = sorted(b - a for a, b in pairwise(times))
        most = pauses[int(0.9 * len(pauses))]
        print(f"{told}{statistics.median(pauses):.0f} ms in the median, 90 % within {most:.0f} ms")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
