// Files that are dropped on the page, or chosen: once their new folder's name is confirmed they are copied, then opened.
import { load, on, post, Refusal, store } from "./store.js";
import { button, element, row } from "./fields.js";

const box = document.getElementById("adding"), chosen = element("input", { type: "file", multiple: true, hidden: true });
const name = element("input", { type: "text", autocomplete: "off", spellcheck: false, required: true });
const what = element("p", {}), where = element("p", { className: "note" }), left = element("p", { className: "note" });
const bar = element("progress", { max: 1, value: 0, hidden: true, data: { "aria-label": "Copied" } }), said = element("p", { className: "bad", role: "alert" });
const go = element("button", { type: "submit", className: "main", textContent: "Copy and open" }), cancel = button("Cancel", () => stop());
const form = element("form", {}, row("Its name", name), where, what, left, bar, said, element("div", { className: "buttons" }, go, cancel));
let files = [], sending = null, stopped = false;
box.append(element("h2", { id: "adding-title", textContent: "A new folder" }), form);
document.getElementById("add").addEventListener("click", () => chosen.click());
document.body.append(chosen);
chosen.addEventListener("change", () => { const all = [...chosen.files]; chosen.value = ""; offer(all); });

const size = (n) => (n >= 1e8 ? `${(n / 1e9).toFixed(2)} GB` : `${(n / 1e6).toFixed(2)} MB`);
const known = (f) => store.state.known.some((s) => f.name.toLowerCase().endsWith(s));
const total = () => files.reduce((n, f) => n + f.size, 0);

function offer(all, folder = "") {
  if (!all.length || sending) return;
  files = all.filter(known);
  const unknown = all.filter((f) => !known(f)).map((f) => f.name);
  name.value = folder || files[0]?.name.replace(/\.\w+$/, "") || "";
  what.textContent = files.length ? `${files.length === 1 ? files[0].name : `${files.length} files`}, ${size(total())}. Nothing that exists is changed.` : "No file here can be read.";
  left.textContent = unknown.length ? `Left out, as their kind is not known: ${unknown.slice(0, 6).join(", ")}${unknown.length > 6 ? ", ..." : ""}. Known: ${store.state.known.join(" ")}` : "";
  go.disabled = !files.length;
  bar.hidden = true;
  said.textContent = "";
  place();
  if (!box.open) box.showModal();
  name.select();
}
const place = () => { where.textContent = `In ${store.state.beside}`; };

const send = (file, before) => new Promise((done, failed) => { // by pieces, as the browser reads them
  const ask = sending = new XMLHttpRequest();
  ask.open("POST", `api/add/file/${encodeURIComponent(file.name)}`);
  ask.setRequestHeader("Content-Type", "application/octet-stream");
  ask.upload.addEventListener("progress", (e) => { bar.value = before + e.loaded; });
  ask.addEventListener("load", () => (ask.status === 200 ? done() : failed(new Refusal(JSON.parse(ask.responseText).problems))));
  for (const end of ["error", "abort"]) ask.addEventListener(end, () => failed(new Refusal([end === "abort" ? "stopped" : `${file.name}: it could not be copied`])));
  ask.send(file);
});

form.addEventListener("submit", async (e) => {
  e.preventDefault();
  said.textContent = "";
  stopped = false;
  go.disabled = name.disabled = true;
  let begun = false;
  try {
    await post("api/add", { folder: name.value, files: Object.fromEntries(files.map((f) => [f.name, f.size])) });
    begun = true;
    Object.assign(bar, { max: total() || 1, value: 0, hidden: false });
    let before = 0;
    for (const f of files) {
      if (stopped) throw new Refusal(["stopped"]);
      await send(f, before);
      before += f.size;
    }
    const state = await post("api/add/end");
    box.close();
    load(state);
  } catch (error) {
    const end = begun ? await post("api/add/stop").catch(() => null) : null; // it knows more than a connection that broke
    said.textContent = stopped ? "Stopped; what was copied is removed." : end?.problem || (error.problems ?? [String(error)]).join("\n");
    bar.hidden = true;
  } finally {
    sending = null;
    go.disabled = name.disabled = false;
  }
});
function stop() {
  if (!sending) { box.close(); return; }
  stopped = true;
  sending.abort();
}
box.addEventListener("cancel", (e) => { if (sending) { e.preventDefault(); stop(); } });

// What is dropped: files, or a folder with its files.
const listed = (reader) => new Promise((done, failed) => reader.readEntries(done, failed));
const file = (entry) => new Promise((done, failed) => entry.file(done, failed));
async function inside(folder) {
  const reader = folder.createReader(), out = [];
  for (let some = await listed(reader); some.length; some = await listed(reader)) out.push(...some);
  return Promise.all(out.filter((e) => e.isFile && !e.name.startsWith(".")).map(file));
}
const carries = (e) => [...e.dataTransfer?.types ?? []].includes("Files");
addEventListener("dragover", (e) => { if (carries(e)) { e.preventDefault(); document.body.classList.add("dropping"); } });
addEventListener("dragleave", (e) => { if (!e.relatedTarget) document.body.classList.remove("dropping"); });
addEventListener("drop", async (e) => {
  if (!carries(e)) return;
  e.preventDefault();
  document.body.classList.remove("dropping");
  const entries = [...e.dataTransfer.items].map((i) => i.webkitGetAsEntry?.()), plain = [...e.dataTransfer.files];
  const folders = entries.filter((f) => f?.isDirectory);
  if (!folders.length) { offer(plain); return; }
  const single = plain.filter((_, i) => !entries[i]?.isDirectory), all = (await Promise.all(folders.map(inside))).flat();
  offer([...single, ...all].sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true })), folders[0].name);
});
on("state", place);
