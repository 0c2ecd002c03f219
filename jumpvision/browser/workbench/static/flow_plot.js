// Step 4 of a flow: a profile along a line, how often each velocity is there, and both as tables of numbers.
import { on, setValue, store, value } from "./store.js";
import { button, element, row } from "./fields.js";
import { line, match } from "./flow.js";

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const box = document.getElementById("step-plot");
const draw = button("Draw a line", () => line(), "main"), typed = element("input", { type: "text", autocomplete: "off", placeholder: "x1, y1, x2, y2" });
draw.id = "line";
typed.addEventListener("change", () => {
  const v = typed.value.split(/[,;\s]+/).filter(Boolean).map(Number);
  if (v.length === 4 && v.every(Number.isFinite)) setValue("params.profiles", "lines", [v]);
});
const typedRow = row("From x, y to x, y", typed);
const along = element("div", { className: "plot", id: "profile", data: { role: "img" } }), often = element("div", { className: "plot", id: "counts-plot", data: { role: "img", "aria-label": "Histogram of u and v" } });
const note = element("p", { className: "note" });
const key = (...names) => element("p", { className: "key" }, ...names.map((n) => element("span", { textContent: n })));
const saved = (text, work) => { const b = button(text, work); b.dataset.save = text; return b; };
const content = element("div", { className: "flow-only" }, element("h2", { textContent: "Along a line" }), element("div", { className: "buttons" }, draw), typedRow, key("along the line", "across it"), along, note,
  element("h2", { textContent: "Histogram of u and v" }), key("u, to the right", "v, up"), often,
  element("div", { className: "buttons" }, saved("Save the map as CSV", () => save("map")), saved("Save the profile as CSV", () => save("profile"))));
box.append(content);

const label = (name, unit) => `${name} [${unit}]`;
export const axis = (text, size) => ({ label: text, labelSize: 20, size, stroke: colour("--ink"), font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif",
  grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line"), width: 1, size: 4 }, values: (_, v) => v.map((a) => (a === null ? "" : String(Number(a.toPrecision(6))))) });
const look = (width, height, x, y) => ({ width, height, legend: { show: false }, cursor: { show: false }, scales: { x: { time: false } }, axes: [axis(x, 34), axis(y, 62)] });
export const curve = (name, more = {}) => ({ stroke: colour(name), width: 2, points: { show: false }, ...more });
const hidden = { stroke: "transparent", points: { show: false } };

let plots = [];
export function show() {
  for (const p of plots) p.destroy();
  plots = [];
  const f = store.flow, here = store.section === "grain_video";
  document.getElementById("tab-check").hidden = here && !store.logs.length; // a flow alone has no log to move
  document.getElementById("tab-plot").hidden = !here && store.section !== "rod_video";
  if (!here || store.step !== "plot") return;
  for (const b of content.querySelectorAll("[data-save]")) b.disabled = !f || (b.dataset.save.includes("profile") && !f.profile.s);
  draw.disabled = !f;
  typedRow.firstChild.textContent = `From x, y to x, y${f ? ` [${f.length}]` : ""}`;
  if (document.activeElement !== typed) typed.value = (value("params.profiles", "lines")?.at(-1) ?? []).join(", ");
  along.hidden = !f?.profile.s;
  note.textContent = !f ? "Match a pair first." : f.profile.s ? "Unsmoothed vectors, with one sigma; “across” is to the left of the line's way. Drag an end of the line to move it." : "Drag a line through the flow: velocity along and across it.";
  if (!f) return;
  const width = content.clientWidth || 340, p = f.profile;
  if (p.s) {
    const off = (name, sign) => p[name].map((v, i) => (v === null || p[`${name}_sigma`][i] === null ? null : v + sign * p[`${name}_sigma`][i]));
    plots.push(new uPlot({ ...look(width, 260, label("s", f.length), label("velocity", f.speed)),
      series: [{}, hidden, hidden, curve("--trace"), hidden, hidden, curve("--hand")],
      bands: [{ series: [2, 1], fill: colour("--band") }, { series: [5, 4], fill: colour("--band-hand") }] },
      [p.s, off("along", -1), off("along", 1), p.along, off("across", -1), off("across", 1), p.across], along));
    along.setAttribute("aria-label", `Velocity along the line, ${p.s.length} places, from ${p.along[0]} to ${p.along.at(-1)} ${f.speed}`);
  }
  const [ue, uc] = f.counts.u, [ve, vc] = f.counts.v;
  if (!uc.length) return;
  const step = (edges, counts) => [edges, [...counts, 0]], joined = uPlot.join([step(ue, uc), step(ve, vc)]), stepped = uPlot.paths.stepped({ align: 1 });
  plots.push(new uPlot({ ...look(width, 190, label("velocity", f.speed), "vectors"),
    series: [{}, curve("--trace", { paths: stepped, spanGaps: true }), curve("--hand", { paths: stepped, spanGaps: true })] }, joined, often));
}

// What is shown, number by number as the server gave it.
function save(what) {
  const f = store.flow, [l, s] = [f.length, f.speed.replace("/", "_")], n = f.columns.length;
  const table = what === "profile" ? { names: Object.keys(f.profile), rows: f.profile.s.map((_, i) => Object.values(f.profile).map((c) => c[i])) }
    : { names: [`x_${l}`, `y_${l}`, `u_${s}`, `v_${s}`, `${f.name}_${f.unit.replaceAll("/", "_").replace("1_", "per_")}`, "reason"], rows: f.u.map((u, i) => [f.x[i % n], f.y[Math.floor(i / n)], u, f.v[i], f.values[i], f.reason[i]]) };
  const text = [table.names, ...table.rows].map((r) => r.map((v) => v ?? "").join(",")).join("\n") + "\n";
  const a = element("a", { href: URL.createObjectURL(new Blob([text], { type: "text/csv" })), download: what === "profile" ? "profile.csv" : `${f.name}.csv` });
  a.click();
  setTimeout(() => URL.revokeObjectURL(a.href), 1000);
}

on("pair section step profile logs", show);
on("step", () => { if (store.step === "plot" && store.section === "grain_video" && !store.flow) match(); });
new ResizeObserver(() => { if (plots.length && Math.abs(plots[0].width - content.clientWidth) > 1) show(); }).observe(content);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
