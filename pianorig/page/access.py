"""Who may do what: which names the page answers to, which origins may speak to it, who may write.

The page listens on the loopback only. A name other than those of the loopback, or a request that another site's page
began, is refused: both are how a page from the internet would reach a server on this computer (DNS rebinding,
cross-site requests). Writing needs ``--control`` and a request that this page sends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost")
SAFE = ("GET", "HEAD")


class Refused(Exception):
    """A request that the page does not answer: HTTP status and reason in one line."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


@dataclass
class Access:
    """Rules of one page.

    Parameters
    ----------
    port : TCP port it listens on
    control : whether the page may write
    """

    port: int
    control: bool = False

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{LOOPBACK}:{self.port}/"

    def check(self, method: str, path: str, headers: Mapping[str, str]) -> None:
        """Raise `Refused` (HTTP 403) for a request whose Host or Origin is not this page's, or that another site's page
        began; ``headers``: those of the request, by name."""
        hosts = {f"{name}:{self.port}" for name in NAMES}
        host = headers.get("Host", "")
        if host.lower() not in hosts:
            raise Refused(403, f"Host {host[:80]!r}: allowed is {LOOPBACK}:{self.port}; open {self.address}")
        origin = headers.get("Origin")
        if origin is not None and origin.lower() not in {f"http://{name}" for name in hosts}:
            raise Refused(403, f"Origin {origin[:80]!r}: another site may not speak to this page")
        if origin is None and method not in SAFE:
            raise Refused(403, f"{method} without an Origin: only this page may send it")
        # following a link to the page is a navigation and shows it; anything else from elsewhere is not this page's
        shown = path == "/" or path.startswith(("/report/", "/report-of-several/"))
        navigation = headers.get("Sec-Fetch-Mode", "") == "navigate" and method == "GET" and shown
        if headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none") and not navigation:
            raise Refused(403, "the request was begun by another site; open this page by its address")
