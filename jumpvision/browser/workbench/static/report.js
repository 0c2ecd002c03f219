// Step 5, after a run: its report inside the page, and its warnings, each with the frame or the recording that it means.
import { attempt, emit, get, on, store } from "./store.js";
import { button, element } from "./fields.js";
import { seek } from "./player.js";

const box = document.getElementById("step-run"), stage = document.getElementById("stage");
const frame = element("iframe", { id: "report", title: "Report of the last run", hidden: true });
stage.append(frame);
const toggle = button("Show the report", () => show(frame.hidden)), alone = element("a", { textContent: "in a window of its own", target: "_blank", rel: "noopener" });
const said = element("p", { className: "note", data: { "aria-live": "polite" } }), list = element("ul", { className: "list warnings" });
const part = element("section", { id: "earlier", hidden: true }, element("h3", { textContent: "The last run" }), element("div", { className: "buttons" }, toggle, alone), said, list);
box.append(part);
let jump = () => {};
export const onJump = (work) => { jump = work; }; // to a film, by its section

function show(on) {
  if (on) frame.src = address();
  frame.hidden = !on;
  toggle.textContent = on ? "Show the film" : "Show the report";
  stage.classList.toggle("reported", on);
}
const address = () => `report/${store.state.experiments.length > 1 ? `${encodeURIComponent(store.state.name)}/` : ""}report.html`;

function go(w) {
  show(false);
  if (w.recording !== store.section && store.state.films.some((f) => f.section === w.recording)) jump(w.recording);
  if (Number.isInteger(w.values?.frame)) seek(w.values.frame);
}

export async function look() {
  const e = await attempt(() => get("api/earlier"));
  if (!e) return;
  store.earlier = e;
  part.hidden = !e.report && !e.held.length && !e.changed.length;
  toggle.hidden = alone.hidden = !e.report;
  alone.href = address();
  said.textContent = [e.held.length && `From the last run: ${e.held.join(", ")}.`, e.changed.length && `${e.changed.join(", ")}: what it rests on has changed since; run again.`,
    e.warnings.length ? "" : e.report && "No warnings."].filter(Boolean).join(" ");
  list.replaceChildren(...e.warnings.map((w) => {
    const here = store.state.films.some((f) => f.section === w.recording), at = w.values?.frame;
    return element("li", {}, element("span", { textContent: w.message }), ...(here ? [button(Number.isInteger(at) ? `Frame ${at}` : "Show it", () => go(w))] : []));
  }));
  emit("earlier");
}

on("fresh", () => show(false));
on("step", () => { if (store.step !== "run") show(false); });
on("ran", async () => { await look(); if (store.earlier?.report) show(true); });
