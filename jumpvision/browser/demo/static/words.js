// The numbers of a jump in words with units.
const number = (v, digits) => (v === null || v === undefined ? "–" : v.toFixed(digits).replace("-", "−"));
const mm = (v) => `${number(v === null ? null : v * 1e3, 1)} mm`;
const ms = (v) => `${number(v === null ? null : v * 1e3, 1)} ms`;

export const headline = (n) => (n.n_jumps === 0 ? "Stays on the ground" : `Jumps ${mm(n.jump_height_m)} high`);

export function story(n) {
  const stays = "the foot never leaves the ground.";
  if (n.n_jumps === 0) return n.jump_height_m > 5e-5 ? `The rod rises ${mm(n.jump_height_m)}, ${stays}` : stays.replace("t", "T");
  const flights = n.n_jumps === 1 ? "One flight" : `${n.n_jumps} flights`;
  const text = `${flights}; lifts off ${ms(n.lift_off_s)} after the motor starts, which runs for ${ms(n.stop_s)}.`;
  return text.replace(/ ms/g, "\u00a0ms");
}

export function table(n, question) {
  const rows = [
    ["flight height g t²/8", mm(n.flight_height_m)],
    ["rise of the centre of mass", mm(n.com_height_m)],
    ["peak power of the motor", `${number(n.peak_power_W, 2)} W`],
    ["peak force of the motor", `${number(n.peak_force_N, 1)} N`],
    ["peak speed of the motor", `${number(n.peak_motor_speed, 3)} m/s`],
    ["natural frequency f₀", `${number(n.f0_Hz, 2)} Hz`],
  ];
  if (!question.hand) rows.push(["f / f₀", number(n.f_over_f0, 3)], ["α = M g / (k A)", number(n.alpha, 3)]);
  rows.push(["damping ratio ζ", number(n.zeta, 4)]);
  if (n.depth_m !== undefined) rows.push(["deepest point of the foot", mm(n.depth_m)]);
  if (n.added_mass_kg !== undefined) {
    rows.push(["mass of the jammed cone", `${number(n.added_mass_kg * 1e3, 0)} g`]);
    rows.push(["cone / foot mass", number(n.added_mass_kg / question.set.robot.foot_mass, 1)]);
  }
  return rows;
}
