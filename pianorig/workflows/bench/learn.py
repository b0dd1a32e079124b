"""Learning a profile on a bench: every blow is a session of one trial on the normal record path.

The folder gets ``profile.toml`` (for ``record --profile``), ``learning.json``, figures after thesis Figs 3.6 to 3.8,
and the sessions ``blow_01`` … with everything that was recorded on the way.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pianorig.errors import InputError

if TYPE_CHECKING:
    from rig.configuration.profile import Profile
    from rig.learning import Blow, Learned, TargetForce
    from rig.session.trial_data import TrialData


def load_target(
    source: Path,
    sample_rate_hz: float,
    *,
    force_channel: str = "force_n",
    time_channel: str | None = "time_s",
    scale: float = 1.0,
    key_bottom_s: float | None = None,
    separator: str = ",",
    decimal: str = ".",
) -> TargetForce:
    """A recorded force as a target of learning; CSV, LVM, TDMS, HDF5 or a sealed trial.

    A file that states its own sample interval needs no channel of times; one that states another unit than N needs a
    scale.
    """
    from rig.foreign import read_channels
    from rig.foreign.channel_table import SECONDS
    from rig.foreign.units import known
    from rig.learning import make_target

    table = read_channels(source, separator=separator, decimal=decimal)
    unit = known(table.units.get(force_channel, ""))
    if unit not in (None, "N") and scale == 1.0:
        raise InputError(
            f"{source}: {force_channel} is in {unit!r} by the file itself; give --scale, newtons per {unit}"
        )
    if time_channel not in table.channels and force_channel in table.clocks:
        time_channel = None
    time_unit = known(table.units.get(time_channel or "", "")) or "s"
    if time_unit not in SECONDS:
        raise InputError(
            f"{source}: {time_channel} is in {time_unit!r} by the file itself, allowed {', '.join(SECONDS)}"
        )
    interval_s = table.interval([force_channel], time_channel, "--time CHANNEL", unit=time_unit)
    return make_target(
        source.stem, table.channel(force_channel), interval_s, sample_rate_hz, scale=scale, key_bottom_s=key_bottom_s
    )


def learn_profile(
    target: TargetForce,
    out: Path,
    *,
    rig: str | Path = "virtual",
    backend: str = "sim://",
    blows: int = 8,
    goal: float = 0.03,
    operator: str = "unknown",
    progress: Callable[[Blow], None] | None = None,
    yes: bool = False,
    ask: Callable[[str], str | None] = lambda question: None,
    selftests: Path = Path("selftests"),
) -> Learned:
    """Learn one profile and write the folder ``out``.

    Raises
    ------
    InputError : the folder exists, the target or a command leaves the limits, or the dry run does
    rig.errors.RigError : the bench stopped a blow; what was recorded is kept
    """
    from pianorig.workflows.bench.learning_figures import draw_learned
    from pianorig.workflows.model.predict_blow import predictor
    from rig.backend import open_backend
    from rig.configuration.rig_file import load_rig
    from rig.learning import learn
    from rig.recording.recorder import record_session
    from rig.safety.permission import permit

    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: exists already and is not an empty folder; choose another --out")
    rig_file = load_rig(rig)
    predict = predictor(rig_file)
    bench = open_backend(backend, rig_file.config)
    try:
        permission = None
        if bench.capabilities.hardware:
            permission = permit(rig_file, backend, selftests, yes=yes, ask=ask)

        def blow(profile: Profile, number: int) -> TrialData:
            session = record_session(
                out / f"blow_{number:02d}",
                profile=profile,
                rig_config=rig_file,
                backend=bench,
                trials=1,
                operator=operator,
                notes={"learning": f"blow {number} towards {target.name}"},
                predict=predict,
                permission=permission,
            )
            return session.trials[0].read()

        learned = learn(target, rig_file.config, blow, blows=blows, goal=goal, progress=progress)
    finally:
        bench.close()
    _write(out, learned)
    draw_learned(out, learned)
    return learned


def summary(learned: Learned) -> dict[str, Any]:
    """What was reached, as plain values."""
    best = learned.best
    return {
        "target": learned.target.name,
        "target_peak_n": round(learned.target.peak_n, 4),
        "rest_subtracted_n": round(learned.target.rest_n, 4),
        "target_key_bottom_s": round(learned.target.bottom_s, 5),
        "best_blow": best.number,
        "rms_percent_of_peak": round(100 * best.error, 3),
        "goal_percent": 100 * learned.goal,
        "follows": learned.follows,
        "obstacle": "" if learned.follows else learned.obstacle(),
        "measured_key_bottom_s": None if best.measured.bottom_s is None else round(best.measured.bottom_s, 5),
        "rms_percent_by_blow": [round(100 * blow.error, 3) for blow in learned.blows],
    }


def _write(out: Path, learned: Learned) -> None:
    from rig.storage.atomic_write import write_text

    best = learned.best
    found = f"{100 * best.error:.2f} % RMS of the peak before key bottom in blow {best.number}"
    text = best.profile.text.replace(
        f"blow {best.number} of learning {learned.target.name}", f"learned from {learned.target.name}: {found}", 1
    )
    write_text(out / "profile.toml", text)
    write_text(out / "learning.json", json.dumps(summary(learned), indent=1) + "\n")
