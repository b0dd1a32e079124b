// An exported animation: the page's own player, drawing and forces, with its data in the file.
import { Drawing } from "./drawing.js";
import { make } from "./elements.js";
import { unpack } from "./numbers.js";
import { KEYS, Player } from "./player.js";
import { Strip } from "./strip.js";

const data = JSON.parse(document.getElementById("data").textContent), main = document.querySelector("main");
const drawings = data.drawings.map(({ title, drawing }) => new Drawing(drawing, title, { forces: true }));
const opened = (curve) => ({ ...curve, time: unpack(curve.time_s), value: unpack(curve.value) });
const curves = data.curves.map((curve) => ({ ...opened(curve), beside: curve.beside ? opened(curve.beside) : null }));
const [from, to] = data.span_s, wanted = /t=(-?[0-9.]+)/.exec(location.hash);
const strip = new Strip(curves, { from, to, pick: (t) => { player.run(false); player.go(t); } });
const player = new Player({
  from, to, at: wanted ? Number(wanted[1]) : data.start_s, steps: null, events: data.events,
  show: (t) => { for (const drawing of drawings) drawing.at(t); strip.at(t); },
});
main.append(player.element, make("div", { class: drawings.length > 1 ? "pair" : "" }, ...drawings.map((drawing) => drawing.element)), strip.element, make("p", { class: "hint" }, KEYS));
player.draw();
if (!wanted) player.run(true);
main.dataset.ready = "true";
window.benchPlayer = player; // for tests of the page
