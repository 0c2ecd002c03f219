// What is allowed of a question, as the sections of an experiment.toml declare it: problems [{keys, word, values}].
const LONGEST = 20; // s, of a law

export function problems(q, sliders, shown) {
  const out = [], law = q.set.actuation;
  for (const s of sliders.filter(shown)) {
    const value = s.key === "frequency2" ? q.frequency2 : q.set[s.section][s.key], { least, most, open } = s.allowed;
    if (value === undefined && s.key === "frequency2") continue;
    const at = (v) => Number((v * s.factor).toPrecision(6));
    const words = [least !== null && `${open ? ">" : "≥"} ${at(least)}`, most !== null && `≤ ${at(most)}`].filter(Boolean).join(", ");
    const values = { key: s.key, allowed: `${words} ${s.unit}`.trim() };
    if (!Number.isFinite(value)) out.push({ keys: [s.key], word: "bad_nan", values });
    else if (value < (least ?? -Infinity) || (open && value <= least) || value > (most ?? Infinity)) {
      out.push({ keys: [s.key], word: "bad_range", values: { ...values, value: `${at(value)} ${s.unit}`.trim() } });
    }
  }
  if (out.length) return out;
  if (q.ground === "granular" && !(q.set.robot.foot_mass > 0)) {
    out.push({ keys: ["foot_mass"], word: "bad_range", values: { key: "foot_mass", value: "0 kg", allowed: "> 0 kg" } });
  }
  if (q.hand) return out;
  const f2 = q.frequency2 ?? law.frequency, halves = law.delay > 0 || f2 !== law.frequency;
  if (halves && law.cycles !== 1) out.push({ keys: ["cycles"], word: "bad_cycles", values: {} });
  const long = halves ? 0.5 / law.frequency + 0.5 / f2 + law.delay : law.cycles / law.frequency;
  if (long > LONGEST) out.push({ keys: ["frequency", "cycles", "delay"], word: "bad_long", values: { s: long.toFixed(1), most: LONGEST } });
  if (q.sand === "cone" && q.ground === "granular" && q.set.model.b < 0.5 && q.set.model.C > 0) out.push({ keys: ["b"], word: "bad_energy", values: {} });
  return out;
}
