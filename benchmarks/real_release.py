"""What the identified set misses on the real piano, what takes it away, and what a change of digits does.

    python -m benchmarks real_release [--parts falls,candidates,bound,perturbed | refit] [--svg FILE]

Falls: speed of the hammer as its sensor shows it, by place, in every fall of the training strokes. Candidates: scenes
and further parameters on top of the identified set; from there up to four steps with slopes taken once, so what a
candidate takes away is a lower bound. Bound: what is left when those of the candidates that add no effect are all
fitted, by their priors, by priors three times as wide, and to one kind alone. Refit (asked for alone, a quarter of an
hour): the whole fit with the integrator's tolerance changed by its last digit. Fitted are training strokes alone. Why:
docs/explanation/positions.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

import model
import validation.prediction.positions as predicting
from benchmarks.planted_positions import SHIPPED
from benchmarks.runner import Run
from model.scene.selection import SceneChoice
from rig.session import Session
from validation.events.strikes import RELEASE, phases
from validation.identification.positions import (
    DIFFERENCE,
    INDEPENDENT,
    LIMIT,
    Identified,
    fit,
    identify_session,
    misfit,
    read_identified,
)
from validation.measurement.positions import Stroke, measure_stroke
from validation.prediction.positions import (
    FREE,
    Free,
    Nominal,
    Predict,
    action_of,
    hammer_reading,
    hammer_turn,
    key_turn,
    sensing_of,
)
from validation.report.figures.svg import STYLE

Array = NDArray[np.float64]
PLACES = (0.5, 0.4, 0.3, 0.25, 0.2, 0.15, 0.1, 0.05)
LANDED, FAST = 0.005, 5.0
"""A fall ends where the hammer is shown below the first, faster than the second (rulers, rulers a second)."""
DAMPINGS = (1e-2, 1e-1, 1.0, 10.0)
STEPS = 4


def screw(name: str, path: str, width: float) -> Free:
    """A shift of one parameter."""
    return Free(name, name, (path,), width, adds=True)


def factor(name: str, paths: Sequence[str], width: float = 0.7) -> Free:
    """A factor on several."""
    return Free(name, name, tuple(paths), width)


def felt(contact: str) -> tuple[Free, Free]:
    """Stiffness and damping of a felt."""
    return factor(contact, [f"{contact}.normal.{x}" for x in "abc"]), factor(contact, [f"{contact}.normal.D"])


def remembering(*contacts: str) -> tuple[SceneChoice, tuple[Free, ...]]:
    """Felts with a memory of the way gone, and how wide its loop is."""
    laws = tuple((contact, "hysteresis") for contact in contacts)
    return SceneChoice(laws=laws), tuple(factor(c, [f"{c}.hysteresis.beta"]) for c in contacts)


CANDIDATES: dict[str, tuple[SceneChoice, tuple[Free, ...]]] = {
    "back check: geometry, felt": (
        SceneChoice(),
        (
            screw("wire's height", "contact04.second.y", 3e-3), screw("its slope", "contact04.second.normal.y", 0.1),
            screw("tail's radius", "contact04.first.radius", 5e-3), screw("tail", "contact04.first.x", 2e-3),
            *felt("contact04"),
        ),
    ),
    "repetition lever: geometry, spring's angle, pads": (
        SceneChoice(),
        (
            screw("pivot", "repetition.pivot.x", 1.5e-3), screw("pivot", "repetition.pivot.y", 1.5e-3),
            screw("arc", "contact10.second.x", 2e-3), screw("screw", "contact11.first.x", 3e-3),
            screw("spring's angle", "repetition_spring.angle", 0.15), *felt("contact06"), *felt("contact11"),
        ),
    ),
    "jack: geometry, spring": (
        SceneChoice(),
        (
            screw("pivot", "jack.pivot.x", 1.5e-3), screw("tip", "contact07.second.x", 5e-4),
            screw("toe", "contact08.first.x", 2e-3), factor("spring", ["jack_spring.torque"], 0.4),
        ),
    ),
    "felts under knuckle, hammer, whippen": (
        SceneChoice(), (*felt("contact07")[:1], *felt("contact10")[:1], *felt("contact13")[:1], *felt("contact01")[1:]),
    ),
    "friction of whippen, jack, capstan": (
        SceneChoice(),
        (
            factor("whippen", ["whippen.joint_friction.A"]), factor("jack", ["jack.joint_friction.A"]),
            factor("capstan", ["contact01.friction.A"]),
        ),
    ),
    "masses of whippen, jack, lever": (
        SceneChoice(), tuple(factor(b, [f"{b}.mass", f"{b}.inertia"], 0.3) for b in ("whippen", "jack", "repetition")),
    ),
    "pivots, centre of the hammer, its rest": (
        SceneChoice(),
        (
            screw("whippen", "whippen.pivot.x", 3e-3), screw("hammer", "hammer.pivot.x", 2e-3),
            screw("hammer", "hammer.pivot.y", 1e-3), screw("heel", "contact01.second.x", 3e-3),
            screw("centre", "hammer.center_of_mass.x", 5e-3), screw("centre", "hammer.center_of_mass.y", 4e-3),
            screw("rest", "contact13.first.y", 1.5e-3),
        ),
    ),
    "memory: knuckle": remembering("contact07", "contact10"),
    "memory: back check": remembering("contact04"),
    "memory: capstan, rest": remembering("contact01", "contact13"),
    "shank bends": (SceneChoice(effects=("shank",)), (factor("shank", ["shank.frequency_hz"], 0.4),)),
    "joints of whippen, jack, lever, hammer give": (
        SceneChoice(effects=("whippen_pin", "jack_pin", "repetition_pin", "hammer_pin")), (),
    ),
    "key lifts": (SceneChoice(effects=("balance_rail",)), ()),
}  # fmt: skip
"""Scene and further parameters with their priors."""
ALL = tuple(one for scene, more in CANDIDATES.values() if scene == SceneChoice() for one in more)


def training() -> tuple[Identified, list[Stroke]]:
    """The shipped set and the strokes it was fitted to."""
    record, session = read_identified(SHIPPED), Session.open(SHIPPED)
    return record, [measure_stroke(session.trial(int(n)).read()) for n in record.seals]


def falls(strokes: Sequence[Stroke]) -> dict[str, list[float]]:
    """Speed (rulers a second) at `PLACES` of every fall, by stroke and time."""
    found = {}
    for stroke in strokes:
        shown, n = stroke.hammer.value_m / stroke.hammer.travel_m, round(0.08 / stroke.interval_s)
        even = gaussian_filter1d(shown, 3e-3 / stroke.interval_s)
        speed = np.gradient(even, stroke.interval_s)
        for k in np.flatnonzero((shown[1:] <= LANDED) & (shown[:-1] > LANDED)):
            landed = shown[max(k - n // 3, 0) : k].min() <= LANDED  # noise about the place: the same fall
            if speed[k] < -FAST and even[k - n : k].max() > PLACES[0] and not landed:
                top = k - n + int(np.argmax(even[k - n : k]))
                at = [top + int(np.argmin(np.abs(even[top:k] - place))) for place in PLACES]
                found[f"{stroke.number} {stroke.condition}, {stroke.time_s[k]:.2f} s"] = [-float(speed[i]) for i in at]
    return found


def of_candidate(action: model.Action, scene: SceneChoice, more: Sequence[Free]) -> Predict:
    """The model in a scene, with further parameters behind those of the set."""
    nominal, n = Nominal.of(action), len(FREE)

    def predict(z: Array, stroke: Stroke, displacement_m: Array | None) -> Array:
        found = scene.on(action_of(action, z[:n]))
        values: dict[str, float] = {}
        for one, x in zip(more, z[n:], strict=True):
            for path in one.paths:
                values[path] = found[path] + one.width * x if one.adds else found[path] * float(np.exp(one.width * x))
        sensing = sensing_of(nominal, z, stroke.key.travel_m, stroke.hammer.travel_m)
        turned = key_turn(stroke, sensing, displacement_m)
        moved = hammer_turn(found.with_values(values, "tried"), stroke, turned, nominal.key_rest_rad)
        return hammer_reading(moved, sensing, stroke.hammer.travel_m)

    return predict


def slopes(z: Array, strokes: Sequence[Stroke], predict: Predict, which: range) -> Array:
    """Columns of the misfit's Jacobian."""
    here, out = misfit(z, strokes, predict), []
    for i in which:
        step = DIFFERENCE if z[i] < LIMIT - DIFFERENCE else -DIFFERENCE
        out.append((misfit(z + step * np.eye(z.size)[i], strokes, predict) - here) / step)
    return np.reshape(out, (len(which), here.size)).T


def descend(z: Array, strokes: Sequence[Stroke], predict: Predict, jacobian: Array) -> tuple[Array, float]:
    """The best of some steps with slopes taken once, and its misfit."""
    r = misfit(z, strokes, predict)
    for _ in range(STEPS):
        normal = jacobian.T @ jacobian
        tried = [z - np.linalg.solve(normal + d * np.diag(np.diag(normal)), jacobian.T @ r) for d in DAMPINGS]
        ends = [(misfit(np.clip(one, -LIMIT, LIMIT), strokes, predict), np.clip(one, -LIMIT, LIMIT)) for one in tried]
        best, there = min(ends, key=lambda end: float(end[0] @ end[0]))
        if best @ best >= 0.998 * (r @ r):
            break
        r, z = best, there
    return z, 0.5 * float(r @ r)


def rms(z: Array, strokes: Sequence[Stroke], predict: Predict, phase: str = "") -> Array:
    """RMS of each stroke, or of one phase of it, % of the ruler."""
    out = []
    for stroke in strokes:
        error = (predict(z, stroke, None) - stroke.hammer.value_m) / stroke.hammer.travel_m
        at = phases(stroke) == phase if phase else np.full(error.size, True)
        out.append(100 * float(np.sqrt(np.mean(error[at] ** 2))))
    return np.array(out)


def candidates(record: Identified, strokes: Sequence[Stroke]) -> None:
    """Print what each takes away."""
    action, z, n = model.load_action(record.action), np.array(record.z), len(FREE)
    plain = of_candidate(action, SceneChoice(), ())
    own = slopes(z, strokes, plain, range(n))
    there, start = descend(z, strokes, plain, own)
    print(
        f"{'as identified':50s} misfit {start:6.1f}; release, %",
        rms(there, strokes, plain, RELEASE).round(1),
        flush=True,
    )
    for name, (scene, more) in CANDIDATES.items():
        predict, k = of_candidate(action, scene, more), len(more)
        begun = np.concatenate([z, np.zeros(k)])
        added = slopes(begun, strokes, predict, range(n, n + k))
        jacobian = np.zeros((added.shape[0], n + k))
        jacobian[np.r_[:n, n + k : added.shape[0]], :n] = own
        jacobian[:, n:] = added
        there, cost = descend(begun, strokes, predict, jacobian)
        evidence = 2.0 * (start - cost) - k * np.log(len(strokes) * INDEPENDENT)
        said = f"{name:50s} misfit {cost:6.1f}, {k:2d} more, BIC better by {evidence:6.1f}; release, %"
        print(said, rms(there, strokes, predict, RELEASE).round(1), flush=True)


WIDER, BOUND_RUNS = 3.0, 16


def bound(record: Identified, strokes: Sequence[Stroke]) -> None:
    """Print what is missed where the set's parameters and `ALL` are fitted."""
    predict = of_candidate(model.load_action(record.action), SceneChoice(), ALL)
    begun = np.concatenate([np.array(record.z), np.zeros(len(ALL))])
    print(f"{begun.size} parameters fitted; RMSE of each stroke, % of the ruler; in the release")
    kinds = {one.condition: [s for s in strokes if s.condition == one.condition] for one in strokes}
    for what, fitted, wider in (
        ("as identified", (), 1.0), ("all strokes", strokes, 1.0), ("all strokes, priors wider", strokes, WIDER),
        *((f"{kind} alone, priors wider", some, WIDER) for kind, some in kinds.items()),
    ):  # fmt: skip

        def freely(z: Array, stroke: Stroke, displacement_m: Array | None, wider: float = wider) -> Array:
            return predict(wider * z, stroke, displacement_m)

        z = fit(fitted, freely, begun / wider, runs=BOUND_RUNS).z if fitted else begun
        of = fitted or strokes
        print(f"{what:34s}", rms(z, of, freely).round(1), rms(z, of, freely, RELEASE).round(1), flush=True)


SHARES = (1.0 + 1e-12, 0.9, 0.5)
"""Of the integrator's tolerance: a change of the last digits, and two of its steps."""


def perturbed(record: Identified, strokes: Sequence[Stroke]) -> None:
    """Print how far the mixture's answer, and each valley's, moves when the integrator's tolerance is another."""
    action, asked, sets = model.load_action(record.action), predicting.TOLERANCE_RAD, record.mixture
    print("RMS change, % of the ruler, of the mixture and of each valley; tolerance x", ", ".join(map(str, SHARES)))
    for stroke in strokes:
        every = []
        for share in (1.0, *SHARES):
            predicting.TOLERANCE_RAD = share * asked
            predict = predicting.of_model(action)  # a new one: it keeps what it has predicted
            alone = [predict(np.array(z), stroke, None) for z in sets.z]
            every.append(np.array([sets.predict(predict, stroke), *alone]) / stroke.hammer.travel_m)
        predicting.TOLERANCE_RAD = asked
        away = [100 * np.sqrt(np.mean((one - every[0]) ** 2, axis=1)) for one in every[1:]]
        print(
            f"trial {stroke.number} {stroke.condition:10s}",
            *(np.array2string(one, precision=1) for one in away),
            flush=True,
        )


def refit(record: Identified, strokes: Sequence[Stroke]) -> None:
    """Print how far the predictions of a whole fit move when the integrator's tolerance changes by its last digit."""
    session, asked = Session.open(SHIPPED), predicting.TOLERANCE_RAD
    predicting.TOLERANCE_RAD = SHARES[0] * asked
    again = identify_session(session, [stroke.number for stroke in strokes], record.action, start=record)
    predicting.TOLERANCE_RAD = asked
    predict = predicting.of_model(model.load_action(record.action))
    print(
        f"misfit {record.misfit['after']:.1f}, {again.misfit['after']:.1f}; RMSE of each stroke, % of the ruler; apart"
    )
    for trial in session.trials:
        stroke = measure_stroke(trial.read())
        a, b = (one.mixture.predict(predict, stroke) / stroke.hammer.travel_m for one in (record, again))
        shown = stroke.hammer.value_m / stroke.hammer.travel_m
        off = [100 * float(np.sqrt(np.mean(x**2))) for x in (a - shown, b - shown, a - b)]
        print(f"trial {stroke.number} {stroke.condition:10s}", *(f"{x:6.2f}" for x in off), flush=True)


def draw(record: Identified, strokes: Sequence[Stroke], path: Path) -> None:
    """Write the repeated strokes by the regulated and the identified set, the falls by place, the sensor's curve."""
    predict, stroke = predicting.of_model(model.load_action(record.action)), strokes[-1]
    time_s, travel = stroke.time_s, stroke.hammer.travel_m
    with rc_context(STYLE):
        drawn = Figure(figsize=(9.2, 6.4), layout="constrained")
        above, left, right = drawn.subplot_mosaic([["whole", "whole"], ["falls", "curve"]]).values()
        key = stroke.key.value_m / stroke.key.travel_m
        above.plot(time_s, key, color="#8a8a8a", lw=0.8, ls=":", label="key, measured")
        for label, made, colour in (
            ("regulated", predict(np.zeros(len(FREE)), stroke, None), "#b35900"),
            ("identified", record.mixture.predict(predict, stroke), "#00508c"),
            ("hammer, measured", stroke.hammer.value_m, "#111111"),
        ):
            above.plot(time_s, made / travel, color=colour, lw=1.1, label=label)
        above.set(xlim=(0.25, time_s[-1]), xlabel="time, s", ylabel="share of the ruler", title="repeated, fitted")
        above.legend(ncols=4, fontsize=8, frameon=False, loc="lower left")
        for speeds in falls(strokes).values():
            left.plot(PLACES, speeds, color="#00508c", lw=0.8, marker=".")
        left.set(xlabel="place as shown, rulers", ylabel="rulers/s", title="speed of every fall", ylim=(0, 30))
        u = np.linspace(0.0, 1.0, 201)
        sensing = sensing_of(Nominal.of(model.load_action(record.action)), np.array(record.z), travel, travel)
        shown = predicting.hammer_place(u * travel / sensing.hammer_m_per_rad, sensing, travel) / travel
        right.plot(u, u, color="#8a8a8a", lw=0.8, ls=":")
        right.plot(u, shown, color="#00508c", lw=1.3)
        right.set(xlabel="place by the set, rulers", ylabel="place as shown, rulers", title="the hammer's sensor")
        drawn.savefig(path, format="svg", metadata={"Date": None})


def show_falls(_: Identified, strokes: Sequence[Stroke]) -> None:
    """Print the speed of every fall by place."""
    print("speed of every fall (rulers/s) where it is shown at", ", ".join(f"{place:g}" for place in PLACES))
    for name, speeds in falls(strokes).items():
        print(f"{name:24s}", np.round(speeds, 1))


PARTS = {"falls": show_falls, "candidates": candidates, "bound": bound, "perturbed": perturbed, "refit": refit}


def main(run: Run) -> None:
    """Print the parts, and draw the figure where one is asked for."""
    record, strokes = training()
    for part in run.parts:
        PARTS[part](record, strokes)
    if run.svg:
        draw(record, strokes, Path(run.svg))
