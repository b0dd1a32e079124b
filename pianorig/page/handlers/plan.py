"""The plan: what can be played, begin, pause, resume, abort, an answer; and its state, as it changes."""

from __future__ import annotations

import asyncio
import json
from contextlib import suppress
from typing import Any

from tornado.ioloop import IOLoop
from tornado.iostream import StreamClosedError
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from pianorig.errors import CommandInputError
from pianorig.page.control.order import choices, read_order
from pianorig.page.handlers.reply import Guarded, Reply

LOOK_S = 0.1
ALIVE_S = 0.5
"""At least so often the page is sent the state, and answers that it is there."""


class Plan(Reply):
    """The plan as a whole."""

    async def get(self) -> None:
        """Send its state and what can be ordered."""
        await self.answer(self._found)

    def _found(self) -> dict[str, Any]:
        plan = self.served.plan
        bench = {"rig": plan.bench.rig, "backend": plan.bench.backend}
        return {"state": plan.state, "bench": bench, **choices(self.served.catalogue)}

    async def post(self) -> None:
        """Begin one."""
        content = self.body()
        if content is not None:
            await self.answer(self._begin, content)

    def _begin(self, content: dict[str, Any]) -> dict[str, Any]:
        plan = self.served.plan
        if plan.running:
            raise CommandInputError("a plan is being played; abort it, or wait for its end")
        return {"state": plan.start(read_order(content, self.served.catalogue, plan.bench))}


class PlanDoes(Reply):
    """Pause, resume, abort."""

    async def post(self, what: str) -> None:
        """Do it."""
        if self.body() is not None:
            await self.answer(lambda: {"state": self.served.plan.do(what)})


class PlanAnswer(Reply):
    """An answer to the recorder's question."""

    async def post(self) -> None:
        """Hand it on."""
        content = self.body()
        if content is not None:
            await self.answer(lambda: {"state": self.served.plan.answer(content.get("question"), content.get("text"))})


class PlanState(Guarded, WebSocketHandler):
    """A websocket that sends the state; whoever may write keeps the plan going by answering."""

    _task: asyncio.Task[None] | None = None
    _may_write = False

    def check_origin(self, origin: str) -> bool:
        """The origin was checked before (`Guarded.prepare`)."""
        return True

    def open(self, *arguments: str, **more: str) -> None:
        """Begin to tell the state."""
        access = self.served.access
        self._may_write = access.may_write(self.get_cookie(access.cookie_name))
        self._task = asyncio.get_running_loop().create_task(self._tell())

    async def on_message(self, message: str | bytes) -> None:  # type: ignore[override]
        """The page is there."""
        if self._may_write:
            with suppress(CommandInputError):  # ended meanwhile
                await IOLoop.current().run_in_executor(self.served.workers, self.served.plan.seen)

    def on_close(self) -> None:
        """This page is gone; the recorder notices that it hears nothing more."""
        if self._task is not None:
            self._task.cancel()

    async def _tell(self) -> None:
        sent, quiet_s = None, ALIVE_S
        with suppress(WebSocketClosedError, StreamClosedError):
            while True:
                state = self.served.plan.state
                if state is not sent or quiet_s >= ALIVE_S:
                    await self.write_message(json.dumps(state))
                    sent, quiet_s = state, 0.0
                await asyncio.sleep(LOOK_S)
                quiet_s += LOOK_S
