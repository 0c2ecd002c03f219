// The recordings of a sealed world as a campaign that `jumpvision diagnose` reads, in a zip file.
import { lawPieces, handPieces, motorAt } from "../physics/law.js";
import { NOISE, declared } from "./world.js";

const LOG = 1e-3; // s between the rows of a motor log
const SHARED = { robot: ["motor_mass", "rod_mass", "foot_mass", "spring_stiffness", "spring_damping", "foot_radius", "gravity"],
  bed: ["volume_fraction", "grain_density"], model: ["k1", "k2", "delta", "alpha"] };
const real = (v) => (Number.isInteger(v) ? v.toFixed(1) : String(v));
const table = (name, rows) => [`[${name}]`, ...rows.map(([k, v]) => `${k} = ${v}`), ""].join("\n");

// Path -> text. recordings: [{law, t, x}].
export function campaign(ground, number, recordings) {
  const hard = ground === "hard", files = {}, { set } = declared(ground, recordings[0].law);
  const shared = Object.entries(SHARED).map(([section, keys]) => {
    const rows = keys.filter((k) => set[section][k] !== undefined).map((k) => [k, real(set[section][k])]);
    if (section === "model") return table(section, [["terms", hard ? "[]" : '["two_resistance", "inertial_drag"]'], ...(hard ? [] : rows)]);
    return rows.length ? table(section, rows) : "";
  });
  files["campaign.toml"] = [`# World ${number} of the interactive jumper, recorded by a camera of ${NOISE} m noise.`, `ground = "${ground}"`, "", ...shared].join("\n");
  recordings.forEach(({ law, t, x }, i) => {
    const { kind, frequency, amplitude, phase, cycles, delay } = law.actuation, plain = !law.hand && !law.frequency2;
    const rows = plain ? [["kind", `"${kind}"`], ["frequency", real(frequency)], ["amplitude", real(amplitude)], ["phase", real(phase)],
      ["cycles", real(cycles)], ["delay", real(delay)], ["start", "0.0"]] : [["kind", '"custom"'], ["start", "0.0"]];
    const folder = `jump-${i + 1}`, log = plain ? [] : [table("motor_log", [["file", '"motor.csv"']])];
    files[`${folder}/experiment.toml`] = [table("actuation", rows), table("rod_track", [["file", '"rod_track.csv"']]), ...log].join("\n");
    files[`${folder}/rod_track.csv`] = ["time_s,height_m,sigma_m", ...t.map((s, k) => `${s.toFixed(6)},${x[k].toFixed(7)},${NOISE}`), ""].join("\n");
    if (plain) return;
    const pieces = law.hand ? handPieces(law.hand) : lawPieces(law.actuation, law.frequency2), places = Math.floor((t.at(-1) - t[0]) / LOG);
    files[`${folder}/motor.csv`] = ["time_s,position_m", ...Array.from({ length: places }, (_, k) => t[0] + k * LOG)
      .map((s) => `${s.toFixed(6)},${motorAt(pieces, s)[0].toFixed(9)}`), ""].join("\n");
  });
  return files;
}

const POLYNOMIAL = 0xedb88320;
const crc = (bytes) => {
  let c = -1;
  for (const b of bytes) {
    c ^= b;
    for (let i = 0; i < 8; i++) c = (c >>> 1) ^ (c & 1 ? POLYNOMIAL : 0);
  }
  return ~c >>> 0;
};

// A zip file of texts, not compressed: local headers and data, the directory, its end (PKWARE APPNOTE, version 2.0).
export function zip(files) {
  const parts = [], directory = [], encoder = new TextEncoder();
  let offset = 0;
  const numbers = (...fields) => { // [value, bytes] little-endian
    const out = [];
    for (const [value, bytes] of fields) for (let i = 0; i < bytes; i++) out.push((value / 2 ** (8 * i)) & 255);
    return Uint8Array.from(out);
  };
  for (const [path, text] of Object.entries(files)) {
    const name = encoder.encode(path), data = encoder.encode(text);
    const same = [[20, 2], [0x800, 2], [0, 2], [0, 2], [0x21, 2], [crc(data), 4], [data.length, 4], [data.length, 4], [name.length, 2], [0, 2]];
    const head = numbers([0x04034b50, 4], ...same);
    directory.push(numbers([0x02014b50, 4], [20, 2], ...same, [0, 2], [0, 2], [0, 2], [0, 4], [offset, 4]), name);
    parts.push(head, name, data);
    offset += head.length + name.length + data.length;
  }
  const size = directory.reduce((n, x) => n + x.length, 0), count = directory.length / 2;
  return [...parts, ...directory, numbers([0x06054b50, 4], [0, 2], [0, 2], [count, 2], [count, 2], [size, 4], [offset, 4], [0, 2])];
}
