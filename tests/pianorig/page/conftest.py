"""A page that is served while a test runs, and a way to ask it that lets every header be wrong."""

from __future__ import annotations

import asyncio
import http.client
import json
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Coroutine, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pytest

import vision
from rig import Session
from rig.atomic_write import sha256_of_file
from vision import write_mraw
from vision.results.flags import FAILURE

Result = TypeVar("Result")
EXAMPLE = Path(__file__).parents[3] / "sessions" / "example_forte"


@dataclass
class Answer:
    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.body)


@dataclass
class Page:
    """A served page."""

    address: str
    port: int
    folder: Path = Path()

    def ask(self, path: str, method: str = "GET", body: Any = None, **headers: str | None) -> Answer:
        """Send a request as this page's own browser would; headers replace those, None leaves one out."""
        sent: dict[str, str | None] = {"Host": f"127.0.0.1:{self.port}"}
        if method != "GET":
            sent |= {"Origin": f"http://127.0.0.1:{self.port}", "Content-Type": "application/json"}
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        with closing(connection):
            connection.putrequest(method, path, skip_host=True)
            text = None if body is None else json.dumps(body).encode()
            for name, value in sent.items():
                if value is not None:
                    connection.putheader(name, value)
            if text is not None:
                connection.putheader("Content-Length", str(len(text)))
            connection.endheaders(text)
            answer = connection.getresponse()
            return Answer(answer.status, dict(answer.getheaders()), answer.read())


def serve(folder: Path, control: bool) -> Iterator[Page]:
    server = pytest.importorskip("pianorig.page.server", reason="the page needs the extra 'bench'")
    pytest.importorskip("bokeh", reason="the page needs the extra 'bench'")
    ready: Future[tuple[Any, asyncio.AbstractEventLoop, asyncio.Event]] = Future()

    async def run() -> None:
        served = server.BenchServer(server.BenchOptions(folder, 0, control))
        ended = asyncio.Event()
        ready.set_result((served.access, asyncio.get_running_loop(), ended))
        await ended.wait()
        await served.close()

    thread = threading.Thread(target=asyncio.run, args=(run(),))
    thread.start()
    access, loop, ended = ready.result(30)
    try:
        yield Page(access.address, access.port, folder)
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join(60)
        assert not thread.is_alive()


def awaited(task: Coroutine[Any, Any, Result]) -> Result:
    """What a coroutine returns, run in a thread of its own: in this one Playwright's loop may be running."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, task).result()


def heard(page: Page, path: str, count: int = 1, **headers: str) -> tuple[list[Any], str | None]:
    """The first messages of a websocket of the page, None where it is closed, and why."""
    from tornado.httpclient import HTTPRequest
    from tornado.websocket import websocket_connect

    here = page.address.rstrip("/")
    request = HTTPRequest(here.replace("http", "ws") + path, headers={"Origin": here, **headers})

    async def listen() -> tuple[list[Any], str | None]:
        socket = await websocket_connect(request)
        found = [await socket.read_message() for _ in range(count)]
        if found[-1] is None:
            socket.close()  # the client's half
        else:
            await left(socket)
        return found, socket.close_reason

    return awaited(listen())


async def left(socket: Any) -> None:
    """Close a websocket and wait until it is closed."""
    socket.close()
    while await socket.read_message() is not None:
        pass


@contextmanager
def own_process(folder: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], Page]]:
    """A page in a process of its own, which may be stopped or killed."""
    line = [sys.executable, "-m", "pianorig", "bench", str(folder), "--no-show", "--json", *options]
    server = subprocess.Popen(line, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    try:
        address = json.loads(server.stdout.readline())["address"]
        yield server, Page(address, int(address.rsplit(":", 1)[1].strip("/")))
    finally:
        server.send_signal(signal.SIGCONT)
        server.send_signal(signal.SIGINT)
        server.wait(60)
        server.stdout.close()


def copy_example(root: Path) -> Path:
    shutil.copytree(EXAMPLE, root / "example_forte", ignore=shutil.ignore_patterns("derived"))
    return root


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the example session."""
    return copy_example(tmp_path / "sessions")


HEIGHT, WIDTH, FRAMES = 60, 120, 120
FIRST_FRAME = 800
"""Of the film on its trial's frame clock: some milliseconds before the blow."""
LEFT = {"whippen": 6.0, "jack": 44.0, "repetition": 82.0}
"""Of each body's outline, px; all are 30 px wide and 44 high."""


def film_frames() -> np.ndarray:
    """Frames that tell their number and which way up they are."""
    rows, cols = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.stack([(rows + 2 * cols + k) % 200 for k in range(FRAMES)]).astype(np.uint8)


def add_film(folder: Path) -> Path:
    """Add to the folder a film of trial 1 whose outlines turn by 1 mrad a frame and are lost in frame 60."""
    session = Session.open(folder / "example_forte")
    write_mraw(session.path / "trial_0001.mraw", film_frames(), 2000.0, exposure_s=1e-4, start_frame=FIRST_FRAME)
    bodies = [
        vision.Body(name, np.array([[x, 8.0], [x + 30, 8.0], [x + 30, 52.0], [x, 52.0]])) for name, x in LEFT.items()
    ]
    vision.save_bodies(session.path / "bodies.toml", bodies)
    frame = np.arange(FRAMES)
    turn = np.where(frame == 60, np.nan, 1e-3 * frame)
    times = session.trial(1).read().camera.frame_time_s[FIRST_FRAME : FIRST_FRAME + FRAMES]
    columns: dict[str, Any] = {"time_s": times, "frame": frame}
    for body in bodies:
        columns |= {f"{body.name}_rad": turn, f"{body.name}_x_px": LEFT[body.name] + 15 + 0 * turn}
        columns[f"{body.name}_y_px"] = 30.0 + 0 * turn
        columns[f"{body.name}_flag"] = np.where(frame == 60, int(FAILURE), 0)
        columns |= {f"{body.name}_u_rad": 1e-4 + 0 * turn, f"{body.name}_relative_u_rad": 1e-4 + 0 * turn}
        columns[f"{body.name}_relative_rad"] = turn
    seals = {name: sha256_of_file(session.path / name) for name in ("bodies.toml", "trial_0001.mraw")}
    session.write_derived("angles", 1, pd.DataFrame(columns), {}, seals)
    return folder


@pytest.fixture
def filmed(folder: Path) -> Path:
    """The folder, with a film of trial 1."""
    return add_film(folder)


@pytest.fixture(scope="session")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page that may write, of such a folder with a film; for tests that leave it as it is."""
    yield from serve(add_film(copy_example(tmp_path_factory.mktemp("page") / "sessions")), control=True)


@pytest.fixture
def looking(folder: Path) -> Iterator[Page]:
    yield from serve(folder, control=False)


@pytest.fixture
def writing(folder: Path) -> Iterator[Page]:
    yield from serve(folder, control=True)
