// A rolling scope of a recording, as it is made; what it draws from is bounded, so an hour looks like a minute.
import { link } from "./address.js";
import { make } from "./elements.js";
import { ask, at, colourOf } from "./server.js";
import { trialsPart } from "./trials.js";

const WINDOWS_S = [0.5, 1, 2, 5, 10, 30], LONGEST_S = 30, STRIP_PX = 84, LEFT_PX = 8, AGAIN_MS = 1000;

/** Samples of all channels in a ring; places that were never filled are NaN. */
class Ring {
  constructor(channels, rate) {
    this.columns = channels;
    this.size = Math.ceil(LONGEST_S * rate);
    this.values = new Float32Array(this.size * channels).fill(NaN);
    this.end = 0;
    this.lost = 0;
  }

  take(first, rows) {
    const n = rows.length / this.columns;
    if (first > this.end) { // a gap is left open
      this.lost += first - this.end;
      for (let k = Math.max(this.end, first - this.size); k < first; k++) this.values.fill(NaN, (k % this.size) * this.columns, (k % this.size + 1) * this.columns);
    }
    for (let k = 0; k < n; k++) this.values.set(rows.subarray(k * this.columns, (k + 1) * this.columns), ((first + k) % this.size) * this.columns);
    this.end = first + n;
  }

  get(sample, column) { return sample < 0 || sample < this.end - this.size || sample >= this.end ? NaN : this.values[(sample % this.size) * this.columns + column]; }
}

/** Measured (broad) and predicted (thin) angle of each channel, one beside the other. */
function drawBeside(canvas, curves) {
  const names = Object.keys(curves), pen = canvas.getContext("2d"), wide = canvas.width / Math.max(names.length, 1), ink = getComputedStyle(document.documentElement).getPropertyValue("--ink");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  pen.font = "13px system-ui, sans-serif";
  names.forEach((name, i) => {
    const { time_s: time, measured_deg: measured, predicted_deg: predicted } = curves[name], known = [...measured, ...predicted].filter((value) => value !== null);
    if (!known.length) return;
    const low = Math.min(...known), high = Math.max(...known), x = (t) => i * wide + LEFT_PX + (wide - 2 * LEFT_PX) * (t - time[0]) / (time.at(-1) - time[0] || 1), y = (value) => canvas.height - 4 - (canvas.height - 26) * (value - low) / (high - low || 1);
    pen.fillStyle = ink;
    pen.fillText(`${name}  ${low.toFixed(1)} to ${high.toFixed(1)} °`, i * wide + LEFT_PX, 13);
    for (const [values, width, colour] of [[measured, 3, colourOf(name, i)], [predicted, 1, ink]]) {
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.beginPath();
      let open = false;
      values.forEach((value, k) => {
        if (value === null) { open = false; return; }
        if (open) pen.lineTo(x(time[k]), y(value)); else pen.moveTo(x(time[k]), y(value));
        open = true;
      });
      pen.stroke();
    }
  });
}

export async function showLive(main, values) {
  const { sessions } = await ask("/api/sessions");
  const name = values.get("session") || (sessions.find((row) => row.status.includes("not sealed")) || sessions[0] || {}).name;
  if (!name) { main.append(make("p", {}, "No session here yet. Record one in a terminal:  pianorig record")); return null; }
  const seconds = Number(values.get("window")) || 2;
  const canvas = make("canvas", { class: "scope", width: 1200, height: STRIP_PX, role: "img", "aria-label": `Scope of ${name}` });
  const lamp = make("strong", { class: "lamp", role: "status" }), told = make("span", { class: "values" }), disk = make("span");
  const pause = make("button", { type: "button", "aria-pressed": "false", onclick: () => { paused = !paused; pause.setAttribute("aria-pressed", String(paused)); pause.textContent = paused ? "Go on" : "Pause the scope"; frozen = ring?.end ?? 0; dirty = true; } }, "Pause the scope");
  const hold = make("button", { type: "button", "aria-pressed": "false", onclick: () => { held = held ? null : picture(); hold.setAttribute("aria-pressed", String(Boolean(held))); dirty = true; } }, "Hold");
  const window_ = make("select", { onchange: () => { length = Number(window_.value); dirty = true; } }, ...WINDOWS_S.map((s) => make("option", { value: s }, `${s} s`)));
  const select = make("select", { onchange: () => { location.hash = link("live", { session: select.value }); } }, ...sessions.map((row) => make("option", { value: row.name }, row.name)));
  const scales = make("div", { class: "row" }), trials = trialsPart(), bar = make("progress", { max: 1, value: 0, hidden: true, "aria-label": "This trial" });
  let socket = null, state = null, seen = null, ring = null, closed = false, paused = false, held = null, length = seconds, frozen = 0, dirty = true, scale = [], timer = 0;
  const judged = make("section", { hidden: true, "aria-label": "The last trial beside the model" }), said = make("pre", { class: "judged", role: "status" }), beside = make("canvas", { width: 1200, height: STRIP_PX, role: "img", "aria-label": "Measured and predicted angles of the last trial" });
  judged.append(make("h3", {}, "The last trial beside the model"), said, beside, make("p", { class: "hint" }, "Broad: measured; thin: predicted."));
  window_.value = seconds;
  select.value = name;
  main.append(
    make("div", { class: "row" }, make("label", {}, "Session", select), lamp, bar, told, disk),
    make("div", { class: "row" }, pause, hold, make("label", {}, "Window", window_), make("span", { class: "hint" }, "P pauses it, H holds the picture to compare with")),
    canvas, make("details", {}, make("summary", {}, "Scale of each channel"), scales), judged, trials.element);
  const keys = (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest?.("input, textarea, select")) return;
    if (event.key === "p") pause.click(); else if (event.key === "h") hold.click();
  };
  document.addEventListener("keydown", keys);
  const resized = () => { dirty = true; };
  addEventListener("resize", resized);

  function connect() {
    socket = new WebSocket(`ws://${location.host}/live/${at(name)}`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = ({ data }) => { if (typeof data === "string") newState(JSON.parse(data)); else newSamples(data); };
    socket.onclose = ({ reason }) => {
      if (closed) return;
      lamp.textContent = reason || "the bench does not answer; asking again";
      lamp.className = "lamp error";
      timer = setTimeout(connect, AGAIN_MS);
    };
  }

  function newState(now) {
    const other = !state || !state.recording || now.trial !== state.trial || now.started_utc !== state.started_utc;
    if (now.recording && (other || !ring)) {
      ring = new Ring(now.channels.length, now.rate_hz);
      const names = now.channels.map((channel) => channel.name).join();
      if (scales.dataset.names !== names) { // what was typed stays from trial to trial
        scales.dataset.names = names;
        scale = now.channels.map(() => null);
        scales.replaceChildren(...now.channels.map((channel, i) => scaleOf(channel, i)));
      }
    }
    state = now;
    if (now.recording) seen = now; // its channels, rate and number stay on the scope when the trial has ended
    lamp.textContent = now.recording ? "● recording" : "○ nothing is being recorded";
    lamp.className = `lamp ${now.recording ? "on" : ""}`;
    canvas.hidden = !ring;
    const rate_mb = now.rate_hz * (now.channels.length + 1) * 8e-6, minutes = rate_mb ? 1e3 * now.disk_free_gb / rate_mb / 60 : Infinity;
    disk.textContent = `disk ${now.disk_free_gb} GB free${minutes < 6000 ? `, some ${minutes < 100 ? `${Math.round(minutes)} min` : `${Math.round(minutes / 60)} h`} of recording` : ""}`;
    disk.className = now.disk_free_gb < 2 ? "problem" : "hint";
    trials.set(now.figures);
    judged.hidden = !now.judged;
    if (now.judged && said.dataset.trial !== String(now.judged.trial)) {
      said.dataset.trial = now.judged.trial;
      said.textContent = now.judged.lines.join("\n");
      drawBeside(beside, now.judged.curves);
    }
    dirty = true;
  }

  function newSamples(buffer) {
    if (!ring) return;
    const first = new DataView(buffer).getFloat64(0, true);
    ring.take(first, new Float32Array(buffer, 8));
    if (!paused) dirty = true;
  }

  /** By itself, or from–to as typed. */
  function scaleOf(channel, i) {
    const low = make("input", { type: "number", step: "any", "aria-label": `${channel.title}, lower end, ${channel.unit}` }), high = make("input", { type: "number", step: "any", "aria-label": `${channel.title}, upper end, ${channel.unit}` });
    const take = () => { scale[i] = low.value !== "" && high.value !== "" && Number(low.value) < Number(high.value) ? [Number(low.value), Number(high.value)] : null; dirty = true; };
    low.oninput = high.oninput = take;
    return make("span", { class: "scale" }, `${channel.title}: `, low, " to ", high, ` ${channel.unit} `);
  }

  /** Least and largest value of each column of pixels, for every channel. */
  function picture() {
    if (!ring || !seen) return null;
    const width = canvas.width - 2 * LEFT_PX, rate = seen.rate_hz, n = Math.round(length * rate), end = paused ? frozen : ring.end;
    const low = [], high = [];
    for (let c = 0; c < ring.columns; c++) {
      const least = new Float32Array(width).fill(NaN), most = new Float32Array(width).fill(NaN);
      for (let x = 0; x < width; x++) {
        const from = end - n + Math.floor(x * n / width), to = Math.max(from + 1, end - n + Math.floor((x + 1) * n / width));
        let a = Infinity, b = -Infinity;
        for (let k = Math.max(from, 0, ring.end - ring.size); k < to && k < ring.end; k++) {
          const value = ring.values[(k % ring.size) * ring.columns + c];
          if (value < a) a = value;
          if (value > b) b = value;
        }
        if (a <= b) { least[x] = a; most[x] = b; }
      }
      low.push(least);
      high.push(most);
    }
    return { low, high, end, last: Array.from({ length: ring.columns }, (_, c) => ring.get(end - 1, c)) };
  }

  function draw() {
    const ratio = Math.min(devicePixelRatio, 2), wide = Math.max(300, Math.round(canvas.clientWidth * ratio)), strip = Math.round(STRIP_PX * ratio);
    if (ring && (canvas.width !== wide || canvas.height !== strip * ring.columns)) { canvas.width = wide; canvas.height = strip * ring.columns; held = null; hold.setAttribute("aria-pressed", "false"); }
    const now = picture(), pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink"), soft = style.getPropertyValue("--soft"), line = style.getPropertyValue("--line");
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (!now) return;
    pen.font = `${13 * ratio}px system-ui, sans-serif`;
    seen.channels.forEach((channel, c) => {
      const top = c * strip, head = 18 * ratio, room = strip - 22 * ratio;
      let [from, to] = scale[c] || [Infinity, -Infinity];
      if (!scale[c]) for (const one of [now, held].filter(Boolean)) for (let x = 0; x < one.low[c]?.length; x++) { if (one.low[c][x] < from) from = one.low[c][x]; if (one.high[c][x] > to) to = one.high[c][x]; }
      if (!(from < to)) { const middle = Number.isFinite(from) ? from : 0; from = middle - 0.5; to = middle + 0.5; }
      const y = (value) => top + head + room * (1 - (value - from) / (to - from));
      pen.strokeStyle = line;
      pen.strokeRect(LEFT_PX, top + head, canvas.width - 2 * LEFT_PX, room);
      pen.save();
      pen.beginPath();
      pen.rect(LEFT_PX, top + head - 1, canvas.width - 2 * LEFT_PX, room + 2);
      pen.clip();
      for (const [one, color] of [[held, soft], [now, channel.color || ink]]) {
        if (!one || !one.low[c]) continue;
        pen.fillStyle = color; // a bar a column, to where it meets its neighbour: quicker than a path of so many corners
        let before = NaN, after = NaN;
        for (let x = 0; x < one.low[c].length; x++) {
          if (Number.isNaN(one.low[c][x])) { before = after = NaN; continue; }
          const upper = y(one.high[c][x]), lower = y(one.low[c][x]);
          const a = Number.isNaN(after) ? upper : Math.min(upper, after), b = Number.isNaN(before) ? lower : Math.max(lower, before);
          pen.fillRect(LEFT_PX + x, a - 0.7, 1, b - a + 1.4);
          before = upper;
          after = lower;
        }
      }
      pen.restore();
      pen.fillStyle = ink;
      pen.fillText(`${channel.title}  ${Number.isFinite(now.last[c]) ? now.last[c].toFixed(2) : "–"} ${channel.unit}`, LEFT_PX, top + 13 * ratio);
      pen.fillStyle = soft;
      pen.textAlign = "right";
      pen.fillText(`${from.toPrecision(3)} to ${to.toPrecision(3)} ${channel.unit}`, canvas.width - LEFT_PX, top + 13 * ratio);
      pen.textAlign = "left";
    });
    const { rate_hz: rate, planned_s } = seen;
    const planned = seen.trial <= seen.trials ? ` of ${seen.trials}` : "";
    told.textContent = `${state.recording ? "trial" : "last: trial"} ${seen.trial}${planned}${seen.condition ? `, ${seen.condition}` : ""}, ${(now.end / rate).toFixed(1)} s${planned_s ? ` of ${planned_s.toFixed(1)} s` : ""}${ring.lost ? `, ${ring.lost} samples not seen here` : ""}`;
    bar.hidden = !state.recording || !planned_s;
    bar.value = Math.min(now.end / rate / (planned_s || 1), 1);
    canvas.dataset.samples = now.end;
    canvas.dataset.last = now.last[0];
    canvas.dataset.drawn = performance.timeOrigin + performance.now();
  }

  const tick = () => {
    if (closed) return;
    if (dirty) { dirty = false; draw(); }
    requestAnimationFrame(tick);
  };
  connect();
  tick();
  main.dataset.ready = "true";
  return () => { closed = true; clearTimeout(timer); document.removeEventListener("keydown", keys); removeEventListener("resize", resized); socket?.close(); delete main.dataset.ready; };
}
