// The panel of a sealed world: recordings, the answer, and what the judge says. Its state lies in the page's:
// state.world = {number, laws, said}.
import page from "../page.js";
import { campaign, zip } from "../play/campaign.js";
import { EFFECTS, MOST, NOISE, NOTHING, REACH, choices, hidden, judged, keyOf, recording } from "../play/world.js";
import { number, t } from "../words.js";
import { at } from "./draw.js";

const FEW = 4; // jumps that a diagnosis needs
const KNOWN = 0.95, OPEN = 0.05; // shares of the evidence: an effect is shown, is not ruled out
const fine = (v) => `${number(v * 1e3, 2)}\u00a0mm`;
const make = (tag, props = {}, ...children) => {
  const node = Object.assign(document.createElement(tag), props);
  node.append(...children);
  return node;
};
const percent = (p) => (p > 0.999 ? `>\u00a0${number(99.9, 1)}` : p < 0.001 ? `<\u00a0${number(0.1, 1)}` : number(100 * p, p < 0.1 || p > 0.9 ? 1 : 0)) + "\u00a0%";
export const anyWorld = () => ({ number: 1 + Math.floor(Math.random() * 9999), laws: [], said: "" });

// An effect with its size: "extra mass on the motor, +85 g"; one at the end of what the judge looks at has no uncertainty.
function sized({ name, value, sigma }) {
  if (name === NOTHING) return t("e_nothing");
  const [, , strong, , unit, times] = EFFECTS[name], edge = Math.abs(value) >= 0.999 * REACH * strong, digits = (v) => Math.max(0, 2 - Math.floor(Math.log10(Math.abs(v * times) || 1)));
  const n = sigma ? digits(10 * sigma) : digits(value), shown = number(Math.abs(value) * times, n), about = sigma && !edge ? ` ± ${number(sigma * times, n)}` : "";
  return `${t(`e_${name}`)}, ${value < 0 ? "−" : "+"}${shown}${about}${unit && `\u00a0${unit}`}`;
}

export class Sealed {
  // on: law() the motor law now, show(law), changed() after the world has changed.
  constructor(root, on) {
    Object.assign(this, { root, on, tracks: new Map(), asked: "", judgement: null });
    root.onclick = (e) => this[e.target.closest("button[data-do]")?.dataset.do]?.(e.target.closest("button"));
  }

  // What the camera saw of the law now, if it was recorded: {t, x}.
  dots(state) {
    const key = keyOf(this.on.law());
    const law = state.world?.laws.find((l) => keyOf(l) === key);
    return law ? this.track(state, law) : null;
  }

  track({ ground, world }, law) {
    const key = `${ground} ${world.number} ${keyOf(law)}`;
    if (!this.tracks.has(key)) this.tracks.set(key, recording(ground, world.number, law));
    return this.tracks.get(key);
  }

  show(state, motion) {
    this.state = state;
    const { world, ground } = state, dots = this.dots(state), over = Boolean(world.said), full = world.laws.length >= MOST;
    const button = (name, props = {}, ...inside) => {
      const node = make("button", { type: "button", textContent: inside.length ? "" : t(name), ...props }, ...inside);
      node.dataset.do = name;
      return node;
    };
    const rows = world.laws.map((law, i) => {
      const b = button("pick", {}, t("recorded", { i: i + 1, how: law.hand ? t("by_hand") : `${number(law.actuation.frequency, 2)}\u00a0Hz, ${number(law.actuation.phase / Math.PI, 2)}\u00a0π` }));
      b.dataset.law = i;
      b.setAttribute("aria-pressed", String(dots !== null && keyOf(law) === keyOf(this.on.law())));
      return make("li", {}, b);
    });
    const select = make("select", { id: "said", disabled: over }, ...choices(ground).map((n) => make("option", { value: n, textContent: t(`e_${n}`), selected: n === (world.said || this.choice) })));
    select.onchange = () => { this.choice = select.value; };
    const focus = this.root.contains(document.activeElement) && (document.activeElement.dataset.do || document.activeElement.id);
    this.root.replaceChildren(
      make("p", {}, button("record", { disabled: over || full || dots !== null }), " ", button("another")),
      ...(rows.length ? [make("h2", { textContent: t("recordings") }), make("ul", { className: "laws" }, ...rows)] : []),
      ...(dots ? [make("p", { textContent: t("misfit", { n: dots.t.length, mm: fine(this.misfit(dots, motion)), noise: fine(NOISE) }) })] : []),
      make("p", {}, make("label", {}, t("answer"), " ", select), " ", button("open_seal", { disabled: over || !rows.length })),
      ...(over ? this.evidence(state) : []),
    );
    if (focus) (this.root.querySelector(`[data-do="${focus}"]:not(:disabled), #${focus}:not(:disabled)`) ?? this.root.querySelector("select, button:not(:disabled)"))?.focus();
  }

  // rms between dots and model [m], where the model is shown.
  misfit(dots, motion) {
    const end = motion.t.at(-1), seen = dots.t.map((s, i) => [s, dots.x[i]]).filter(([s]) => s >= motion.t[0] && s <= end);
    return Math.sqrt(seen.reduce((sum, [s, x]) => sum + (x - at({ t: motion.t, rod: motion.rod }, s).rod) ** 2, 0) / seen.length);
  }

  // The judgement of the recordings, asked for once; null until it is there.
  judge({ world, ground }) {
    const key = JSON.stringify([ground, world.number, world.laws.map(keyOf)]);
    if (this.asked !== key) {
      this.asked = key;
      this.judgement = null;
      const pause = () => new Promise((go) => setTimeout(go)), recordings = world.laws.map((law) => ({ law, ...this.track({ ground, world }, law) }));
      judged(ground, recordings, pause).then((found) => {
        if (this.asked !== key) return;
        this.judgement = found;
        this.on.changed();
      });
    }
    return this.judgement;
  }

  // What the judge says of the answer.
  sentence(state) {
    const { world, ground } = state;
    if (!world.said) return "";
    const found = this.judge(state), truth = hidden(ground, world.number), was = t("was", { what: sized(truth) });
    if (!found) return `${was} ${t("judging")}`;
    const mine = found.effects.find((e) => e.name === world.said), right = mine.name === truth.name;
    const word = right ? (mine.p >= KNOWN ? "right_known" : "right_lucky") : mine.p >= OPEN ? "wrong_open" : "wrong_known";
    return `${t(word, { p: percent(mine.p) })} ${was}`;
  }

  evidence(state) {
    const found = this.judge(state);
    if (!found) return [];
    const bars = found.effects.flatMap((e) => {
      const bar = make("i");
      bar.style.width = `${60 * e.p}%`;
      return [make("dt", { textContent: sized(e) }), make("dd", {}, bar, make("span", { textContent: percent(e.p) }))];
    });
    const button = (name, word, disabled = false) => {
      const node = make("button", { type: "button", textContent: t(word), disabled });
      node.dataset.do = name;
      return node;
    };
    const few = state.world.laws.length < FEW, asked = this.diagnosis?.key === this.asked ? this.diagnosis.say() : "";
    return [make("h2", { textContent: t("evidence") }), make("dl", { className: "evidence" }, ...bars),
      make("p", {}, ...(page.served ? [button("diagnose", "ask_diagnosis", few || Boolean(asked)), " "] : []), button("take", "take")),
      make("p", { id: "diagnosis", textContent: page.served && few ? t("few", { n: FEW }) : asked }),
      make("p", { className: "note", textContent: t("take_note") })];
  }

  files({ ground, world } = this.state) {
    return campaign(ground, world.number, world.laws.map((law) => ({ law, ...this.track({ ground, world }, law) })));
  }

  // The recordings questioned by the package itself, where it serves the page.
  async diagnose() {
    const told = (say) => { this.diagnosis = { key, say }; this.on.changed(); }, key = this.asked, word = (n) => (EFFECTS[n] ? t(`e_${n}`) : n.replaceAll("_", " "));
    told(() => t("diagnosing"));
    try {
      const reply = await fetch("api/diagnose", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(this.files()) });
      const said = await reply.json();
      if (!reply.ok) throw new Error(said.problem);
      const alike = (n) => (said.indistinguishable.find((s) => s.includes(n)) ?? [n]).map(word).join(` ${t("alike")} `);
      told(() => (said.verdict === "adequate" ? t("diagnosed_adequate") : said.named.length ? t("diagnosed", { what: said.named.map(alike).join(", ") }) : t("diagnosed_none")));
    } catch (e) { told(() => t("undiagnosed", { why: e.message })); }
  }

  record() {
    const { world } = this.state;
    world.laws.push(this.on.law());
    this.on.changed();
  }

  pick(button) { this.on.show(this.state.world.laws[Number(button.dataset.law)]); }

  another() {
    Object.assign(this.state.world, anyWorld());
    this.choice = "";
    this.on.changed();
  }

  open_seal() {
    this.state.world.said = this.root.querySelector("select").value;
    this.on.changed();
  }

  take() {
    const { ground, world } = this.state;
    const link = make("a", { href: URL.createObjectURL(new Blob(zip(this.files()), { type: "application/zip" })), download: `world-${ground}-${world.number}.zip` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
}
