// Jumps kept in this browser: their links by name. Where the browser keeps nothing they last as long as the page.
import { t } from "../words.js";

const KEY = "jumpvision-demo-saved";

export class Saved {
  constructor(list, open) {
    Object.assign(this, { list, open, jumps: [] });
    try { this.jumps = JSON.parse(localStorage.getItem(KEY) ?? "[]").filter((j) => typeof j.name === "string" && typeof j.link === "string"); } catch { /* none */ }
  }

  add(name, link) {
    this.jumps = [{ name, link }, ...this.jumps.filter((j) => j.link !== link)].slice(0, 20);
    this.keep();
  }

  keep() {
    try { localStorage.setItem(KEY, JSON.stringify(this.jumps)); } catch { /* the page's own memory remains */ }
    this.show();
  }

  show() {
    this.list.replaceChildren(...this.jumps.map((jump) => {
      const item = document.createElement("li"), go = document.createElement("button"), away = document.createElement("button");
      Object.assign(go, { type: "button", textContent: jump.name, onclick: () => this.open(jump.link) });
      Object.assign(away, { type: "button", textContent: "×", onclick: () => { this.jumps = this.jumps.filter((j) => j !== jump); this.keep(); } });
      away.setAttribute("aria-label", t("forget", { name: jump.name }));
      item.append(go, away);
      return item;
    }));
  }
}
