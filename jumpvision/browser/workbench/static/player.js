// Frames on the screen: fetched at its width, the next ones ahead; played on the film's own clock.
import { emit, film, picture, store, times, trouble } from "./store.js";

const WIDTHS = [320, 640, 960, 1280, 1920, 2560, 4096], KEPT = 160, AHEAD = 6, AT_ONCE = 2, NEAR = 2;
const kept = new Map(), under = new Map();
export const player = { image: null, shown: -1, playing: false, speed: 1, width: 640, direction: 1 };

const key = (i) => `${store.section}/${i}/${player.width}`;

export function want(width) {
  const w = WIDTHS.find((v) => v >= width) ?? WIDTHS.at(-1);
  if (w === player.width) return;
  player.width = w;
  show();
}

async function fetched(i) {
  const name = key(i), section = store.section;
  if (kept.has(name)) { const image = kept.get(name); kept.delete(name); kept.set(name, image); return image; }
  if (!under.has(name)) {
    under.set(name, picture(section, i, player.width).then((image) => {
      kept.set(name, image);
      if (kept.size > KEPT) { const [old, gone] = kept.entries().next().value; kept.delete(old); if (gone !== player.image) gone.close(); }
      return image;
    }).finally(() => under.delete(name)));
  }
  return under.get(name);
}

// Two frames may be on their way, the one decoded while the other is made; of further wishes only the newest is kept, and
// none is drawn after a newer one: the film follows the hand.
let busy = 0, again = false, asked = 0, newest = 0, last = 0;
async function show() {
  if (busy === 2) { again = true; return; }
  busy++;
  do {
    again = false;
    const i = store.frame, section = store.section, turn = ++asked;
    try {
      const image = await fetched(i);
      if (section === store.section && turn > newest) {
        newest = turn;
        Object.assign(player, { image, shown: i });
      }
      emit("image");
      if (Math.abs(i - last) <= NEAR) ahead(i); // a hand that jumps will not come by
      last = i;
    } catch (e) { trouble(e); }
  } while (again);
  busy--;
}

function ahead(i) {
  const n = film().time.length;
  for (let k = 1; k <= AHEAD && under.size < AT_ONCE; k++) {
    const next = i + k * player.direction;
    if (next >= 0 && next < n && !kept.has(key(next))) fetched(next).catch(() => {});
  }
}

export function seek(i) {
  const n = film().time.length, frame = Math.max(0, Math.min(n - 1, Math.round(i)));
  if (frame !== store.frame) player.direction = frame > store.frame ? 1 : -1;
  store.frame = frame;
  emit("frame");
  show();
}

export function frameAt(t) {
  const time = times();
  let low = 0, high = time.length - 1;
  while (low < high) { const mid = (low + high + 1) >> 1; if (time[mid] <= t) low = mid; else high = mid - 1; }
  return low;
}

let clock = 0, before = 0;
export function play(on = !player.playing) {
  const time = times();
  if (on && store.frame === time.length - 1) seek(0);
  player.playing = on && time.length > 1;
  clock = time[store.frame];
  before = performance.now();
  emit("playing");
  if (player.playing) requestAnimationFrame(tick);
}

function tick(now) {
  if (!player.playing) return;
  const time = times();
  clock += player.speed * (now - before) / 1000;
  before = now;
  const i = frameAt(clock);
  if (i !== store.frame) seek(i);
  if (i === time.length - 1) { play(false); return; }
  requestAnimationFrame(tick);
}

// Slow enough that 25 frames are seen in a second.
export function speeds() {
  const time = times(), rate = time.length > 1 ? (time.length - 1) / (time.at(-1) - time[0]) : 1;
  const all = [1, 1 / 2, 1 / 5, 1 / 10, 1 / 20, 1 / 50, 1 / 100, 1 / 500, 1 / 1000, 1 / 5000];
  return { all, usual: all.find((s) => rate * s <= 30) ?? all.at(-1) };
}
