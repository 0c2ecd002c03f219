// The whole state of the page, and its share link: what differs from the thesis' robot, as text behind the #.
import page from "../page.js";

export const fresh = (ground) => structuredClone({ ground, set: page.grounds[ground].defaults, sand: "cone", two: false, hand: null,
  frequency2: page.grounds[ground].defaults.actuation.frequency });

export const question = (state) => ({ ground: state.ground, set: state.set, sand: state.sand, hand: state.hand,
  ...(state.two && { frequency2: state.frequency2 }) });

export function encode(state) {
  const { defaults } = page.grounds[state.ground], set = {};
  for (const { section, key } of page.sliders) {
    const value = state.set[section]?.[key];
    if (value !== undefined && value !== defaults[section][key]) set[key] = value;
  }
  const hand = state.hand && { t: state.hand.t.map((v) => Number(v.toFixed(4))), x: state.hand.x.map((v) => Number(v.toFixed(6))) };
  return encodeURIComponent(JSON.stringify({ ground: state.ground, set, ...(state.sand !== "cone" && { sand: state.sand }),
    ...(state.two && { f2: state.frequency2 }), ...(hand && { hand }) }));
}

const listed = (a) => Array.isArray(a) && a.length >= 3 && a.length <= 10_000 && a.every((v) => Number.isFinite(v) && Math.abs(v) <= 60);
const rises = (a) => a[0] === 0 && a.every((v, i) => !i || v > a[i - 1]);

// The state of a link; null where it is none of this page. Values that are not allowed are refused where they are asked.
export function decode(text) {
  let given;
  try { given = JSON.parse(decodeURIComponent(text)); } catch { return null; }
  if (given === null || typeof given !== "object" || !Object.hasOwn(page.grounds, given.ground)) return null;
  const state = fresh(given.ground);
  for (const [key, value] of Object.entries(given.set ?? {})) {
    const slider = page.sliders.find((s) => s.key === key);
    if (!slider || !Number.isFinite(value)) return null;
    state.set[slider.section][key] = value;
  }
  if (given.sand !== undefined && !Object.hasOwn(page.sand, given.sand)) return null;
  if (given.f2 !== undefined && !Number.isFinite(given.f2)) return null;
  if (given.hand && !(listed(given.hand.t) && listed(given.hand.x) && given.hand.t.length === given.hand.x.length && rises(given.hand.t))) return null;
  return Object.assign(state, { sand: given.sand ?? "cone", two: given.f2 !== undefined, frequency2: given.f2 ?? state.frequency2, hand: given.hand ?? null });
}
