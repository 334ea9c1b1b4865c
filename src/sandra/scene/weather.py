"""The weather at a place, from OpenWeatherMap (https://openweathermap.org/current).

Only the number of the answer's condition is used, and said in words of ours, so that no text of
the server gets into a prompt. Whatever goes wrong is "unknown" weather with a named problem.
"""

from __future__ import annotations

import json
import math
import os
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sandra.errors import SettingsError

if TYPE_CHECKING:
    import httpx2

ADDRESS = "https://api.openweathermap.org"
KEY = "OPENWEATHERMAP_API_KEY"
"""Environment variable that holds the key. No command takes it: command lines are recorded."""
URL = "OPENWEATHERMAP_BASE_URL"
TIMEOUT = 3.0
"""For one answer, connecting included [s]."""
KEPT = 600.0
"""An answer is good for so long [s]; the server's data change every ten minutes."""
KEPT_PROBLEM = 60.0
"""After a problem the server is left alone for so long [s]."""
UNKNOWN = "unknown"

_MOST_BYTES = 100_000
_CONDITIONS = {800: "clear", 801: "clear", 802: "cloudy", 803: "cloudy", 804: "cloudy"}
_CONDITIONS |= {500: "light rain", 520: "light rain", 701: "mist", 741: "fog", 781: "a tornado"}
_CONDITIONS |= {502: "heavy rain", 503: "heavy rain", 504: "heavy rain", 522: "heavy rain"}
_CONDITIONS |= {511: "freezing rain", 611: "sleet", 612: "sleet", 613: "sleet", 602: "heavy snow"}
_CONDITIONS |= {622: "heavy snow", 771: "squalls"}
_GROUPS = {2: "a thunderstorm", 3: "drizzle", 5: "rain", 6: "snow", 7: "haze"}


@dataclass(frozen=True, slots=True)
class Weather:
    """`words` to be told, "unknown" if there is a `problem` (one line)."""

    words: str = UNKNOWN
    problem: str | None = None


class OpenWeatherMap:
    """Current weather by coordinates. Answers are kept in the process. Usable from threads.

    Args:
        key: default: the environment variable OPENWEATHERMAP_API_KEY.
        base_url: of the server; default: OPENWEATHERMAP_BASE_URL, else OpenWeatherMap's.
        timeout: for one answer [s].

    Raises:
        SettingsError: no key.
    """

    def __init__(
        self, key: str | None = None, *, base_url: str | None = None, timeout: float = TIMEOUT
    ) -> None:
        self._key = (key or os.environ.get(KEY) or "").strip()
        if not self._key:
            raise SettingsError(f"weather: no key; set {KEY}, or name the weather yourself")
        self._base_url = (base_url or os.environ.get(URL) or ADDRESS).rstrip("/")
        self._timeout = timeout
        self._kept: dict[tuple[float, float], tuple[float, Weather]] = {}

    def __repr__(self) -> str:
        return f"OpenWeatherMap({self._base_url})"

    def at(self, location: tuple[float, float] | None) -> Weather:
        """The weather at a latitude and longitude [degrees], within the time-out. Never raises."""
        if location is None:
            return Weather(problem="the scenario gives no coordinates")
        latitude, longitude = location
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            return Weather(problem=f"{latitude}, {longitude} is no place on earth")
        place = round(latitude, 2), round(longitude, 2)
        until, weather = self._kept.get(place, (-math.inf, Weather()))
        if time.monotonic() >= until:
            weather = self._asked(place)
            lasts = KEPT if weather.problem is None else KEPT_PROBLEM
            self._kept[place] = time.monotonic() + lasts, weather
        return weather

    def _asked(self, place: tuple[float, float]) -> Weather:
        # In a thread of its own: the library bounds each read, but not all of them together.
        found: list[Weather] = []
        thread = threading.Thread(
            target=lambda: found.append(self._answer(place)), name="weather", daemon=True
        )
        thread.start()
        thread.join(self._timeout)
        if found:
            return found[0]
        return Weather(problem=f"no answer from {self._base_url} within {self._timeout:g} s")

    def _answer(self, place: tuple[float, float]) -> Weather:
        import httpx2

        address = f"{self._base_url}/data/2.5/weather"
        where = {"lat": place[0], "lon": place[1]}
        try:
            with (
                httpx2.Client(transport=_keyed(self._key), timeout=self._timeout) as client,
                client.stream("GET", address, params=where) as response,
            ):
                if response.status_code != 200:
                    return Weather(problem=_refused(response.status_code))
                body = b""
                for piece in response.iter_bytes():
                    body += piece
                    if len(body) > _MOST_BYTES:
                        return Weather(problem="the answer is too long")
        except (httpx2.HTTPError, httpx2.InvalidURL) as error:
            kind = type(error).__name__
            return Weather(problem=f"{self._base_url} cannot be reached ({kind})")
        return _read(body)


def _keyed(key: str) -> httpx2.BaseTransport:
    """A transport that adds the key to each address on its way out.

    The client, whose logs and errors quote addresses, never sees it.
    """
    import httpx2

    class Keyed(httpx2.HTTPTransport):
        def handle_request(self, request: httpx2.Request) -> httpx2.Response:
            url = request.url.copy_merge_params({"appid": key})
            inner = httpx2.Request(
                request.method, url, headers=request.headers, extensions=request.extensions
            )
            return super().handle_request(inner)

    return Keyed()


def _refused(status: int) -> str:
    hint = "; check the key" if status == 401 else "; too many requests" if status == 429 else ""
    return f"the server answered HTTP {status}{hint}"


def _read(body: bytes) -> Weather:
    try:
        answer: Any = json.loads(body)
        number = answer["weather"][0]["id"]
    except (ValueError, LookupError, TypeError, RecursionError):
        return Weather(problem="the answer is none of OpenWeatherMap's")
    if not isinstance(number, int) or number // 100 not in (*_GROUPS, 8):
        return Weather(problem="the answer names no known condition")
    words = _CONDITIONS.get(number) or _GROUPS.get(number // 100)
    return Weather(words) if words else Weather(problem="the answer names no known condition")
