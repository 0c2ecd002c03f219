// All experiments of a campaign in one table: a picture, the jump, its height, what the model misses, what stands out.
import { attempt, get, on, store } from "./store.js";
import { button, element } from "./fields.js";
import { axis, colour, curve } from "./flow_plot.js";

const box = document.getElementById("glance"), sheet = box.querySelector(".sheet"), said = document.getElementById("glance-said"), begin = document.getElementById("glance-open");
let open = () => {};
export const onOpen = (work) => { open = work; };

function line([t, y]) { // a small trajectory
  if (!t.length) return "";
  const low = Math.min(...y), high = Math.max(...y), x = (v) => (118 * (v - t[0]) / (t.at(-1) - t[0] || 1) + 1).toFixed(1), at = (v) => (42 - 40 * (v - low) / (high - low || 1)).toFixed(1);
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), path = document.createElementNS(svg.namespaceURI, "polyline");
  svg.setAttribute("viewBox", "0 0 120 44");
  svg.setAttribute("aria-hidden", "true");
  path.setAttribute("points", t.map((v, i) => `${x(v)},${at(y[i])}`).join(" "));
  svg.append(path);
  return svg;
}

// Why one stands out: residual, frame and logs side by side, with one line at the time of the greatest residual.
let plots = [];
const panel = element("section", { id: "why", hidden: true, data: { "aria-labelledby": "why-title" } });
sheet.before(panel);
function plotted(words, unit, t, y, at, range) {
  const holder = element("figure", {}, element("figcaption", { textContent: `${words} [${unit}]` })), mark = colour("--hand");
  panel.querySelector(".panels").append(holder);
  return () => plots.push(new uPlot({ width: holder.clientWidth || 320, height: 200, legend: { show: false }, cursor: { show: false },
    scales: { x: { time: false, range } }, axes: [axis("time [s]", 34), { ...axis("", 50), label: undefined }], series: [{}, curve("--trace")],
    hooks: { draw: [(u) => { const x = u.valToPos(at, "x", true); u.ctx.fillStyle = mark; u.ctx.fillRect(x, u.bbox.top, 2, u.bbox.height); }] } }, [t, y], holder));
}
async function why(name) {
  const w = await attempt(() => get(`api/why/${encodeURIComponent(name)}`));
  for (const p of plots) p.destroy();
  plots = [];
  panel.hidden = false;
  if (!w) { panel.replaceChildren(element("p", { className: "bad", textContent: document.getElementById("trouble").textContent })); return; }
  store.why = w;
  const range = [w.t[0], w.t.at(-1)], what = w.simulated ? "measured − simulated" : "height (nothing was simulated)";
  panel.replaceChildren(element("h3", { id: "why-title", textContent: `${name}: ${w.simulated ? "greatest residual" : "greatest height"} ${mm(w.greatest)} mm at ${w.at.toFixed(3)} s` }),
    ...w.causes.map((c) => element("p", { className: "cause", textContent: c[0].toUpperCase() + c.slice(1) + "." })),
    element("p", { className: "note", textContent: w.says.join(" · ") }), element("div", { className: "panels" }));
  const draw = [plotted(what, "mm", w.t, w.y.map((v) => 1e3 * v), w.at, range)];
  if (w.frame !== null) {
    const picture = element("img", { src: `small/${encodeURIComponent(name)}/${w.frame}.jpg`, alt: `Frame ${w.frame} of the film` });
    panel.querySelector(".panels").append(element("figure", {}, element("figcaption", { textContent: `frame ${w.frame}` }), picture));
  }
  for (const l of w.logs.filter((g) => g.t.length && g.section !== "rod_track")) draw.push(plotted(l.column.replace(/_.*/, "") + ` (${l.section})`, l.column.endsWith("_m") ? "mm" : "1", l.t, l.y.map((v) => (l.column.endsWith("_m") ? 1e3 * v : v)), w.at, range));
  for (const d of draw) d(); // once all have their width
  panel.scrollIntoView({ block: "nearest" });
}
const mm = (v, digits = 2) => (v === null ? "" : (1e3 * v).toFixed(digits));
function height({ height: h, sigma: s }) { // as many digits as its uncertainty has
  if (h === null) return "";
  if (!(s > 0)) return mm(h);
  const digits = Math.max(0, 1 - Math.floor(Math.log10(1e3 * s)));
  return `${mm(h, digits)} ± ${mm(s, digits)}`;
}

export async function glance() {
  box.showModal();
  said.textContent = "reading ...";
  const rows = await attempt(() => get("api/glance"));
  if (!rows) { box.close(); return; }
  const odd = rows.filter((r) => r.odd).length, known = rows.filter((r) => r.height !== null).length;
  said.textContent = `${rows.length} experiments, ${known} with a height, ${odd} that stand out${odd ? ": they come first" : ""}.${known ? "" : " Run the campaign to measure them."}`;
  const head = ["Film", "Height over time", "Experiment", "Kind", "Height [mm]", "Model − measured [mm]", "Stands out", "Why"];
  panel.hidden = true;
  sheet.replaceChildren(element("table", {}, element("thead", {}, element("tr", {}, ...head.map((h) => element("th", { textContent: h, scope: "col" })))),
    element("tbody", {}, ...rows.map((r) => element("tr", { className: r.odd ? "odd" : "" },
      element("td", {}, r.pictured ? element("img", { src: `small/${encodeURIComponent(r.experiment)}.jpg`, alt: "", loading: "lazy" }) : ""),
      element("td", {}, line(r.trace)),
      element("td", {}, button(r.experiment, () => { box.close(); open(r.experiment); })),
      ...[r.kind?.replaceAll("_", " ") ?? "", height(r), r.missed === null ? "" : (r.missed > 0 ? "+" : "") + mm(r.missed), r.odd].map((textContent) => element("td", { textContent })),
      element("td", {}, r.trace[0].length ? button("Why", () => why(r.experiment)) : ""))))));
  for (const b of sheet.querySelectorAll("td:last-child button")) b.setAttribute("aria-label", `Why ${b.closest("tr").querySelector("button").textContent}`);
}
begin.addEventListener("click", glance);
on("state", () => { begin.hidden = store.state.experiments.length < 2; });
