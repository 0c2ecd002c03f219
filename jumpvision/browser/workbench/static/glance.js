// All experiments of a campaign in one table: a picture, the jump, its height, what the model misses, what stands out.
import { attempt, get, on, store } from "./store.js";
import { button, element } from "./fields.js";

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
  const head = ["Film", "Height over time", "Experiment", "Kind", "Height [mm]", "Model − measured [mm]", "Stands out"];
  sheet.replaceChildren(element("table", {}, element("thead", {}, element("tr", {}, ...head.map((h) => element("th", { textContent: h, scope: "col" })))),
    element("tbody", {}, ...rows.map((r) => element("tr", { className: r.odd ? "odd" : "" },
      element("td", {}, r.pictured ? element("img", { src: `small/${encodeURIComponent(r.experiment)}.jpg`, alt: "", loading: "lazy" }) : ""),
      element("td", {}, line(r.trace)),
      element("td", {}, button(r.experiment, () => { box.close(); open(r.experiment); })),
      ...[r.kind?.replaceAll("_", " ") ?? "", height(r), r.missed === null ? "" : (r.missed > 0 ? "+" : "") + mm(r.missed), r.odd].map((textContent) => element("td", { textContent })))))));
}
begin.addEventListener("click", glance);
on("state", () => { begin.hidden = store.state.experiments.length < 2; });
