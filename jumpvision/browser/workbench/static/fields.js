// Labelled controls, made once; each shows what the store holds whenever that changes.
import { emit, mine, on, picks, setPick, setValue, store, value } from "./store.js";

export function element(name, attributes = {}, ...children) {
  const { data, ...rest } = attributes, e = Object.assign(document.createElement(name), rest);
  for (const [k, v] of Object.entries(data ?? {})) e.setAttribute(k, v);
  e.append(...children);
  return e;
}

let count = 0;
export function row(words, input, note = "") {
  input.id ||= `field-${++count}`;
  const label = element("label", { htmlFor: input.id, textContent: words });
  return element("div", { className: "row" }, label, input, ...(note ? [element("span", { className: "note", textContent: note })] : []));
}

export const button = (words, work, className = "") => {
  const b = element("button", { type: "button", textContent: words, className });
  b.addEventListener("click", work);
  return b;
};

const number = (text) => { const v = Number(text.replace(",", ".")); return text.trim() === "" || !Number.isFinite(v) ? null : v; };
const shown = (v) => (v == null ? "" : String(Number(Number(v).toPrecision(7))));
const quiet = (input) => document.activeElement !== input;

// A number among the picks of the section, as a distance in mm.
export function pickNumber(key, words) {
  const input = element("input", { type: "text", inputMode: "decimal", autocomplete: "off" });
  input.dataset.pick = key;
  input.addEventListener("input", () => setPick(key, number(input.value)));
  on("state section", () => { input.value = shown(picks()[key]); });
  on("undone", () => { input.value = shown(picks()[key]); });
  return row(words, input);
}

// A key of experiment.toml. factor: of what is shown over what is written (1000 for mm).
export function valueNumber(section, key, words, { factor = 1, note = "", min = null, max = null, step = null, usual = "", whole = false } = {}) {
  const slider = min !== null, input = slider ? element("input", { type: "range", min, max, step }) : element("input", { type: "text", inputMode: "decimal", autocomplete: "off" });
  input.dataset.usual = usual;
  const read = slider && element("output", {});
  input.addEventListener("input", () => {
    const v = number(input.value);
    setValue(section, key, v === null ? null : whole ? Math.round(v) : v / factor);
    if (read) read.textContent = input.value;
  });
  on("state preview section", () => {
    if (!quiet(input)) return;
    const v = mine(section, key) ?? value(section, key);
    input.value = v == null ? input.dataset.usual ?? "" : shown(v * factor);
    if (read) read.textContent = input.value;
  });
  const made = row(words, input, note);
  if (read) made.insertBefore(read, input);
  return { made, input };
}

export function valueChoice(section, key, words, choices, usual) {
  const select = element("select", {}, ...choices.map(([v, t]) => element("option", { value: v, textContent: t })));
  select.addEventListener("change", () => setValue(section, key, select.value));
  on("state preview section", () => { select.value = mine(section, key) ?? value(section, key) ?? usual; });
  return row(words, select);
}

// A place on the film: clicked, or typed as numbers with commas between them.
export function place(key, words, numbers, hint, drag = false) {
  const input = element("input", { type: "text", autocomplete: "off", placeholder: numbers === 1 ? "row" : numbers === 2 ? "column, row" : "x, y, x, y" });
  const arm = button(drag ? "Draw" : "Click", () => take({ key, numbers, hint, drag }));
  arm.setAttribute("aria-label", `${words}: ${drag ? "draw" : "click"} it on the film`);
  arm.dataset.tool = key;
  input.addEventListener("change", () => {
    const v = input.value.split(/[,;\s]+/).filter(Boolean).map(Number);
    if (v.some((a) => !Number.isFinite(a))) return;
    setPick(key, v.length === 0 ? null : numbers === 1 ? v[0] : v);
  });
  const made = element("div", { className: "tool" }, row(words, input));
  made.firstChild.append(arm);
  on("state section draft tool", () => {
    if (quiet(input)) input.value = [picks()[key] ?? []].flat().map((v) => Math.round(v * 10) / 10).join(", ");
    made.classList.toggle("active", store.tool?.key === key);
    arm.setAttribute("aria-pressed", String(store.tool?.key === key));
  });
  return made;
}

export function take(tool) {
  store.tool = store.tool && tool && store.tool.key === tool.key ? null : tool;
  if (store.tool) document.getElementById("screen").scrollIntoView({ block: "nearest" }); // on a tablet it may lie above
  emit("tool");
}
