// What was done on the page survives a reload: at once in the browser, and on the server, which lays it on the disk.
import { on, post, store } from "./store.js";

const name = () => `jumpvision ${store.state.folder} ${store.state.films.map((f) => f.file).join(" ")}`;
let due = 0, ready = false;

const page = () => ({ at: Date.now(), draft: store.draft, section: store.section, frame: store.frame, step: store.step, plot: store.plot });

function keep() {
  if (!ready || !store.state) return;
  try { localStorage.setItem(name(), JSON.stringify(page())); } catch { /* full or forbidden: the server keeps it */ }
  clearTimeout(due);
  due = setTimeout(() => post("api/keep", { page: page() }).catch(() => {}), 200);
}

// The page as it was left, of the two the newer one; null where there is none.
export function kept() {
  let here = null;
  try { here = JSON.parse(localStorage.getItem(name())); } catch { /* none */ }
  const there = store.state.kept;
  return (there?.at ?? 0) > (here?.at ?? 0) ? there : here;
}
export const begin = () => { ready = true; keep(); };
export const pause = () => { ready = false; };

addEventListener("pagehide", () => {
  if (!ready) return;
  const body = JSON.stringify({ page: page() });
  fetch("api/keep", { method: "POST", headers: { "Content-Type": "application/json" }, body, keepalive: body.length < 60_000 }).catch(() => {});
});
on("changed section frame step plot", keep);
