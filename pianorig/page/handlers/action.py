"""The action to try out: what can be turned, a blow, the touch, a technician's step, a file of it."""

from __future__ import annotations

import math
from typing import Any

from pianorig.errors import CommandInputError
from pianorig.page.action.changed_action import action_facts, built_in_actions, changed_action, scenes, toml_of
from pianorig.page.action.live_blow import BLOWS, blow_curves, live_blow
from pianorig.page.action.touch_and_steps import technician_step, touch
from pianorig.page.handlers.reply import Reply
from pianorig.player.animation import animation_html
from pianorig.player.shown import blow_animation


class Actions(Reply):
    """The actions, scenes and blows that can be chosen."""

    def get(self) -> None:
        """Send their names."""
        self.send({"actions": built_in_actions(), "blows": list(BLOWS), "scenes": scenes()})


class Facts(Reply):
    """What can be turned on an action."""

    async def get(self, name: str) -> None:
        """Send screws and parameters."""
        await self.answer(action_facts, name, self.get_query_argument("scene", "whole"))


class Changed(Reply):
    """Something about an action with changed values, ``scene=`` and ``set=path=value`` in the address."""

    async def get(self, name: str) -> None:
        """Send it."""
        changes = self.get_query_arguments("set")
        # taken here: what is asked for depends on the address, which another thread must not read
        options = {key: self.get_query_argument(key, "") for key in ("blow", "target", "turn_m")}
        options["scene"] = self.get_query_argument("scene", "whole")
        await self.answer(lambda: self.made(name, changes, options))

    def made(self, name: str, changes: list[str], options: dict[str, str]) -> Any:
        """What is sent."""
        raise NotImplementedError


class Blow(Changed):
    """A blow."""

    def made(self, name: str, changes: list[str], options: dict[str, str]) -> Any:
        """Its curves, events and drawing."""
        return live_blow(name, changes, options["blow"] or BLOWS[0], options["scene"])


class Curves(Changed):
    """The curves of a blow alone, which follow a slider."""

    def made(self, name: str, changes: list[str], options: dict[str, str]) -> Any:
        """Its curves."""
        return blow_curves(name, changes, options["blow"] or BLOWS[0], options["scene"])


class Touch(Changed):
    """The touch."""

    def made(self, name: str, changes: list[str], options: dict[str, str]) -> Any:
        """Its curve and weights."""
        return touch(changed_action(name, changes, options["scene"]))


class Step(Changed):
    """A technician's step."""

    def made(self, name: str, changes: list[str], options: dict[str, str]) -> Any:
        """What it does to the seven targets."""
        try:
            turn_m = float(options["turn_m"])
        except ValueError:
            turn_m = math.nan
        if not math.isfinite(turn_m):
            raise CommandInputError(f"turn_m {options['turn_m'][:40]!r}: allowed a number of metres")
        return technician_step(changed_action(name, changes, options["scene"]), options["target"], turn_m)


class TomlFile(Changed):
    """The file of it."""

    def made(self, name: str, changes: list[str], options: dict[str, str]) -> Any:
        """Its text."""
        return {"text": toml_of(changed_action(name, changes, options["scene"]))}


class BlowAnimation(Changed):
    """The blow as an animation to keep."""

    def made(self, name: str, changes: list[str], options: dict[str, str]) -> Any:
        """The text of its file."""
        in_scene = [] if options["scene"] == "whole" else [f"scene {' '.join(options['scene'].split())}"]
        view = live_blow(name, changes, options["blow"] or BLOWS[0], options["scene"])
        return {"text": animation_html(blow_animation(name, [*in_scene, *changes], view))}
