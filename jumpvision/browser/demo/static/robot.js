// The robot to scale: motor on the rod, coil spring, foot, and the floor or the sand with its hole and jammed cone.
import { at, colours, context, mm, numberText } from "./draw.js";

const SCALE_STEP = 1.12; // the scale changes by such steps only, so that it does not tremble under a knob
const LONGEST_ARROW = 80; // px

export class RobotView {
  constructor(canvas) { this.canvas = canvas; }

  // Sets the view for a motion; height: of the jump [m].
  fit(motion, { robot, law }, height) {
    const travel = Math.max(2 * law.amplitude, ...motion.drive.map(Math.abs)), squeeze = Math.max(0, -Math.min(...motion.stretch));
    const motor = Math.max(0.016, 0.7 * travel), spring = Math.max(0.024, 1.5 * squeeze + 0.006, 0.5 * travel);
    this.size = { motor, spring, rod: 2 * travel + 1.4 * motor, foot: robot.foot_radius ?? 0.7 * motor, plate: 0.1 * motor };
    this.height = height;
    this.weight = (robot.motor_mass + robot.rod_mass) * robot.gravity;
    this.force = Math.max(this.weight, ...motion.ground, ...motion.spring.map(Math.abs));
    this.top = spring + this.size.rod + Math.max(0, ...motion.rod) + 0.3 * motor;
    this.below = motion.hole ? Math.max(...motion.hole) + Math.max(...motion.cone_height) + 0.25 * motor : 0.35 * motor;
  }

  draw(motion, t) {
    const { c, w, h } = context(this.canvas), ink = colours(), s = this.size, now = at(motion, t);
    const room = Math.min((h - 16) / (this.top + this.below), w / (6 * s.foot));
    const k = SCALE_STEP ** Math.floor(Math.log(room) / Math.log(SCALE_STEP)), x = w / 2, ground = h - 8 - this.below * k;
    Object.assign(this, { c, ink, w, h, k, x, ground });
    const Y = (v) => ground - v * k, half = s.foot * k, plate = Math.max(4, s.plate * k), size = s.motor * k;
    const seat = now.foot + s.spring + now.stretch, middle = seat + s.rod / 2 + now.drive; // the rod's lower end, the motor
    const box = (colour, wide, top, tall, round) => {
      c.fillStyle = colour;
      c.beginPath(); c.roundRect(x - wide / 2, top, wide, tall, round); c.fill();
    };
    if (motion.hole) this.drawSand(now, half);
    else {
      c.fillStyle = ink.floor;
      c.fillRect(0, Y(0), w, h);
    }
    this.drawHeights(motion);
    box(ink.steel, 2 * half, Y(now.foot) - plate, plate, 2);
    this.drawCoil(Y(now.foot) - plate, Y(seat), Math.max(7, 0.28 * size));
    box(ink.metal, Math.max(6, 0.16 * size), Y(seat + s.rod), s.rod * k, 3);
    box(ink.metal, 0.68 * size, Y(seat) - 4, 4, 2);
    box(ink.mark, 1.24 * size, Y(middle) - size / 2, size, Math.min(8, size / 5));
    c.globalAlpha = 0.45;
    for (const d of [-0.18, 0, 0.18]) box(ink.card, 0.72 * size, Y(middle) + d * size - 0.75, 1.5, 1);
    c.globalAlpha = 1;
    const left = x - Math.max(half, 0.62 * size) - 14, arrow = (px, y, name, force, way = 1) => this.drawArrow(px, y, name, force, way);
    arrow(x + half + 12, Y(now.foot), "ground", now.ground);
    arrow(left, Y(seat), "spring", now.spring);
    arrow(left, Y(middle), "weight", this.weight, -1);
  }

  // A helix seen a little from above, its back half drawn first.
  drawCoil(low, high, radius) {
    const { c, ink, x } = this, turns = 7, tilt = Math.min(0.45 * radius, 0.5 * (low - high) / turns), n = 40 * turns;
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

  // Surface with the hole that the foot has made, a fixed scatter of grains, and the cone under the hole.
  drawSand(now, half) {
    const { c, ink, w, h, k, x, ground } = this, bottom = ground + now.hole * k;
    const outline = (...points) => { c.beginPath(); for (const p of points) c.lineTo(...p); c.closePath(); };
    c.fillStyle = ink.sand;
    outline([0, ground], [x - half, ground], [x - half, bottom], [x + half, bottom], [x + half, ground], [w, ground], [w, h], [0, h]);
    c.fill();
    c.save();
    c.clip();
    c.fillStyle = ink.grain;
    let seed = 7;
    const next = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
    for (let i = 0, n = (w * (h - ground)) / 60; i < n; i++) {
      c.beginPath(); c.arc(next() * w, ground + next() * (h - ground), 0.7 + 0.7 * next(), 0, 7); c.fill();
    }
    const r = now.cone_radius * k, deep = bottom + now.cone_height * k;
    c.fillStyle = ink.jam;
    c.globalAlpha = 0.75;
    outline([x - half, bottom], [x - r, deep], [x + r, deep], [x + half, bottom]);
    c.fill();
    c.restore();
  }

  // Levels of the rod's top at rest and at the height of the jump.
  drawHeights(motion) {
    const { c, ink, w, k, x, ground, size, height } = this, rest = size.spring + motion.stretch[0] + motion.foot[0] + size.rod;
    const left = x + 0.7 * size.motor * k + 14, right = Math.min(w - 8, left + 96), near = height * k < 26;
    c.strokeStyle = c.fillStyle = ink.soft;
    c.lineWidth = 1;
    c.textBaseline = "middle";
    c.textAlign = "right";
    for (const v of height > 1e-4 ? [0, height] : [0]) {
      const y = Math.round(ground - (rest + v) * k) + 0.5;
      c.setLineDash([3, 3]);
      c.beginPath(); c.moveTo(left, y); c.lineTo(right, y); c.stroke();
      c.setLineDash([]);
      c.fillText(v ? mm(v) : "rest", right, y + (!v && near ? 10 : -9));
    }
  }

  // A force [N] as an arrow with its name, upwards where force * way > 0; its text lies on the side away from the robot.
  drawArrow(x, y, name, force, way) {
    const { c, ink } = this, length = (way * LONGEST_ARROW * force) / this.force, tip = 7 * Math.sign(length), right = x > this.x;
    if (Math.abs(length) < 3) return;
    c.strokeStyle = c.fillStyle = ink.ink;
    c.lineWidth = 2;
    c.beginPath(); c.moveTo(x, y); c.lineTo(x, y - length + tip); c.stroke();
    c.beginPath(); c.moveTo(x, y - length); c.lineTo(x - 4, y - length + tip); c.lineTo(x + 4, y - length + tip); c.fill();
    c.textAlign = right ? "left" : "right";
    c.textBaseline = "middle";
    c.fillText(`${name} ${numberText(Math.abs(force), 0)} N`, x + (right ? 8 : -8), y - 0.5 * length);
  }
}
