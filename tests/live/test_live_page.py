"""The live page: who is answered, what is answered, and that it works in a real browser."""

import http.client
import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from browsing import chromium, opened
from sandra.live.guard import LARGEST, TOKEN, Access
from sandra.live.offer import Offer
from sandra.live.serve import listening, serving
from sandra.view.report.frames import FrameLog

ASKED = {"scenario": "merge", "horizon": 3}


class Live:
    """A served page."""

    def __init__(self, access: Access, run: Path) -> None:
        self.access, self.run = access, run

    def ask(
        self, method: str, path: str, body: Any = None, **changes: str | None
    ) -> tuple[int, dict[str, str], Any]:
        """Status, headers, answer. `changes` to the headers that the page would send."""
        own = f"127.0.0.1:{self.access.port}"
        headers: dict[str, str | None] = {"Host": own, TOKEN: self.access.token}
        if method == "POST":
            headers |= {"Origin": f"http://{own}", "Content-Type": "application/json"}
        headers |= {name.replace("_", "-"): value for name, value in changes.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.access.port, timeout=60)
        sent = body if isinstance(body, str | bytes | None) else json.dumps(body)
        known = {name: value for name, value in headers.items() if value is not None}
        connection.request(method, path, sent, known)
        answer = connection.getresponse()
        text = answer.read().decode()
        connection.close()
        found = json.loads(text) if text.startswith("{") else text
        return answer.status, {k.lower(): v for k, v in answer.getheaders()}, found


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    run = tmp_path_factory.mktemp("run")
    with listening(0) as opened_socket:
        access = Access(opened_socket.getsockname()[1])
        server = serving(Offer.of("merge"), access, run)
        thread = threading.Thread(target=server.run, args=([opened_socket],), daemon=True)
        thread.start()
        while not server.started:
            time.sleep(0.01)
        yield Live(access, run)
        server.should_exit = True
        thread.join(10)


def test_it_listens_on_this_machine_alone() -> None:
    with listening(0) as opened_socket:
        assert opened_socket.getsockname()[0] == "127.0.0.1"


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"Host": "evil.example"}, 421),
        ({"Host": "127.0.0.1.evil.example:80"}, 421),
        ({"Host": "127.0.0.1"}, 421),
        ({TOKEN: "wrong"}, 403),
        ({TOKEN: None}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": None}, 403),
        ({"Content_Type": "text/plain"}, 415),
    ],
)
def test_only_its_own_page_is_answered(
    live: Live, changes: dict[str, str | None], status: int
) -> None:
    answered, headers, told = live.ask("POST", "/api/decide", ASKED, **changes)
    assert answered == status
    assert "verdict" not in str(told).lower()
    assert headers["x-frame-options"] == "DENY"


def test_the_page_needs_the_token_and_forbids_what_is_not_its_own(live: Live) -> None:
    assert live.ask("GET", "/")[0] == 403
    assert live.ask("GET", "/?token=wrong")[0] == 403
    status, headers, told = live.ask("GET", f"/?token={live.access.token}")
    assert status == 200
    assert headers["content-security-policy"] == "frame-ancestors 'none'"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert "default-src 'none'" in told
    assert "access-control-allow-origin" not in headers


def test_a_question_is_decided(live: Live) -> None:
    status, _, told = live.ask("POST", "/api/decide", ASKED | {"rules": "R_G1, G(v <= 40)"})
    assert status == 200
    (decision,) = told["decisions"]
    assert len(decision["pairs"]) == 12
    assert all(pair["asked"] for pair in decision["pairs"])
    assert decision["settings"]["rules"] == ["R_G1", "G(v <= 40)"]


def test_a_formula_and_a_limit_change_the_set(live: Live) -> None:
    def areas(**more: Any) -> list[float]:
        told = live.ask("POST", "/api/decide", ASKED | more)[2]
        pairs = told["decisions"][0]["pairs"]
        return list(next(x["areas"] for x in pairs if x["pair"] == "keep,follow-lane"))

    before = areas()
    assert areas(actions={"keep": "G(|a| <= 2)"})[-1] > before[-1]
    # Nothing of the question before is remembered: the formula is the packaged one again.
    assert areas(limits={"a_lat_max": 1.0})[-1] < before[-1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scenario": "/etc/passwd"}, "not offered"),
        ({"scenario": "../merge"}, "not offered"),
        ({"ranker": "openai:gpt-4o"}, "not offered"),
        ({"ranker": "os:system"}, "not offered"),
        ({"horizon": 0}, "horizon"),
        ({"horizon": 10**9}, "horizon"),
        ({"horizon": "3"}, "horizon"),
        ({"rules": "G(v <= "}, "expected"),
        ({"rules": "R_G9"}, "unknown rule"),
        ({"mode": "guess"}, "mode"),
        ({"actions": {"keep": "import os"}}, "keep"),
        ({"actions": {"fly": "true"}}, "no action"),
        ({"limits": {"horizon": 3}}, "cannot be changed"),
        ({"limits": {"a_lon_min": 9.0}}, "a_lon_min"),
        ({"limits": {"max_speed": -1.0}}, "max_speed"),
        ({"api_key": "sk-1"}, "api_key"),
    ],
)
def test_what_cannot_be_used_is_said_in_words(
    live: Live, change: dict[str, Any], words: str
) -> None:
    status, _, told = live.ask("POST", "/api/decide", ASKED | change)
    assert status == 400
    assert words in told["error"]
    assert told.keys() == {"error"}, "no verdict comes with an error"


def test_too_much_or_no_json_is_refused(live: Live) -> None:
    assert live.ask("POST", "/api/decide", b"x" * (LARGEST + 1))[0] == 413
    assert live.ask("POST", "/api/decide", b"{")[0] == 400
    assert live.ask("GET", "/api/decide")[0] == 405
    assert live.ask("GET", "/../pyproject.toml")[0] in (403, 404)


def steps_of_a_drive(count: int) -> list[Any]:
    """Steps as `sandra drive` notes them."""
    from sandra.decider import Decider
    from sandra.simulation.episode import drive
    from sandra.simulation.highway import highway

    found: list[Any] = []
    decider = Decider("rules", horizon=3, emergency_braking=12.0)
    drive(highway(1), 6382, decider, steps=count, on_step=found.append)
    return found


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


def test_a_drive_is_followed_and_a_decision_asked_for_in_the_browser(
    browser: Any, live: Live
) -> None:
    pytest.importorskip("highway_env")
    steps = steps_of_a_drive(3)
    with opened(browser, live.access.address) as seen:
        page = seen.page
        page.wait_for_selector("#following >> text=no decision has been made yet")
        draft = live.run / ".seed-6382.draft"
        draft.mkdir()
        with (draft / "view.jsonl").open("w") as file:
            log = FrameLog(file)
            log.note(steps[0])
            page.wait_for_selector("#following >> text=1 decisions")
            log.note(steps[1])
            page.wait_for_selector("#following >> text=2 decisions")
            file.write('{"decision": {"half')  # a line that is being written
            file.flush()
            page.wait_for_selector("canvas.map")
            assert page.evaluate("sandraPage.page.model.decisions.length") == 2
        assert "decision 2 of 2" in page.inner_text("output[for=time]")

        page.click(".ask-fold > summary")
        page.select_option("#ask-scenario", "merge")
        page.fill("#ask-horizon", "3")
        page.fill("#ask-command", "</script><script>alert(1)</script>")
        page.fill("#ask-rules", "G(v <= ")
        page.click("#live-form button.primary")
        page.wait_for_selector("#live-form [role=alert]:has-text('expected')")
        seen.errors.clear()  # the browser tells of the refused question
        page.fill("#ask-rules", "G(v <= 40)")
        page.click("#live-form button.primary")
        page.wait_for_selector("header >> text=G(v <= 40)")
        assert "alert(1)" in page.inner_text("header")
        assert page.locator("[role=radio]").count() == 12
        seen.check(f"http://127.0.0.1:{live.access.port}/")
