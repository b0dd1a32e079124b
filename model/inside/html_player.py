"""HTML page around an animation: slider, speed, the action's time; needs no other file and no network.

``#t=0.112`` in the address stops it at that time. The page drives the clock of the SVG itself.
"""

from __future__ import annotations

import html
import json

import numpy as np
from numpy.typing import NDArray


def page(name: str, time_s: NDArray[np.float64], frame_s: float, svg: str) -> str:
    """HTML with the drawing ``svg`` of an action; frame k shows ``time_s[k]`` and lasts ``frame_s`` for the viewer."""
    return _PAGE.format(
        name=html.escape(name),
        svg=svg,
        last=len(time_s) - 1,
        frame=frame_s,
        times=json.dumps([round(float(t), 5) for t in time_s]),
    )


_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{name}: side view of a blow</title>
<style>body{{font-family:sans-serif;margin:12px}} svg{{width:100%;max-height:86vh}} #bar{{display:flex;gap:12px;
align-items:center}} #at{{flex:1}} output{{min-width:15em;font-variant-numeric:tabular-nums}}</style></head>
<body>
{svg}
<div id="bar"><button id="play">pause</button>
<input id="at" type="range" min="0" max="{last}" step="0.01" value="0" aria-label="time">
<select id="speed" aria-label="speed"><option value="0.25">quarter speed</option>
<option value="1" selected>speed 1</option><option value="4">4 times</option></select><output id="now"></output></div>
<script>
const times = {times}, frame = {frame};
const svg = document.querySelector("svg"), at = document.getElementById("at"), now = document.getElementById("now");
const play = document.getElementById("play"), speed = document.getElementById("speed");
let running = true, k = 0, before = null;
function show() {{
  svg.setCurrentTime(Math.min(k, times.length - 1.001) * frame);
  const i = Math.min(Math.floor(k), times.length - 2), t = times[i] + (k - i) * (times[i + 1] - times[i]);
  at.value = k;
  const slowed = Math.round(frame / (times[i + 1] - times[i]) / speed.value);
  now.textContent = t.toFixed(4) + " s, slowed " + slowed + " times";
}}
function run(is) {{ running = is; before = null; play.textContent = is ? "pause" : "play"; }}
function step(stamp) {{
  if (running) {{
    if (before !== null) k = (k + (stamp - before) / 1000 / frame * speed.value) % (times.length - 1);
    before = stamp;
    show();
  }}
  requestAnimationFrame(step);
}}
function stopAt(t) {{
  let i = times.findIndex((x) => x > t) - 1;
  if (i < 0) i = t < times[0] ? 0 : times.length - 2;
  k = Math.max(0, Math.min(i + (t - times[i]) / (times[i + 1] - times[i]), times.length - 1));
  run(false);
  show();
}}
play.onclick = () => run(!running);
at.oninput = () => {{ run(false); k = +at.value; show(); }};
speed.onchange = show;
svg.pauseAnimations();
const wanted = /t=([0-9.]+)/.exec(location.hash);
if (wanted) stopAt(+wanted[1]); else show();
requestAnimationFrame(step);
</script>
</body></html>
"""
