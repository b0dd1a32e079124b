"""What answers at each address of the page: a function of what was asked for, of the catalogue, jobs and films."""

from __future__ import annotations

import asyncio
import math
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast, get_args

from tornado.ioloop import IOLoop
from tornado.web import StaticFileHandler

import rig
import vision
from pianorig.console.output import json_text
from pianorig.errors import CommandInputError
from pianorig.page.action import (
    BLOWS,
    action_facts,
    blow_curves,
    built_in_actions,
    changed_action,
    live_blow,
    measure_touch,
    scenes,
    technician_step,
    toml_of,
)
from pianorig.page.catalogue import (
    COMPARISONS,
    UnknownName,
    open_session,
    read_row,
    readable_trial,
    refuse_odd_files,
    session_detail,
)
from pianorig.page.live import LiveStream
from pianorig.page.outlines import FilmSubject, outlines_of, save_outlines, subject_of, track_again
from pianorig.page.reply import Asked, Guarded, Reply, Sent, Served, Stream
from pianorig.page.review import MOST_MODELS, film_view, trial_view
from pianorig.player.animation import WEB as PLAYER
from pianorig.player.animation import animation_html, blow_animation, trial_animation
from rig.errors import RigError
from rig.session import Session, Trial
from rig.session.annotation_file import Kind
from vision.output.colours import BODY_COLOURS, OTHERS

WEB = Path(__file__).with_name("web")
LONGEST_TEXT = 2000  # letters of a reason or a remark
MOST_COMPARED = 8  # sessions in one table: as many as fit its width
MOST_FRAMES = 16  # in one answer: 20 MB of a film of 1.3 megapixels
REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads allow-popups; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'"
)
"""A report is a file of the session, and a session may come from anybody: its scripts run in an origin of their own,
which may neither read this page nor ask it or the network for anything."""
LOOKS_HZ = 30.0  # at a recording: as often as the page is drawn
GONE = 4404  # code of our own for a session that is not there, or no more


def drawing_scripts() -> Path:
    """Folder of the JavaScript that comes with Bokeh."""
    found = find_spec("bokeh")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("bokeh", name="bokeh")
    return Path(found.origin).parent / "server" / "static" / "js"


class Shell(Reply):
    async def get(self, *names: str) -> None:
        """Send the page."""
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.finish((WEB / "bench.html").read_bytes())


class About(Reply):
    """What the page needs to know about itself."""

    async def get(self, *names: str) -> None:
        served = self.served
        about = {"folder": str(served.catalogue.root.resolve()), "may_write": served.access.control}
        self.send({**about, "colours": BODY_COLOURS, "other_colours": OTHERS})


class OwnFiles(Guarded, StaticFileHandler):
    """Scripts and styles of the page, and of Bokeh."""

    def initialize(self, served: Served, path: str) -> None:  # type: ignore[override]
        """Keep both what the checks need and what the files need."""
        Guarded.initialize(self, served)
        StaticFileHandler.initialize(self, path)

    def set_extra_headers(self, path: str) -> None:
        """Let the browser keep them, but ask whether they are still the same."""
        self.set_header("Cache-Control", "no-cache")


def _job(served: Served, number: str, asked: Asked) -> dict[str, Any]:
    found = served.jobs.state(int(number))
    if found is None:
        raise UnknownName(f"no job {number}")
    return found


def _stop(served: Served, number: str, asked: Asked) -> dict[str, Any]:
    served.jobs.stop(int(number))
    return _job(served, number, asked)


# sessions, their annotations and reports


def _one_session(served: Served, name: str, asked: Asked) -> dict[str, Any]:
    folder = served.catalogue.folder(name)
    row = read_row(folder)
    detail = {"trials": [], "annotations": []} if row.status == "unreadable" else session_detail(folder)
    return {**asdict(row), **detail}


def _annotate(served: Served, name: str, asked: Asked) -> dict[str, Any]:
    annotate(served.catalogue.folder(name), asked.content)
    return {"annotated": True}


def annotate(folder: Path, content: dict[str, Any]) -> None:
    """Append an annotation to the session in ``folder``; ``content`` as the page sent it: trial (0: the session), kind,
    reason, author; CommandInputError where one of them is not allowed."""
    trial, kind, reason, author = (content.get(key) for key in ("trial", "kind", "reason", "author"))
    if type(trial) is not int or trial < 0:
        raise CommandInputError(f"trial {trial!r}: allowed 0 for the session, or the number of a trial")
    if kind not in get_args(Kind):
        raise CommandInputError(f"kind {kind!r}: allowed {', '.join(get_args(Kind))}")
    for label, text in (("reason", reason), ("author", author)):
        if not isinstance(text, str) or len(text) > LONGEST_TEXT:
            raise CommandInputError(f"{label}: allowed is text of at most {LONGEST_TEXT} characters")
    session = open_session(folder)
    if trial and kind == "accept" and session.trial(trial).rejected is None:
        raise CommandInputError(f"trial {trial} is not rejected; nothing to accept")
    session.annotate(trial, cast(Kind, kind), str(reason), author=str(author))


def _report(served: Served, name: str, path: str, asked: Asked) -> Sent:
    return _boxed_in(*served.catalogue.report_file(name, path or "report.html"))


def _comparison_report(served: Served, name: str, path: str, asked: Asked) -> Sent:
    return _boxed_in(*served.catalogue.comparison_file(name, path or "report.html"))


def _boxed_in(file: Path, kind: str) -> Sent:
    headers = {"Content-Security-Policy": REPORT_POLICY, "X-Frame-Options": "SAMEORIGIN", "Content-Type": kind}
    return Sent(file.read_bytes(), headers)


def _compare(served: Served, asked: Asked) -> dict[str, Any]:
    """Start the job ``validate`` of the sessions that the request names, into a new folder of comparisons; return the
    job's state. CommandInputError for another number of names than allowed."""
    names: Any = asked.content.get("sessions")
    several = isinstance(names, list) and all(isinstance(name, str) for name in names)
    if not several or not 2 <= len(set(names)) <= MOST_COMPARED:
        raise CommandInputError(f"sessions to compare: allowed 2 to {MOST_COMPARED} names")
    folders = [served.catalogue.folder(name) for name in dict.fromkeys(names)]
    for folder in folders:
        rig.Session.open(folder)
    out = served.catalogue.root / COMPARISONS / f"{datetime.now(UTC):%Y-%m-%dT%H%M%SZ}"
    return served.jobs.begin(out.name, ["validate", *map(str, folders), "--out", str(out)])


def _validate(served: Served, name: str, asked: Asked) -> dict[str, Any]:
    folder = served.catalogue.folder(name)
    rig.Session.open(folder)  # what cannot be compared is refused before a process is started
    return served.jobs.begin(name, ["validate", str(folder)])


# the action as it is set: ``scene=`` and ``set=path=value`` in the address


def _blow(name: str, asked: Asked) -> tuple[str, list[str], str, str]:
    return name, asked.query.get("set", []), asked.one("blow") or BLOWS[0], asked.one("scene", "whole")


def _set_action(name: str, asked: Asked) -> Any:
    return changed_action(name, asked.query.get("set", []), asked.one("scene", "whole"))


def _turn_screw(served: Served, name: str, asked: Asked) -> dict[str, Any]:
    """Answer of `technician_step` for the action ``name`` as the request sets it, with its ``target`` and ``turn_m``
    (m): lengths before and after. Nothing is stored."""
    turned = asked.one("turn_m")
    try:
        turn_m = float(turned)
    except ValueError:
        turn_m = math.nan
    if not math.isfinite(turn_m):
        raise CommandInputError(f"turn_m {turned[:40]!r}: allowed a number of metres")
    return technician_step(_set_action(name, asked), asked.one("target"), turn_m)


def _blow_animation(served: Served, name: str, asked: Asked) -> dict[str, str]:
    blow = _blow(name, asked)
    in_scene = [] if blow[3] == "whole" else [f"scene {' '.join(blow[3].split())}"]
    return {"text": animation_html(blow_animation(name, [*in_scene, *blow[1]], live_blow(*blow)))}


# one trial, its film, frames of it


def _review(served: Served, name: str, number: str, asked: Asked) -> dict[str, Any]:
    known, models = built_in_actions(), asked.query.get("model", [])
    wrong = next((one for one in models if one not in known), None)
    if wrong is not None or len(models) > MOST_MODELS:
        raise CommandInputError(f"model {wrong!r}: allowed at most {MOST_MODELS} of {', '.join(known)}")
    return trial_view(_trial(served, name, number)[0], int(number), models or known[:1])


def _trial_animation(served: Served, name: str, number: str, asked: Asked) -> dict[str, str]:
    animation = trial_animation(_review(served, name, number, asked))
    if animation is None:
        raise CommandInputError(f"{name}, trial {number}: no model moves it, so there is nothing to draw")
    return {"text": animation_html(animation)}


def _trial(served: Served, name: str, number: str) -> tuple[Session, Trial]:
    session = open_session(served.catalogue.folder(name))
    return session, readable_trial(session, int(number))


def _film(served: Served, name: str, number: str, asked: Asked) -> dict[str, Any]:
    """A film that cannot be read is an ``error`` beside what can be shown."""
    session, trial = _trial(served, name, number)
    try:
        return {"film": film_view(session, trial), "error": None}
    except (vision.VisionError, RigError, OSError) as error:
        return {"film": None, "error": f"film: {error}"}


def _frames(served: Served, name: str, number: str, first: str, count: str, asked: Asked) -> Sent:
    """Grey values, a byte a pixel, of ``count`` frames from ``first`` on of the film of trial ``number`` of the session
    ``name``, or, for number 0, of the film ``name``; UnknownName where there is none."""
    if not 1 <= int(count) <= MOST_FRAMES:
        raise CommandInputError(f"{count} frames: allowed 1 to {MOST_FRAMES}")
    try:
        if number == "0":
            film: Path | None = served.catalogue.film(name)
        else:
            folder = served.catalogue.folder(name)
            refuse_odd_files(folder)
            film = Trial(folder / f"trial_{int(number):04d}.h5", int(number), None).film
        if film is None:
            raise UnknownName(f"{name}: trial {number} has no film")
        grey = served.films.frames(film, int(first), int(count))
    except (vision.VisionError, RigError, OSError, ValueError) as error:
        raise UnknownName(" ".join(str(error).split())) from error
    return Sent(grey, {"Content-Type": "application/octet-stream", "Cache-Control": "private, max-age=3600"})


# outlines of a film; tracking it


def _film_subject(served: Served, owner: str, number: str) -> FilmSubject:
    return subject_of(served.catalogue, owner, int(number))


def _track(served: Served, owner: str, number: str, asked: Asked) -> dict[str, Any]:
    """Start the job ``track`` for the film of trial ``number`` of the session ``owner`` with its saved outlines, at the
    frame rate that the request may state; return the job's state."""
    subject = _film_subject(served, owner, number)
    if not subject.bodies.is_file():
        raise CommandInputError(f"{subject.bodies.name}: no outlines yet; save them first")
    words = ["--allow-truncated", "--bodies", str(subject.bodies)]
    rate_hz = asked.content.get("frame_rate_hz")
    if rate_hz is not None:
        if type(rate_hz) not in (int, float) or not 0.0 < rate_hz < 1e9:
            raise CommandInputError(f"frame rate {str(rate_hz)[:40]}: allowed a positive number of frames/s")
        words += ["--frame-rate", repr(rate_hz)]
    return served.jobs.begin(owner, ["track", str(subject.path), *words])


# the recording that is made


class Live(Stream):
    """The scope: what a recording adds, sent as it comes; text for the state and bytes for samples.

    A page that is slow or stands still is not sent more than it takes: the next look waits until the last was sent.
    The recording knows nothing of it.
    """

    async def tell(self, *arguments: str) -> None:
        """Send the session named by ``arguments[0]`` to the page as it is recorded, state as JSON text where it
        changed, new samples as bytes, until the page is gone; the socket is closed where it cannot be read."""
        work, workers = IOLoop.current().run_in_executor, self.served.workers
        try:
            stream = await work(workers, lambda: LiveStream(self.served.catalogue.folder(arguments[0])))
            while True:
                state, samples = await work(workers, stream.poll)
                if state is not None:
                    await self.write_message(json_text(state))
                if samples:
                    await self.write_message(samples, binary=True)
                await asyncio.sleep(1.0 / LOOKS_HZ)
        except (RigError, UnknownName, ValueError, OSError) as error:
            self.close(GONE, " ".join(str(error).split()).encode()[:120].decode(errors="ignore"))


NAME, NUMBER = r"([^/]+)", r"(\d{1,9})"
ACTION, TRIAL = f"/api/action/{NAME}", f"/api/review/{NAME}/{NUMBER}"
OUTLINES = f"/api/outlines/{NAME}/{NUMBER}"
ADDRESSES: dict[str, dict[str, Any]] = {
    "/api/sessions": {"get": lambda it, asked: {"sessions": [asdict(row) for row in it.catalogue.rows()]}},
    f"/api/sessions/{NAME}": {"get": _one_session},
    f"/api/sessions/{NAME}/annotations": {"post": _annotate},
    f"/api/sessions/{NAME}/validate": {"post": _validate},
    f"/api/jobs/{NUMBER}": {"get": _job, "delete": _stop},
    f"/report/{NAME}/(.*)": {"get": _report},
    "/api/comparisons": {"get": lambda it, asked: {"comparisons": it.catalogue.comparisons()}, "post": _compare},
    f"/report-of-several/{NAME}/(.*)": {"get": _comparison_report},
    "/api/actions": {
        "get": lambda it, asked: {"actions": built_in_actions(), "blows": list(BLOWS), "scenes": scenes()}
    },
    ACTION: {"get": lambda it, name, asked: action_facts(name, asked.one("scene", "whole"))},
    f"{ACTION}/blow": {"get": lambda it, name, asked: live_blow(*_blow(name, asked))},
    f"{ACTION}/curves": {"get": lambda it, name, asked: blow_curves(*_blow(name, asked))},
    f"{ACTION}/animation": {"get": _blow_animation},
    f"{ACTION}/touch": {"get": lambda it, name, asked: measure_touch(_set_action(name, asked))},
    f"{ACTION}/step": {"get": _turn_screw},
    f"{ACTION}/file": {"get": lambda it, name, asked: {"text": toml_of(_set_action(name, asked))}},
    TRIAL: {"get": _review},
    f"{TRIAL}/animation": {"get": _trial_animation},
    f"/api/film/{NAME}/{NUMBER}": {"get": _film},
    "/api/films": {"get": lambda it, asked: {"films": it.catalogue.films()}},
    OUTLINES: {
        "get": lambda it, owner, number, asked: outlines_of(_film_subject(it, owner, number)),
        "post": lambda it, owner, number, asked: save_outlines(
            _film_subject(it, owner, number), asked.content.get("bodies")
        ),
    },
    f"{OUTLINES}/track": {"post": _track},
    f"{OUTLINES}/frame": {
        "post": lambda it, owner, number, asked: track_again(
            _film_subject(it, owner, number), asked.content.get("frame"), asked.content.get("places")
        )
    },
    f"/film/{NAME}/{NUMBER}/{NUMBER}-{NUMBER}": {"get": _frames},
}
"""What ``get``, ``post`` and ``delete`` do at each address."""


def routes(served: Served, scripts: Path) -> list[Any]:
    """Every address of the page, as a pattern with the handler that answers there and its arguments, for Tornado;
    ``scripts``: folder of Bokeh's scripts."""
    it = {"served": served}
    return [
        ("/", Shell, it),
        (rf"/web/({'|'.join(path.name for path in PLAYER.iterdir())})", OwnFiles, {**it, "path": str(PLAYER)}),
        (r"/web/([a-z]+\.(?:js|css))", OwnFiles, {**it, "path": str(WEB)}),
        (r"/drawing/(bokeh(?:-api)?\.min\.js)", OwnFiles, {**it, "path": str(scripts)}),
        ("/api/about", About, it),
        (f"/live/{NAME}", Live, it),
        *((address, Reply, it | does) for address, does in ADDRESSES.items()),
    ]
