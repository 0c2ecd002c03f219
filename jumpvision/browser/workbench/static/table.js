// All columns of the track, a row a frame: read, copied, saved. Only the rows in sight are in the page.
import { on, store } from "./store.js";
import { button, element } from "./fields.js";
import { seek } from "./player.js";

const HEIGHT = 26; // px of a row
const head = element("thead", {}), body = element("tbody", {}), said = element("span", { className: "note", data: { "aria-live": "polite" } });
const frame = element("div", { className: "sheet", id: "sheet", tabIndex: 0, data: { role: "region", "aria-label": "Table of the track" } },
  element("table", {}, element("caption", { textContent: "A row a frame; a number has the digits of the track's file." }), head, body));
export const table = element("div", {}, element("div", { className: "buttons" }, button("Copy", () => copy()), button("Save as CSV", () => save()), said), frame);

const names = () => Object.keys(store.columns?.table ?? {});
const cell = (v) => (v === null ? "" : String(v));
const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
export function text(by, form = (t) => t) {
  const t = store.columns.table, n = t.frame.length, keys = names();
  return [keys, ...Array.from({ length: n }, (_, i) => keys.map((k) => form(cell(t[k][i]))))].map((r) => r.join(by)).join("\n") + "\n";
}

async function copy() {
  try {
    await navigator.clipboard.writeText(text("\t", (t) => t.replaceAll(/[\t\n]/g, " ")));
    said.textContent = `${store.columns.table.frame.length} rows copied.`;
  } catch { said.textContent = "The browser does not let a page copy; save as CSV."; }
}

function save() {
  const link = element("a", { href: URL.createObjectURL(new Blob([text(",", quoted)], { type: "text/csv" })), download: `${store.state.name}.csv` });
  link.click();
  URL.revokeObjectURL(link.href);
}

function draw() {
  if (!store.columns || !frame.clientHeight) return;
  const t = store.columns.table, keys = names(), n = t.frame.length;
  if (head.dataset.of !== keys.join()) {
    head.dataset.of = keys.join();
    head.replaceChildren(element("tr", {}, ...keys.map((k) => element("th", { scope: "col", textContent: k }))));
  }
  const first = Math.max(0, Math.floor(frame.scrollTop / HEIGHT) - 5), last = Math.min(n, first + Math.ceil(frame.clientHeight / HEIGHT) + 12);
  const gap = (rows) => element("tr", { data: { "aria-hidden": "true" } }, element("td", { colSpan: keys.length, style: `height:${rows * HEIGHT}px;padding:0;border:0` }));
  body.replaceChildren(...(first ? [gap(first)] : []), ...Array.from({ length: last - first }, (_, k) => {
    const i = first + k, tr = element("tr", { className: t.frame[i] === store.frame ? "now" : "" }, ...keys.map((c) => element("td", { textContent: cell(t[c][i]) })));
    tr.addEventListener("click", () => seek(t.frame[i]));
    return tr;
  }), ...(last < n ? [gap(n - last)] : []));
}

frame.addEventListener("scroll", draw);
new ResizeObserver(draw).observe(frame);
on("columns frame plot", draw);
