// Tasks on the thesis' robot: which settings are free, and when a jump has done it. Judged by the jump's own numbers.
import page from "../page.js";

const FREE = ["frequency", "phase", "delay", "frequency2"];
export const CHALLENGES = {
  beat: (n) => n.jump_height_m > 0.041,
  power: (n) => n.jump_height_m >= 0.03 && n.peak_power_W < 3.5,
};

// "won", "not_yet" or the key of the setting that may not be changed.
export function judge(name, numbers, state) {
  if (state.ground !== "hard") return "ground";
  if (state.hand) return "by_hand";
  const { defaults } = page.grounds.hard;
  for (const { section, key } of page.sliders) {
    if (!FREE.includes(key) && state.set[section]?.[key] !== defaults[section][key]) return `s_${key}`;
  }
  return CHALLENGES[name](numbers) ? "won" : "not_yet";
}
