// Every text of the page, in its language, from one table (words.json).
import page from "./page.js";

export const languages = Object.keys(page.words.language);
let language = "en";
export const current = () => language;

export function speak(name) {
  language = languages.includes(name) ? name : "en";
  document.documentElement.lang = language;
  document.title = `${t("title")} · jumpvision`;
  for (const node of document.querySelectorAll("[data-t]")) node.textContent = t(node.dataset.t);
  for (const node of document.querySelectorAll("[data-label]")) node.setAttribute("aria-label", t(node.dataset.label));
}

export const t = (key, values = {}) => page.words[key][language].replace(/\{(\w+)\}/g, (_, name) => values[name]);

// Decimal sign of the language, a true minus, a dash for what is not known.
export function number(v, digits) {
  if (v === null || v === undefined || !Number.isFinite(v)) return "–";
  const text = v.toFixed(digits).replace(/^-(?=0\.?0*$)/, "").replace("-", "−");
  return language === "en" ? text : text.replace(".", ",");
}

export const plain = (v) => (language === "en" ? String(v) : String(v).replace(".", ",")).replace("-", "−");
export const mm = (v) => `${number(v * 1e3, 1)}\u00a0mm`;
const ms = (v) => `${number(v * 1e3, 1)}\u00a0ms`;

// The one height of the page [m]: the rise of the rod above rest, after the motor stops; by hand over the whole motion.
export const rise = (n, hand) => (hand ? Math.max(n.driven_m, n.jump_height_m) : n.jump_height_m);

export const headline = (n, hand) => (n.n_jumps === 0 ? t("stays") : t("rises", { mm: mm(rise(n, hand)) }));

export function story(n, hand) {
  const meaning = hand ? t("meaning_hand", { driven: mm(n.driven_m), after: mm(n.jump_height_m) })
    : n.n_jumps === 0 ? t("meaning_stays", { mm: mm(n.jump_height_m) }) : t("meaning");
  if (n.n_jumps === 0) return meaning;
  const flights = n.n_jumps === 1 ? t("flight") : t("flights", { n: n.n_jumps });
  return `${meaning} ${t("lifts", { flights, ms: ms(n.lift_off_s), stop: ms(n.stop_s) })}`;
}

export function table(n, question) {
  const rows = [
    [t("n_com"), mm(n.com_height_m)], [t("n_flight_height"), mm(n.flight_height_m)],
    [t("n_power"), `${number(n.peak_power_W, 2)}\u00a0W`], [t("n_force"), `${number(n.peak_force_N, 1)}\u00a0N`],
    [t("n_speed"), `${number(n.peak_motor_speed, 3)}\u00a0m/s`], [t("n_f0"), `${number(n.f0_Hz, 2)}\u00a0Hz`],
  ];
  if (!question.hand) rows.push(["f / f₀", number(n.f_over_f0, 3)], ["α = M g / (k A)", number(n.alpha, 3)]);
  rows.push([t("n_zeta"), number(n.zeta, 4)]);
  if (question.ground === "granular") rows.push([t("n_depth"), mm(n.depth_m)]);
  if (n.added_mass_kg !== undefined) {
    rows.push([t("n_cone"), `${number(n.added_mass_kg * 1e3, 0)}\u00a0g`], [t("n_cone_foot"), number(n.added_mass_kg / question.set.robot.foot_mass, 1)]);
  }
  return rows;
}
