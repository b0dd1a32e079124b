"""Trial plans: which profile is played in which trial, in what order, with how much rest in between (TOML, checked).

A plain number of trials is a plan of one unnamed condition. The order is drawn once, from the plan's seed, and written
into ``session.toml``, from where an interrupted session is resumed (:mod:`rig.recording.resume`). Warm-up blows come
first, in the condition of the first trial; they are recorded and rejected.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rig.atomic_write import sha256_of_bytes
from rig.configuration import toml_file
from rig.configuration.profile import Profile, built_in_profiles, load_profile
from rig.configuration.rig_file import Number, Table, Text
from rig.errors import RigInputError
from rig.session import annotation_file
from rig.session.folder import Session
from rig.session.info import ActionInfo, FileInfo, PlanCondition, PlanInfo, RoomInfo
from rig.session.trial_data import TrialData

MAX_TRIALS = 9999  # four digits of a file name
WARM_UP_REASON = "warm-up blow of the plan"
Whole = Annotated[int, Field(strict=True)]


class ConditionConfig(Table):
    """One condition: its profile, how often it is played, and the operator's prompt before it."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,60}$")]
    profile: Text
    repeats: Whole = Field(default=1, ge=1, le=MAX_TRIALS)
    prompt: str = ""


class PlanConfig(Table):
    """A plan file. ``order``: ``randomised`` over all trials, in ``blocks`` of all conditions, or as ``listed``."""

    schema_name: Literal["piano-action-rig plan 1"] = Field(alias="schema")
    name: Text
    order: Literal["randomised", "blocks", "listed"] = "randomised"
    seed: Whole = Field(default=0, ge=0)
    rest_s: Number = Field(default=0.0, ge=0, le=3600)
    warm_up: Whole = Field(default=0, ge=0, le=100)
    conditions: tuple[ConditionConfig, ...] = Field(min_length=1)
    action: ActionInfo | None = None
    room: RoomInfo | None = None

    @model_validator(mode="after")
    def _check_names_and_number(self) -> PlanConfig:
        """Refuse two conditions of the same name, in capitals or small letters, and more than 9999 trials, warm-up
        blows among them."""
        names = [condition.name for condition in self.conditions]
        if len({name.lower() for name in names}) < len(names):
            raise ValueError(f"conditions are named {names}; each needs a name of its own")
        total = self.warm_up + sum(condition.repeats for condition in self.conditions)
        if total > MAX_TRIALS:
            raise ValueError(f"{total} trials, allowed at most {MAX_TRIALS}")
        return self


@dataclass(frozen=True, eq=False)
class Entry:
    """One blow of a plan: its number in the plan from 1, condition ("" without one), profile."""

    number: int
    condition: str
    profile: Profile
    warm_up: bool = False
    prompt: str = ""


@dataclass(frozen=True, eq=False)
class Plan:
    """Blows in the order they are played; ``text`` is the plan file's, if there is one."""

    entries: tuple[Entry, ...]
    rest_s: float = 0.0
    seed: int | None = None
    text: str = ""
    action: ActionInfo | None = None
    room: RoomInfo | None = None
    copies: Mapping[str, str] = field(default_factory=dict)
    """File name of each condition's copy of its profile."""

    @property
    def profiles(self) -> dict[str, Profile]:
        """Profile of each condition, in the order they first appear."""
        return {entry.condition: entry.profile for entry in self.entries}

    def files(self) -> dict[str, str]:
        """Copies to store beside ``session.toml``: names and texts."""
        copies = {self.copies[name]: profile.text for name, profile in self.profiles.items()}
        return {**copies, **({"plan.toml": self.text} if self.text else {})}

    def info(self) -> PlanInfo:
        """The plan as ``session.toml`` states it."""
        plain = not self.text
        conditions = () if plain else tuple(self._condition(name, profile) for name, profile in self.profiles.items())
        return PlanInfo(
            trials=len(self.entries),
            seed=self.seed,
            rest_s=self.rest_s,
            warm_up=sum(entry.warm_up for entry in self.entries),
            sha256=sha256_of_bytes(self.text.encode("utf-8")) if self.text else "",
            conditions=conditions,
            order=() if plain else tuple(entry.condition for entry in self.entries),
        )

    def _condition(self, name: str, profile: Profile) -> PlanCondition:
        prompt = next(entry.prompt for entry in self.entries if entry.condition == name)
        copy = FileInfo(name=profile.name, copy_name=self.copies[name], sha256=profile.sha256)
        return PlanCondition(name=name, prompt=prompt, profile=copy)


def reject_warm_up(session: Session, trial: TrialData) -> None:
    """Reject a trial about to be sealed if it is a warm-up blow of the plan and not rejected yet."""
    warm_up = 1 <= trial.plan_entry <= session.info.plan.warm_up
    if warm_up and trial.number not in annotation_file.rejections(session.annotations):
        annotation_file.append(session.path, trial.number, "reject", WARM_UP_REASON, "plan")


def plain_plan(profile: Profile, trials: int) -> Plan:
    """Return the plan of one profile played over and over.

    Parameters
    ----------
    profile : Profile
    trials : int
        How often, 1 to 9999.

    Returns
    -------
    Plan

    Raises
    ------
    RigInputError
        When the number is out of range.

    Examples
    --------
    >>> import rig
    >>> len(rig.plain_plan(rig.load_profile("forte"), 3).entries)
    3
    """
    if not 1 <= trials <= MAX_TRIALS:
        raise RigInputError(f"trials = {trials}, allowed 1 to {MAX_TRIALS}")
    return Plan(tuple(Entry(k, "", profile) for k in range(1, trials + 1)), copies={"": "profile.toml"})


def load_plan(path: str | Path) -> Plan:
    """Read a plan file and the profiles it names (built in, or paths from the plan's folder).

    Parameters
    ----------
    path : path
        TOML file.

    Returns
    -------
    Plan
        Its blows in the order they are played.

    Raises
    ------
    RigInputError
        When the file or one of its profiles cannot be used.

    Examples
    --------
    >>> import rig
    >>> plan = rig.load_plan("plan.toml")
    >>> len(plan.entries), sorted(plan.profiles)
    (4, ['forte', 'piano'])
    """
    file = Path(path)
    return parse_plan(toml_file.read_text(file), str(file), file.parent)


def parse_plan(text: str, where: str = "plan", folder: Path = Path()) -> Plan:
    """Check TOML text as a plan; ``where`` names it in errors, profiles are looked for from ``folder``."""
    config = toml_file.check(PlanConfig, toml_file.parse_toml(text, where), where)
    profiles = {c.name: _profile(c, f"{where}: condition {c.name}", folder) for c in config.conditions}
    by_name = {condition.name: condition for condition in config.conditions}
    order = draw_order(config)
    order = [order[0]] * config.warm_up + order
    entries = tuple(
        Entry(k + 1, name, profiles[name], k < config.warm_up, by_name[name].prompt) for k, name in enumerate(order)
    )
    return Plan(
        entries=entries,
        rest_s=config.rest_s,
        seed=config.seed,
        text=text,
        action=config.action,
        room=config.room,
        copies={name: f"profile_{name}.toml" for name in profiles},
    )


def _profile(condition: ConditionConfig, where: str, folder: Path) -> Profile:
    built_in = condition.profile in built_in_profiles()
    try:
        return load_profile(condition.profile if built_in else folder / condition.profile)
    except RigInputError as error:
        raise RigInputError(f"{where}: {error}") from None


def draw_order(config: PlanConfig) -> list[str]:
    """Return the conditions' names in the order of the trials, without warm-up blows: shuffled over all trials, or
    within blocks of all conditions, or as listed, as the plan says; the same seed gives the same order."""
    chance = random.Random(config.seed)
    if config.order == "blocks":
        order: list[str] = []
        for repeat in range(max(condition.repeats for condition in config.conditions)):
            block = [condition.name for condition in config.conditions if condition.repeats > repeat]
            chance.shuffle(block)
            order += block
        return order
    order = [condition.name for condition in config.conditions for _ in range(condition.repeats)]
    if config.order == "randomised":
        chance.shuffle(order)
    return order
