// The robot to scale: motor on the rod, coil spring, foot, and the floor or the sand with its hole and jammed cone.
import { at, colours, context } from "./draw.js";
import { mm, number, t as word } from "../words.js";

const STEP = 1.12; // the scale changes by such steps only, so that it does not tremble under a slider

// Lengths of the drawn parts [m], from the motor's travel and the spring's squeeze.
function parts(motion, robot, amplitude) {
  const travel = Math.max(2 * amplitude, ...motion.drive.map(Math.abs));
  const squeeze = Math.max(0, -Math.min(...motion.stretch));
  const motor = Math.max(0.016, 0.7 * travel);
  return { travel, motor, rod: 2 * travel + 1.4 * motor, spring: Math.max(0.024, 1.5 * squeeze + 0.006, 0.5 * travel),
    foot: robot.foot_radius, plate: 0.1 * motor };
}

export class Robot {
  constructor(canvas, grip) {
    Object.assign(this, { canvas, grip, scale: 0, held: false });
  }

  // Sets the view for a motion; while the motor is held by hand the view stays.
  fit(motion, robot, amplitude, height) {
    if (this.held && this.size) return;
    this.size = parts(motion, robot, amplitude);
    this.size.foot ??= 0.7 * this.size.motor;
    this.height = height;
    this.weight = (robot.motor_mass + robot.rod_mass) * robot.gravity;
    const s = this.size;
    this.top = s.spring + s.rod + Math.max(0, ...motion.rod) + 0.3 * s.motor;
    const cone = motion.cone_height ? Math.max(...motion.cone_height) : 0;
    this.below = motion.hole ? Math.max(...motion.hole) + cone + 0.25 * s.motor : 0.35 * s.motor;
  }

  view() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    const room = Math.min((h - 16) / (this.top + this.below), w / (6 * this.size.foot));
    const ideal = STEP ** Math.floor(Math.log(room) / Math.log(STEP));
    if (!this.held) this.scale = ideal;
    return { x: w / 2, y: h - 8 - this.below * this.scale };
  }

  draw(motion, t) {
    const { c, w, h } = context(this.canvas), ink = colours(), s = this.size, o = this.view(), k = this.scale;
    const now = at(motion, t), Y = (v) => o.y - v * k, box = (x, y, width, height, r) => { c.beginPath(); c.roundRect(x, y, width, height, r); };
    const foot = now.foot, seat = foot + s.spring + now.stretch; // heights of the foot's face and the rod's lower end
    const half = s.foot * k, plate = Math.max(4, s.plate * k);
    if (motion.hole) this.sand(c, ink, w, h, o, now, half);
    else {
      c.fillStyle = ink.floor;
      c.fillRect(0, Y(0), w, h);
    }
    this.heightMarks(c, ink, w, o, motion);

    c.fillStyle = ink.steel; // foot
    box(o.x - half, Y(foot) - plate, 2 * half, plate, 2); c.fill();
    this.coil(c, ink, o.x, Y(foot) - plate, Y(seat), Math.max(7, 0.28 * s.motor * k));
    c.fillStyle = ink.metal; // rod
    const thick = Math.max(6, 0.16 * s.motor * k);
    box(o.x - thick / 2, Y(seat + s.rod), thick, s.rod * k, 3); c.fill();
    box(o.x - 0.34 * s.motor * k, Y(seat) - 4, 0.68 * s.motor * k, 4, 2); c.fill();
    const middle = seat + s.rod / 2 + now.drive; // motor
    const size = s.motor * k;
    c.fillStyle = ink.mark;
    box(o.x - 0.62 * size, Y(middle) - size / 2, 1.24 * size, size, Math.min(8, size / 5)); c.fill();
    c.strokeStyle = ink.card;
    c.globalAlpha = 0.45;
    c.lineWidth = 1.5;
    for (const d of [-0.18, 0, 0.18]) {
      const y = Y(middle) + d * size;
      c.beginPath(); c.moveTo(o.x - 0.36 * size, y); c.lineTo(o.x + 0.36 * size, y); c.stroke();
    }
    c.globalAlpha = 1;
    const most = Math.max(this.weight, ...motion.ground, ...motion.spring.map(Math.abs)), left = o.x - Math.max(half, 0.62 * size) - 14;
    this.arrow(c, ink, o.x + half + 12, Y(foot), (80 * now.ground) / most, now.ground, "force_ground");
    this.arrow(c, ink, left, Y(seat), (80 * now.spring) / most, now.spring, "force_spring");
    this.arrow(c, ink, left, Y(middle), (-80 * this.weight) / most, this.weight, "force_weight");
    const style = this.grip.style, wide = Math.max(44, 1.3 * size), tall = Math.max(44, size);
    style.width = `${wide}px`;
    style.height = `${tall}px`;
    style.transform = `translate(${o.x - wide / 2}px, ${Y(middle) - tall / 2}px)`;
  }

  // A coil: a helix seen a little from above, its back half drawn first.
  coil(c, ink, x, low, high, radius) {
    const turns = 7, tilt = Math.min(0.45 * radius, 0.5 * (low - high) / turns), n = 40 * turns;
    for (const front of [false, true]) {
      c.strokeStyle = front ? ink.ink : ink.soft;
      c.lineWidth = (front ? 0.17 : 0.1) * Math.min(radius, 14);
      c.beginPath();
      let on = false;
      for (let i = 0; i <= n; i++) {
        const a = (2 * Math.PI * turns * i) / n, y = low + ((high - low) * i) / n + tilt * 0.35 * Math.sin(a);
        if (Math.sin(a) >= 0 !== front) { on = false; continue; }
        on ? c.lineTo(x + radius * Math.cos(a), y) : c.moveTo(x + radius * Math.cos(a), y);
        on = true;
      }
      c.stroke();
    }
  }

  sand(c, ink, w, h, o, now, half) {
    const k = this.scale, bottom = o.y + now.hole * k;
    c.fillStyle = ink.sand;
    c.beginPath(); // surface with the hole that the foot has made
    c.moveTo(0, o.y); c.lineTo(o.x - half, o.y); c.lineTo(o.x - half, bottom); c.lineTo(o.x + half, bottom); c.lineTo(o.x + half, o.y);
    c.lineTo(w, o.y); c.lineTo(w, h); c.lineTo(0, h); c.closePath(); c.fill();
    c.save();
    c.clip();
    c.fillStyle = ink.grain;
    let seed = 7; // a fixed scatter of grains
    const next = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
    for (let i = 0, n = (w * (h - o.y)) / 60; i < n; i++) {
      c.beginPath(); c.arc(next() * w, o.y + next() * (h - o.y), 0.7 + 0.7 * next(), 0, 7); c.fill();
    }
    if (now.cone_height > 0) {
      const r = now.cone_radius * k, deep = bottom + now.cone_height * k;
      c.fillStyle = ink.jam;
      c.globalAlpha = 0.75;
      c.beginPath();
      c.moveTo(o.x - half, bottom); c.lineTo(o.x - r, deep); c.lineTo(o.x + r, deep); c.lineTo(o.x + half, bottom);
      c.closePath(); c.fill();
      c.globalAlpha = 1;
    }
    c.restore();
  }

  // Levels of the rod's top at rest and at the height of the jump.
  heightMarks(c, ink, w, o, motion) {
    const s = this.size, rest = s.spring + motion.stretch[0] + motion.foot[0] + s.rod, height = this.height;
    const left = o.x + 0.7 * s.motor * this.scale + 14, right = Math.min(w - 8, left + 96);
    c.strokeStyle = c.fillStyle = ink.soft;
    c.lineWidth = 1;
    c.textBaseline = "middle";
    c.textAlign = "right";
    const levels = height > 1e-4 ? [0, height] : [0];
    for (const v of levels) {
      const y = Math.round(o.y - (rest + v) * this.scale) + 0.5;
      c.setLineDash([3, 3]);
      c.beginPath(); c.moveTo(left, y); c.lineTo(right, y); c.stroke();
      c.setLineDash([]);
      const near = height * this.scale < 26 && levels.length > 1;
      c.fillText(v ? mm(v) : word("rest"), right, y + (v ? -9 : near ? 10 : -9));
    }
  }

  // A force [N] as an arrow with its name, upwards where the length is positive; to the left of the robot read leftwards.
  arrow(c, ink, x, y, length, force, name) {
    if (Math.abs(length) < 3) return;
    const way = Math.sign(length), right = x > this.canvas.clientWidth / 2;
    c.strokeStyle = c.fillStyle = ink.ink;
    c.lineWidth = 2;
    c.beginPath(); c.moveTo(x, y); c.lineTo(x, y - length + 5 * way); c.stroke();
    c.beginPath(); c.moveTo(x, y - length); c.lineTo(x - 4, y - length + 7 * way); c.lineTo(x + 4, y - length + 7 * way); c.fill();
    c.textAlign = right ? "left" : "right";
    c.textBaseline = "middle";
    c.fillText(`${word(name)} ${number(Math.abs(force), 0)} N`, x + (right ? 8 : -8), y - 0.5 * length);
  }
}
