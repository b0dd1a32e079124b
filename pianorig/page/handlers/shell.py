"""The page itself and its own files; the token is taken here, once."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tornado.web import StaticFileHandler

from pianorig.page.access import Refused
from pianorig.page.handlers.reply import Guarded, Reply, Served
from vision.output.colours import BODY_COLOURS, OTHERS

WEB = Path(__file__).parents[1] / "web"
ON = (
    '<!DOCTYPE html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url=/"><link rel="icon" href="data:,">'
    "<title>bench</title>"
)
"""Sent in answer to a token: the page is then asked for by this page, so that the strict cookie comes with it."""


def drawing_scripts() -> Path:
    """Folder of the JavaScript that comes with Bokeh."""
    found = find_spec("bokeh")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("bokeh", name="bokeh")
    return Path(found.origin).parent / "server" / "static" / "js"


class Shell(Guarded):
    """The page."""

    def get(self) -> None:
        """Send the page, or take a token."""
        token = self.get_query_argument("token", None)
        if token is not None:
            self._take(token)
            return
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish((WEB / "bench.html").read_bytes())

    def _take(self, token: str) -> None:
        access = self.served.access
        try:
            cookie = access.redeem(token)
        except Refused as refused:
            self.refuse(refused.status, str(refused))
            return
        self.set_cookie(access.cookie_name, cookie, httponly=True, samesite="Strict", path="/")
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish(ON)


class OwnFiles(Guarded, StaticFileHandler):
    """Scripts and styles of the page, and of Bokeh."""

    def initialize(self, served: Served, path: str) -> None:  # type: ignore[override]
        """Keep both what the checks need and what the files need."""
        Guarded.initialize(self, served)
        StaticFileHandler.initialize(self, path)

    def set_extra_headers(self, path: str) -> None:
        """Let the browser keep them, but ask whether they are still the same."""
        self.set_header("Cache-Control", "no-cache")


class About(Reply):
    """What the page needs to know about itself."""

    def get(self) -> None:
        """Send it."""
        about: dict[str, Any] = {
            "folder": str(self.served.catalogue.root),
            "may_write": self.may_write,
            "control": self.served.access.control,
            "colours": BODY_COLOURS,
            "other_colours": OTHERS,
        }
        self.send(about)
