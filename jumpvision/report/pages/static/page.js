"use strict";
// A figure: its panels, legend, the button back to the whole, and the table behind; one for each JSON in the page.
class Chart {
  constructor(figure) {
    const spec = JSON.parse(figure.querySelector("script").textContent), body = document.createElement("div");
    this.hidden = new Set();
    const series = spec.panels.flatMap((p) => p.series).filter((s) => s.kind !== "map");
    const names = new Map(spec.legend?.map((s) => [s.name, s]) ?? series.map((s) => [s.name, s]));
    body.innerHTML = `<div class="tools"><div class="legend" role="group" aria-label="Shown"></div>
      <button type="button" class="reset" hidden>Show all</button></div><div class="panels"></div>`;
    figure.append(body);
    this.reset = body.querySelector(".reset");
    this.reset.onclick = () => this.range(null, null);
    this.panels = spec.panels.map((p) => {
      const host = body.querySelector(".panels").appendChild(document.createElement("div"));
      host.className = "panel";
      host.style.setProperty("--share", p.share ?? 1);
      return new Panel(this, p, host);
    });
    if (spec.stacked) body.querySelector(".panels").classList.add("stacked");
    this.linked = spec.stacked;
    if (names.size > 1) for (const [name, s] of names) body.querySelector(".legend").append(this.button(name, s));
    body.append(table(spec));
    this.body = body;
    new ResizeObserver(() => { // of a height that its own drawing made: no
      if (body.clientWidth === this.width) return;
      this.width = body.clientWidth;
      this.draw();
    }).observe(body);
  }

  draw() { for (const p of this.panels) { p.draw(); if (p.cursor) p.show(null); } }

  button(name, s) {
    const b = document.createElement("button"), r = { square: "0", triangle: "0" }[s.mark] ?? "50%";
    const shape = s.kind === "line" ? `height:0;border-radius:0;border-width:2px 0 0;border-style:${s.dash ? "dashed" : "solid"}` : `border-radius:${r}`;
    const cut = s.mark === "triangle" && !s.hollow ? ";clip-path:polygon(50% 0,100% 100%,0 100%)" : "";
    const small = s.size && s.size < 4 ? ";transform:scale(.6)" : "";
    b.type = "button";
    b.setAttribute("aria-pressed", "true");
    b.innerHTML = `<i style="border-color:${paint(s)};background:${s.hollow ? "none" : paint(s)};${shape}${cut}${small}"></i>${esc(name)}`;
    b.onclick = () => {
      const off = b.getAttribute("aria-pressed") === "true";
      b.setAttribute("aria-pressed", String(!off));
      this.hidden[off ? "add" : "delete"](name);
      this.draw();
    };
    return b;
  }

  // Zoom of a panel, in x of all where they share it; null: everything.
  range(panel, zoom) {
    for (const p of this.panels) if (!panel || p === panel || this.linked) p.zoom = zoom;
    this.draw();
  }

  // What a panel's cursor reads; the same x in the panels that share it.
  point(panel, place) {
    panel.show(place);
    if (this.linked) for (const p of this.panels) if (p !== panel) p.show(place ? p.read(place[0], 0) : null);
  }
}

// The numbers behind a figure, made when it is opened: a table a panel, series over the same x side by side.
function tables(spec) {
  return spec.panels.map((p) => {
    if (p.series[0]?.kind === "map") {
      const s = p.series[0];
      return { title: p.title, head: [`${words(p.y)} \\ ${words(p.x)}`, ...(p.x.names ?? s.x.map((v) => said(v)))], rows: s.z.map((row, j) => [p.y.names?.[j] ?? s.y[j], ...row]) };
    }
    const parts = p.series.map((s) => (s.kind === "bars" ? { ...s, x: s.y.map((i) => p.y.names[i]), y: s.x } : s));
    const same = parts.every((s) => s.x.length === parts[0].x.length && s.x.every((v, i) => v === parts[0].x[i]));
    const [x, y] = parts[0]?.kind === "bars" ? [p.y, p.x] : [p.x, p.y];
    if (same) {
      const label = parts[0]?.label, last = parts[0]?.kind === "bars", column = (is, v) => (label && is ? [v] : []);
      return { title: p.title, head: [...column(!last, "name"), words(x), ...parts.flatMap((s) => [y.unit ? `${s.name} [${y.unit}]` : s.name, ...(s.s ? ["σ"] : [])]), ...column(last, "details")],
        rows: (parts[0]?.x ?? []).map((v, i) => [...column(!last, label?.[i]), v, ...parts.flatMap((s) => [s.y[i], ...(s.s ? [s.s[i]] : [])]), ...column(last, label?.[i])]) };
    }
    const named = parts.some((s) => s.label), sure = parts.some((s) => s.s), cells = (s, i, v) => [s.name, ...(named ? [s.label?.[i] ?? ""] : []), v, s.y[i], ...(sure ? [s.s?.[i] ?? null] : [])];
    return { title: p.title, head: ["series", ...(named ? ["name"] : []), words(x), words(y), ...(sure ? ["σ"] : [])], rows: parts.flatMap((s) => s.x.map((v, i) => cells(s, i, v))) };
  });
}

function table(spec) {
  const out = document.createElement("details"), csv = (v) => (/[",\n]/.test(v) ? `"${String(v).replaceAll('"', '""')}"` : v ?? "");
  out.className = "data";
  out.innerHTML = "<summary>Table</summary>";
  out.addEventListener("toggle", () => {
    if (out.children.length > 1) return;
    for (const t of tables(spec)) {
      const text = [t.head, ...t.rows].map((r) => r.map(csv).join(",")).join("\n"), part = document.createElement("div");
      const cell = (v) => (typeof v === "number" ? said(v, 6) : esc(v ?? ""));
      part.innerHTML = `<p class="part">${esc(t.title)} <a download="${esc(t.title.replaceAll(/[^\w]+/g, "_"))}.csv" href="data:text/csv;charset=utf-8,${encodeURIComponent(text)}">save as CSV</a></p>
        <div class="wide low" tabindex="0"><table><thead><tr>${t.head.map((h) => `<th scope="col">${esc(h)}</th>`).join("")}</tr></thead>
        <tbody>${t.rows.map((r) => `<tr>${r.map((v) => `<td>${cell(v)}</td>`).join("")}</tr>`).join("")}</tbody></table></div>`;
      out.append(part);
    }
  });
  return out;
}

const charts = [...document.querySelectorAll("figure.chart")].map((figure) => new Chart(figure));
const redraw = () => { for (const c of charts) c.draw(); };
addEventListener("beforeprint", () => { // paper has no folds
  for (const fold of document.querySelectorAll("details.fold")) fold.open = true;
  redraw();
});
// A canvas holds its colours: drawn anew for paper, and where the screen turns dark.
for (const media of ["print", "(prefers-color-scheme: dark)"]) matchMedia(media).addEventListener("change", redraw);
