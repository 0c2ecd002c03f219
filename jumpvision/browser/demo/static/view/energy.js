// Bars of energy at the time shown, zero at 15 % of the width; the largest of the jump takes 45 %, its number the rest.
import { number, t } from "../words.js";

const NAMES = ["motor", "kinetic", "height", "spring", "taken"];

export class Energy {
  constructor(list) {
    this.rows = NAMES.map((name) => {
      const term = document.createElement("dt"), value = document.createElement("dd"), text = document.createElement("span"), bar = document.createElement("i");
      bar.className = name;
      value.append(bar, text);
      list.append(term, value);
      return { name, term, text, bar };
    });
  }

  draw(motion, bars, time) {
    const span = motion.t.at(-1) - motion.t[0], i = Math.round(((time - motion.t[0]) / span) * (motion.t.length - 1));
    if (this.of !== bars) {
      this.of = bars;
      this.most = Math.max(1e-9, ...NAMES.flatMap((n) => bars[n].map(Math.abs)));
    }
    for (const { name, term, text, bar } of this.rows) {
      const joule = bars[name][Math.min(Math.max(i, 0), motion.t.length - 1)], share = (45 * Math.abs(joule)) / this.most;
      term.textContent = t(`energy_${name}`);
      text.textContent = `${number(joule, Math.max(0, 2 - Math.floor(Math.log10(this.most))))}\u00a0J`;
      Object.assign(bar.style, { width: `${share}%`, left: joule < 0 ? `${Math.max(0, 15 - share)}%` : "15%" });
    }
  }
}
