"""Who is answered: the loopback's own names, this page's own requests; who may write: the holder of the cookie."""

from __future__ import annotations

import pytest

from pianorig.page.access import Access, Refused

HERE = {"Host": "127.0.0.1:8123"}


@pytest.mark.parametrize(
    ("method", "path", "headers"),
    [
        ("GET", "/api/sessions", {"Host": "127.0.0.1:8123"}),
        ("GET", "/api/sessions", {"Host": "LOCALHOST:8123", "Sec-Fetch-Site": "same-origin"}),
        ("GET", "/", {**HERE, "Sec-Fetch-Site": "none", "Sec-Fetch-Mode": "navigate"}),
        ("GET", "/", {**HERE, "Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate"}),  # a link to the page
        ("POST", "/api/sessions/a/annotations", {**HERE, "Origin": "http://127.0.0.1:8123"}),
    ],
)
def test_the_pages_own_requests_pass(method: str, path: str, headers: dict[str, str]) -> None:
    Access(8123).check(method, path, headers)


@pytest.mark.parametrize(
    ("method", "path", "headers", "words"),
    [
        ("GET", "/", {}, "Host"),
        ("GET", "/", {"Host": "evil.example:8123"}, "Host"),  # DNS rebinding: another name for this address
        ("GET", "/", {"Host": "127.0.0.1"}, "Host"),
        ("GET", "/", {"Host": "127.0.0.1:9999"}, "Host"),
        ("GET", "/", {"Host": "127.0.0.1.evil.example:8123"}, "Host"),
        ("GET", "/api/sessions", {**HERE, "Origin": "http://evil.example"}, "Origin"),
        ("GET", "/api/sessions", {**HERE, "Origin": "null"}, "Origin"),  # a boxed-in report, a file, a data: address
        ("GET", "/api/sessions", {**HERE, "Origin": "http://127.0.0.1:9999"}, "Origin"),
        ("GET", "/api/sessions", {**HERE, "Origin": "https://127.0.0.1:8123"}, "Origin"),
        ("POST", "/api/sessions/a/annotations", HERE, "without an Origin"),
        ("DELETE", "/api/jobs/1", HERE, "without an Origin"),
        ("GET", "/api/sessions", {**HERE, "Sec-Fetch-Site": "cross-site"}, "another site"),
        ("GET", "/api/sessions", {**HERE, "Sec-Fetch-Site": "same-site", "Sec-Fetch-Mode": "navigate"}, "another site"),
    ],
)
def test_other_requests_are_refused(method: str, path: str, headers: dict[str, str], words: str) -> None:
    with pytest.raises(Refused, match=words) as caught:
        Access(8123).check(method, path, headers)
    assert caught.value.status == 403
