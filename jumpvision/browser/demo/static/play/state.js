// The whole state of the page, and its share link: what differs from the thesis' robot, as text behind the #. A sealed
// world: its number, the motor laws that were recorded there and the answer; its recordings follow from these.
import page from "../page.js";
import { problems } from "../physics/check.js";
import { CHALLENGES, SEALED } from "./challenges.js";
import { MOST, choices, declared } from "./world.js";

export const fresh = (ground) => structuredClone({ ground, set: page.grounds[ground].defaults, sand: "cone", two: false, hand: null,
  task: "", world: null, frequency2: page.grounds[ground].defaults.actuation.frequency });

export const question = (state) => ({ ground: state.ground, set: state.set, sand: state.sand, hand: state.hand,
  ...(state.two && { frequency2: state.frequency2 }) });

// The motor law now, and its place in a state.
export const lawOf = ({ set, two, frequency2, hand }) => structuredClone({ actuation: set.actuation, ...(two && { frequency2 }), ...(hand && { hand }) });
export function take(state, law) {
  const { actuation, frequency2, hand } = structuredClone(law);
  Object.assign(state.set.actuation, actuation);
  Object.assign(state, { two: frequency2 !== undefined, hand: hand ?? null, ...(frequency2 && { frequency2 }) });
}

const LAW = ["frequency", "amplitude", "phase", "cycles", "delay"];
const packed = ({ actuation, frequency2, hand }) => ({ a: LAW.map((k) => actuation[k]), ...(frequency2 && { f2: frequency2 }), ...(hand && { hand }) });

export function encode(state) {
  const { defaults } = page.grounds[state.ground], set = {};
  for (const { section, key } of page.sliders) {
    const value = state.set[section]?.[key];
    if (value !== undefined && value !== defaults[section][key]) set[key] = value;
  }
  const { hand, task, world } = state;
  return encodeURIComponent(JSON.stringify({ ground: state.ground, set, ...(state.sand !== "cone" && { sand: state.sand }),
    ...(state.two && { f2: state.frequency2 }), ...(hand && { hand }),
    ...(task && { task }), ...(world && { world: { n: world.number, laws: world.laws.map(packed), ...(world.said && { said: world.said }) } }) }));
}

const listed = (a) => Array.isArray(a) && a.length >= 3 && a.length <= 10_000 && a.every((v) => Number.isFinite(v) && Math.abs(v) <= 60);
const rises = (a) => a[0] === 0 && a.every((v, i) => !i || v > a[i - 1]);

const motion = (h) => listed(h.t) && listed(h.x) && h.t.length === h.x.length && rises(h.t);

// The world of a link; null where it is none, or a law of it may not be asked.
function unsealed(given, ground) {
  const laws = given.laws?.map?.(({ a, f2, hand }) => {
    if (!Array.isArray(a) || (hand && !motion(hand))) return null;
    const actuation = { ...page.grounds[ground].defaults.actuation, ...Object.fromEntries(LAW.map((k, i) => [k, a[i]])) };
    const law = { actuation, ...(f2 !== undefined && { frequency2: f2 }), ...(hand && { hand }) };
    return problems(declared(ground, law), page.sliders, (s) => s.section === "actuation").length ? null : law;
  });
  if (!Number.isInteger(given.n) || !(laws?.length <= MOST) || laws.includes(null)) return null;
  return given.said === undefined || choices(ground).includes(given.said) ? { number: given.n, laws, said: given.said ?? "" } : null;
}

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
  if (given.hand && !motion(given.hand)) return null;
  const task = given.task ?? "", world = task === SEALED ? unsealed(given.world ?? {}, given.ground) : null;
  if (task && task !== SEALED && !Object.hasOwn(CHALLENGES, task) || (task === SEALED && !world)) return null;
  return Object.assign(state, { task, world, sand: given.sand ?? "cone", two: given.f2 !== undefined, frequency2: given.f2 ?? state.frequency2, hand: given.hand ?? null });
}
