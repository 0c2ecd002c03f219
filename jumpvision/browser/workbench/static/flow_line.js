// The line of a profile: its ends on the film, and in the field's axes as [params.profiles] has them.
import { store } from "./store.js";

const short = (v) => Number(v.toPrecision(6));
export const inField = ([a, b, c, d], { column, row, scale }) => [short((a - column) * scale), short((row - b) * scale), short((c - column) * scale), short((row - d) * scale)];

// Into the draft; whoever calls says that it changed.
export function keepLine(ends) {
  if (!store.flow || Math.hypot(ends[0] - ends[2], ends[1] - ends[3]) < 1) return;
  (store.draft.values["params.profiles"] ??= {}).lines = [inField(ends, store.flow.place)];
}
