"""How time passes on the virtual device: while a client waits, and by itself.

A wait for samples, for the end of a task or for a timeout lets pass what it takes. Beyond that the rule is:

- on a paced clock the device goes on with the wall clock, whether or not a client reads; what is due passes before each
  call, and in a server every 10 ms. A reader that is late finds its samples, or finds them overwritten (-200279);
- on the virtual clock nothing else takes time, except questions, so that loops that poll come to an end: one about the
  samples of a task that has none to read takes :data:`POLL_S`; any question that follows another (done, positions,
  counts) takes :data:`QUESTION_S`; a reading on demand takes :data:`ON_DEMAND_S` while no clock runs.

On a paced clock time moves in stretches of 20 ms, between which other clients and the watchdogs get a turn.

Time passing on the virtual device: outputs, plant, inputs, in this order, n edges of the bench at once.

Generations say what the outputs are at by each edge, the bench answers with what stands at the sensors' terminals, and
every input task acquires the samples its clock ticked for. Sample k of AI and CI is latched at edge k; sample k of AO
is generated at edge k and stays until the next.

Pause triggers: a task with a sample clock of its own takes no sample while a digital terminal is at a level.

A counter output's pulses, a line of a port that shares its pin with the terminal, and nothing at all, which is low, can
be on it. The clock goes on by whole samples: what is left out is left out.

Reference triggers: a finite acquisition that keeps samples from before an edge and ends a set number after it.

The input buffer drops its oldest samples until the edge has come; nothing can be read before the last posttrigger
sample has been acquired, as with the driver.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.simulated.device.state import DeviceState
from rig.simulated.device.task import SimulatedTask
from rig.simulated.device.tdms_log import LOG
from rig.simulated.device.watchdog import check_watchdogs
from rig.simulated.signals import analog_reading, edges_passed, latch, level_on, set_clocked_lines, set_outputs
from rig.simulated.status import Code, DaqStatusError
from rig.simulated.timing.engine import Engine, check_triggers, edges_to_trigger, engine_of, load_pulses, watches


def paused(device: DeviceState, task: SimulatedTask, edge: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether a task pauses at each edge (n,) of the bench."""
    return level_on(device, task.triggers.pause, edge) == task.triggers.pause_high


def ticks_to_acquire(
    device: DeviceState, task: SimulatedTask, edge: NDArray[np.int64], values: NDArray[np.float64]
) -> int:
    """Return how many of the next ticks, on these edges of the bench (n,), still belong to the acquisition.

    ``values``, (n, channels), are what the task would acquire. An edge of the trigger counts only after all pretrigger
    samples have been acquired. The first sample behind it is the first posttrigger sample.
    """
    progress, triggers = task.progress, task.triggers
    if task.timing.clock is None or task.buffer is None or not edge.size:
        return 0
    if progress.reference_end is None:
        index = task.buffer.acquired + np.arange(edge.size)
        comparator = progress.comparator
        if comparator is None:
            passed = edges_passed(device, triggers.reference, edge)
        else:
            passed = progress.crossings + comparator.crossings(values[:, 0])
            progress.crossings = int(passed[-1])
        armed = index >= triggers.pretrigger_samples
        if progress.reference_edges is None and armed.any():
            progress.reference_edges = int(passed[armed][0])
        posttrigger = armed & (passed > (progress.reference_edges or 0))
        if not posttrigger.any():
            return edge.size
        first = int(index[posttrigger][0])
        progress.reference_end = first + task.timing.clock.samples - triggers.pretrigger_samples
    return int(min(edge.size, max(progress.reference_end - task.buffer.acquired, 0)))


def pass_edges(device: DeviceState, n: int) -> None:
    """Let n edges of the bench pass."""
    bench, edge = device.bench, device.bench.edge
    clocked = [
        (task, engine)
        for task in device.tasks.values()
        if task.progress.live and task.type != "CO" and (engine := engine_of(device, task)) is not None
    ]
    command_v = np.full(n, device.output_v.get(device.motor, 0.0))
    device.line_history.clear()
    for task, engine in clocked:
        if task.type in ("AO", "DO"):
            _generate(device, task, engine, command_v)
    at_s = (edge + np.arange(n)) / bench.rate_hz
    bench.set_motor_volts(command_v)
    cell, quarter = bench.step(command_v if device.drive_enabled() else np.zeros(n))
    cell, quarter = device.faults.change(device.trial, at_s, cell, quarter)
    for task, engine in clocked:
        if task.buffer is None:
            continue
        first, last = _ticks(task, engine, edge, n)
        if not task.triggers.pause:
            last = min(last, first + int(min(task.samples_remaining, last - first)))
        rows = np.clip(engine.edges(first, last) - edge, 0, n - 1)
        if task.triggers.pause:
            rows = rows[~paused(device, task, edge + rows)]
            rows = rows[: int(min(task.samples_remaining, rows.size))]
        if not rows.size:
            continue
        values = latch(device, task, cell[rows], quarter[rows], edge + rows)
        if task.triggers.referenced:
            values = values[: ticks_to_acquire(device, task, edge + rows, values)]
        if values.size:
            task.buffer.put(values)
        if task.log is not None and task.logging.mode == LOG:
            task.log.write(task.buffer.take(task.buffer.available))
    for task in device.tasks.values():
        if watches(task) and (comparator := task.progress.comparator) is not None:
            reading = analog_reading(device, task, task.channels[0], cell, edge + np.arange(n))
            task.progress.triggered = task.progress.triggered or bool(comparator.crossings(reading)[-1])
    for task in device.tasks.values():
        if task.type == "CO" and task.progress.live and task.pulses.written is not None:
            load_pulses(device, task, edge, n)
    for task in device.tasks.values():
        if task.type == "CO" and task.progress.live and bench.now_s >= task.pulses.end_s:
            task.pulses.finished = True


def _ticks(task: SimulatedTask, engine: Engine, edge: int, n: int) -> tuple[int, int]:
    first = task.progress.first_tick
    return max(engine.passed(edge), first), max(engine.passed(edge + n), first)


def _generate(device: DeviceState, task: SimulatedTask, engine: Engine, command_v: NDArray[np.float64]) -> None:
    """Generate the samples of the next edges; those of the motor's channel go into ``command_v``, (n,)."""
    edge, n = device.bench.edge, command_v.size
    first, last = _ticks(task, engine, edge, n)
    at = engine.edges(first, last) - edge
    if task.triggers.pause:
        at = at[~paused(device, task, edge + at)]
    rows = task.generate(at.size)
    if not rows.shape[0]:
        return
    at = at[: rows.shape[0]]
    if task.type == "DO":
        set_clocked_lines(device, task, rows, at, n)
        return
    set_outputs(device, task, rows[-1])
    for column, channel in enumerate(task.channels):
        if channel.physical.name == device.motor:
            last_row = np.searchsorted(at, np.arange(n), side="right") - 1
            reached = last_row >= 0
            command_v[reached] = rows[last_row[reached], column]


STRETCH_S = 0.02
POLL_S = 0.01
QUESTION_S = 1e-3
"""What a further question in a row takes on the virtual clock."""
ON_DEMAND_S = 1e-3
"""What a reading on demand takes on the virtual clock while no sample clock runs."""
MOST_DUE_S = 0.5
"""Most that passes by itself at once; a bench that cannot keep up with its clock falls behind it."""
ENDLESS = np.iinfo(np.int64).max


def edges_in(device: DeviceState, duration_s: float) -> int:
    """Return how many edges of the bench to let pass for a short time: at least one."""
    return max(int(duration_s * device.bench.rate_hz), 1)


def advance(device: DeviceState, n: int) -> int:
    """Let at most n edges of the bench pass, return how many did; none do when no task has anything left to do."""
    left = n
    stretch = edges_in(device, STRETCH_S) if device.bench.clock.paced else n
    while left > 0:
        due = _edges_to_expiry(device)
        now = int(min(left, stretch, _edges_to_end(device), edges_to_trigger(device), due))
        if now <= 0:
            break
        pass_edges(device, now)
        check_triggers(device)
        left -= now
        if now == due:
            check_watchdogs(device)
        if left > 0:
            device.let_clients_call()
    return n - left


def _edges_to_expiry(device: DeviceState) -> float:
    """Return how many edges pass before the next watchdog expires; on a paced clock each stretch looks by itself."""
    clock = device.bench.clock
    left_s = [
        timer.timeout_s - (clock.elapsed_s - timer.reset_at_s)
        for timer in device.watchdogs.values()
        if timer.running and not timer.expired and not clock.paced
    ]
    return max(np.floor(min(left_s) * device.bench.rate_hz), 0.0) + 1 if left_s else float("inf")


def _edges_to_end(device: DeviceState) -> float:
    """Return how many edges pass before the last task that makes time pass has ended."""
    left = 0.0
    for task in device.tasks.values():
        if watches(task):
            return float("inf")
        if not task.progress.live:
            continue
        if task.type == "CO":
            left = max(left, 0.0 if task.pulses.finished else _edges_to_pulse_end(device, task))
        elif task.timing.own_clock and (engine := engine_of(device, task)) is not None:
            ended = float("inf") if np.isinf(engine.limit) else engine.edge_after(int(engine.limit))
            if task.triggers.pause and task.samples_remaining <= 0:
                ended = 0.0
            left = max(left, ended - device.bench.edge)
    return left


def _edges_to_pulse_end(device: DeviceState, task: SimulatedTask) -> float:
    return float(np.ceil(task.pulses.end_s * device.bench.rate_hz) - device.bench.edge) + 1


def wait_until_done(device: DeviceState, task: SimulatedTask, timeout_s: float) -> None:
    """Let time pass until a task is done, at most ``timeout_s``; a negative one waits for ever."""
    allowed = _edges_of_timeout(device, timeout_s)
    live, remaining = task.progress.live, task.samples_remaining
    left = 0.0
    if task.type == "CO":
        left = _edges_to_pulse_end(device, task) if live else 0.0
    elif task.triggers.pause or watches(task):
        while allowed > 0 and not task.done:
            passed = advance(device, int(min(edges_in(device, POLL_S), allowed)))
            allowed = allowed - passed if passed else 0
        return
    elif live and np.isfinite(remaining) and (engine := engine_of(device, task)) is not None:
        ticks = task.progress.first_tick + task.samples_since_trigger + int(remaining)
        left = engine.edge_after(ticks) - device.bench.edge
    elif live:
        left = float("inf")
    if np.isfinite(left):
        advance(device, int(min(left, allowed)))
    elif timeout_s > 0:
        advance(device, int(allowed))


def wait_for_samples(device: DeviceState, task: SimulatedTask, missing: int, timeout_s: float) -> None:
    """Let time pass until a task has ``missing`` more samples, or the timeout has ended."""
    if task.buffer is not None:
        allowed = _edges_of_timeout(device, timeout_s)
        wanted = task.buffer.acquired + missing
        while allowed > 0 and task.state == "running" and not task.progress.error and _incomplete(task, wanted):
            passed = advance(device, int(min(_edges_to_sample(device, task, wanted), allowed)))
            if not passed:
                break
            allowed -= passed
        if not _incomplete(task, wanted) or task.progress.error:
            return
        timeout_s = allowed / device.bench.rate_hz
    wait_for_timeout(device, task, timeout_s)


def wait_for_timeout(device: DeviceState, task: SimulatedTask, timeout_s: float) -> None:
    """Let a timeout pass for a task for which nothing ticks; other clients get a turn, and may end it."""
    if timeout_s < 0:
        timeout_s = float(ENDLESS) / device.bench.rate_hz
    while timeout_s > 0 and task.state == "running" and not task.progress.error:
        now_s = min(timeout_s, STRETCH_S) if device.bench.clock.paced else timeout_s
        device.bench.clock.advance(now_s)
        timeout_s -= now_s
        device.let_clients_call()


def _incomplete(task: SimulatedTask, wanted: int) -> bool:
    if task.triggers.referenced:
        return task.samples_remaining > 0
    return task.buffer is not None and task.buffer.acquired < wanted


def _edges_to_sample(device: DeviceState, task: SimulatedTask, wanted: int) -> float:
    """Return after how many edges of the bench to check whether a task has acquired ``wanted`` samples."""
    poll = edges_in(device, POLL_S)
    if not task.progress.live:
        to_trigger = poll if watches(task) else edges_to_trigger(device)
        return to_trigger if np.isfinite(to_trigger) else poll
    engine = engine_of(device, task)
    if engine is None or task.triggers.referenced or task.triggers.pause:
        return poll
    ticks = wanted - task.progress.samples_before_trigger
    if task.retriggerable and task.timing.clock is not None:
        ticks = min(ticks, task.timing.clock.samples)
    return max(engine.edge_after(task.progress.first_tick + ticks) - device.bench.edge, 1)


def write_as_room_comes(
    device: DeviceState, task: SimulatedTask, values: NDArray[np.float64], timeout_s: float
) -> None:
    """Append samples, (n, columns), to a running generation without regeneration, as its buffer has room for them.

    Raises DaqStatusError when the timeout ends first, or the generation has.
    """
    allowed = _edges_of_timeout(device, timeout_s)
    written, output = 0, task.output
    while written < values.shape[0] and output.samples is not None:
        if task.progress.error:
            raise DaqStatusError(task.progress.error, f"Task: {task.name}", samples_written=written)
        room = output.size - (output.written - output.generated)
        if room > 0:
            output.samples = np.concatenate((output.samples, values[written : written + room]))
            written = min(written + room, values.shape[0])
        elif allowed <= 0 or task.state != "running":
            raise DaqStatusError(Code.SAMPLES_CAN_NOT_YET_BE_WRITTEN, f"Task: {task.name}", samples_written=written)
        else:
            step = min(edges_in(device, POLL_S), allowed)
            if not advance(device, step):
                device.bench.clock.advance(step / device.bench.rate_hz)
                device.let_clients_call()
            allowed -= step


def _edges_of_timeout(device: DeviceState, timeout_s: float) -> int:
    """Return a timeout in edges of the bench; a negative one has no end, one that is not a number has ended."""
    if timeout_s < 0 or timeout_s * device.bench.rate_hz > ENDLESS:
        return int(ENDLESS)
    return int(timeout_s * device.bench.rate_hz + 1e-9) if timeout_s > 0 else 0


def let_pass(device: DeviceState, duration_s: float) -> None:
    """Let a time pass whether or not anything runs, e.g. that of a call on a slow network."""
    clock = device.bench.clock
    end_s = clock.now_s + duration_s
    advance(device, int(duration_s * device.bench.rate_hz))
    if (left_s := end_s - clock.now_s) > 0:
        clock.advance(left_s)


def go_on(device: DeviceState) -> None:
    """Let pass what is due by the wall clock, on a paced clock; none is due on the virtual one."""
    clock = device.bench.clock
    if not clock.paced:
        return
    running = any(task.progress.live for task in device.tasks.values())
    due = int(min(clock.due_s, MOST_DUE_S) * device.bench.rate_hz)
    if running and due > 0:
        advance(device, due)


def await_something(device: DeviceState, task: SimulatedTask) -> None:
    """Let a question about samples take its time on the virtual clock, when there are none to read."""
    if not device.bench.clock.paced and task.progress.live and task.buffer is not None and not task.buffer.available:
        advance(device, edges_in(device, POLL_S))


def question_asked(device: DeviceState, *, again: bool) -> None:
    """Let a question about a task take its time on the virtual clock, when the call before was one too."""
    if again and not device.bench.clock.paced:
        advance(device, edges_in(device, QUESTION_S))


def settle_on_demand(device: DeviceState) -> None:
    """Let the bench go on before a reading on demand when no clock runs: outputs written on demand act."""
    if any(task.progress.live and (task.type == "CO" or task.timing.own_clock) for task in device.tasks.values()):
        return
    clock, rate_hz = device.bench.clock, device.bench.rate_hz
    due_s = min(clock.due_s, MOST_DUE_S) if clock.paced else ON_DEMAND_S
    device.bench.present()  # begins a trial of its own where there was none
    if (n := int(due_s * rate_hz)) > 0:
        pass_edges(device, n)
    clock.begin()
