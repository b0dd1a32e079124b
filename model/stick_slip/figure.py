"""The friction limit on one sheet: hammer height by threshold speed, and the distance from set-valued friction."""

from __future__ import annotations

from pathlib import Path

from model.files.figure_sheet import new_sheet
from model.observables import hammer_height_m
from model.stick_slip.limit import Limit


def draw(limit: Limit, path: str | Path) -> None:
    """Write the sheet to ``path`` (.svg, .pdf or .png)."""
    with new_sheet(path, 10.0, 4.2) as sheet:
        over_time, over_speed = sheet.subplots(1, 2)
        for v_t, solution in zip(limit.v_t, limit.smoothed, strict=True):
            height = 1e3 * hammer_height_m(limit.action, solution.angle_rad)
            over_time.plot(1e3 * solution.time_s, height, lw=1.0, label=f"eq. 2.10, v_t = {v_t:g} m/s")
        marched = limit.marched.solution
        over_time.plot(
            1e3 * marched.time_s,
            1e3 * hammer_height_m(limit.action, marched.angle_rad),
            "k--",
            lw=1.0,
            label="set-valued",
        )
        over_time.set(xlabel="time, ms", ylabel="hammer to string, mm", title="One blow")
        over_time.legend(fontsize="small")
        over_speed.loglog(limit.v_t, [limit.away_rad(s) for s in limit.smoothed], "o-", label="whole blow")
        held = [limit.away_until_release_rad(s) for s in limit.smoothed]
        over_speed.loglog(limit.v_t, held, "s--", label="until the release")
        over_speed.axhline(limit.march_error_rad, color="0.6", lw=1.0, ls=":", label="march, step halved")
        over_speed.set(
            xlabel="threshold speed v_t, m/s", ylabel="largest difference of any angle, rad", title="From the limit"
        )
        over_speed.legend(fontsize="small")
        for axes in (over_time, over_speed):
            axes.grid(alpha=0.3)
