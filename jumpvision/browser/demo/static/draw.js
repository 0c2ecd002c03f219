// What the drawings share: crisp canvases, colours of the theme, numbers as text, ticks, interpolation in time.
// A true minus, a dash for what is not known.
export const numberText = (v, digits) => (Number.isFinite(v) ? v.toFixed(digits).replace(/^-(?=0\.?0*$)/, "").replace("-", "−") : "–");
export const mm = (v) => `${numberText(v * 1e3, 1)}\u00a0mm`;

export function context(canvas) {
  const ratio = window.devicePixelRatio || 1, { clientWidth: w, clientHeight: h } = canvas;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, w, h);
  c.font = `12px ${getComputedStyle(document.body).fontFamily}`;
  c.lineJoin = c.lineCap = "round";
  return { c, w, h };
}

let theme;
export function colours() {
  if (!theme) {
    const style = getComputedStyle(document.documentElement);
    const names = ["ink", "soft", "line", "card", "mark", "metal", "steel", "floor", "sand", "grain", "jam"];
    theme = Object.fromEntries(names.map((n) => [n, style.getPropertyValue(`--${n}`).trim()]));
  }
  return theme;
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { theme = undefined; });

export function ticks(lo, hi, n) {
  const raw = (hi - lo) / n, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
  const out = [];
  for (let v = Math.ceil(lo / step - 1e-9) * step; v <= hi + 1e-9 * step; v += step) out.push(Math.abs(v) < step * 1e-9 ? 0 : v);
  return out;
}

export const label = (v) => String(Number(v.toPrecision(6))).replace("-", "−");

// The columns of a motion (equally spaced in time) at the time t.
export function at(motion, t) {
  const n = motion.t.length - 1, span = motion.t[n] - motion.t[0];
  const place = Math.min(Math.max((t - motion.t[0]) / span, 0), 1) * n;
  const i = Math.min(Math.floor(place), n - 1), share = place - i;
  return Object.fromEntries(Object.entries(motion).map(([k, v]) => [k, v[i] + share * (v[i + 1] - v[i])]));
}
