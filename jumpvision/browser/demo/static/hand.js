// The motor moved by hand: X_m(t) recorded from the pointer or the arrow keys.
const LONGEST = 8; // s
const PAUSE = 500; // ms without a key that end a motion by keys

export class Hand {
  // on: begin(), moved(log), end(log); reach() gives {scale [px/m], travel [m]} of the drawing.
  constructor(grip, reach, on) {
    Object.assign(this, { reach, on, log: null, timer: 0 });
    grip.onpointerdown = (e) => {
      if (e.button !== 0) return;
      grip.setPointerCapture(e.pointerId);
      this.from = e.clientY;
      this.begin(e.timeStamp);
    };
    grip.onpointermove = (e) => {
      if (!this.log || !grip.hasPointerCapture(e.pointerId)) return;
      this.move((this.from - e.clientY) / this.log.scale, e.timeStamp);
    };
    grip.onlostpointercapture = () => this.end();
    grip.onkeydown = (e) => {
      const way = { ArrowUp: 1, ArrowDown: -1 }[e.key];
      if (!way) return;
      e.preventDefault();
      if (!this.log) this.begin(e.timeStamp - 40);
      this.move(this.log.x.at(-1) + (way * this.log.travel) / 6, e.timeStamp);
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.end(), PAUSE);
    };
  }

  begin(now) {
    this.on.begin();
    const { scale, travel } = this.reach();
    this.log = { t: [0], x: [0], start: now, scale, travel };
  }

  move(x, now) {
    const { log } = this, t = (now - log.start) / 1e3;
    if (t - log.t.at(-1) < 0.002) return;
    log.t.push(t);
    log.x.push(Math.min(Math.max(x, -log.travel), log.travel));
    if (t > LONGEST) this.end();
    else this.on.moved(this.record());
  }

  record() {
    return { t: this.log.t.map((v) => Number(v.toFixed(4))), x: this.log.x.map((v) => Number(v.toFixed(6))) }; // as links hold it
  }

  end() {
    if (!this.log) return;
    clearTimeout(this.timer);
    const record = this.log.t.length > 2 ? this.record() : null; // a click moves nothing
    this.log = null;
    this.on.end(record);
  }
}
