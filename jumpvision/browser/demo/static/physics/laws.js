// The laws of the beds by name, from symbols and parameters in SI units to the static and the whole force on
// the intruding foot [N], the mass that moves with it [kg] and the radius of its flat face [m]. Written from the
// package's mechanisms by jumpvision.browser.demo.laws: change them there.

const cone = (s) => {
  const t3 = Math.min(s.z, s.delta);
  const t4 = s.k1 * t3;
  const t6 = s.z - s.delta;
  const t8 = Math.max(t6, (0.0));
  const t9 = s.k2 * t8;
  const t10 = t4 + t9;
  const t14 = s.C * s.phi;
  const t16 = t14 * s.rho;
  const t18 = t16 * s.mu;
  const t22 = Math.tan(s.theta);
  const t23 = s.mu / t22;
  const t24 = t23 * s.z;
  const t25 = s.R - t24;
  const t26 = Math.max(t25, (0.0));
  const t28 = t26 * t26;
  const t29 = (3.141592653589793) * t28;
  const t30 = t18 * t29;
  const t31 = s.b * t30;
  const t33 = s.v * s.v;
  const t34 = t31 * t33;
  const t35 = t10 + t34;
  const t36 = (3.141592653589793) * t22;
  const t38 = (3.0) * s.mu;
  const t39 = t36 / t38;
  const t40 = s.R * s.R * s.R;
  const t41 = t26 * t26 * t26;
  const t42 = t40 - t41;
  const t43 = t39 * t42;
  const t44 = t18 * t43;
  return { static: t10, force: t35, mass: t44, radius: t26 };
};

const drag = (s) => {
  const t3 = Math.min(s.z, s.delta);
  const t4 = s.k1 * t3;
  const t6 = s.z - s.delta;
  const t8 = Math.max(t6, (0.0));
  const t9 = s.k2 * t8;
  const t10 = t4 + t9;
  const t14 = s.v * s.v;
  const t15 = s.alpha * t14;
  const t16 = t10 + t15;
  const t20 = Math.tan(s.theta);
  const t21 = s.mu / t20;
  const t22 = t21 * s.z;
  const t23 = s.R - t22;
  const t24 = Math.max(t23, (0.0));
  return { static: t10, force: t16, mass: (0.0), radius: t24 };
};

const drag_cone = (s) => {
  const t3 = Math.min(s.z, s.delta);
  const t4 = s.k1 * t3;
  const t6 = s.z - s.delta;
  const t8 = Math.max(t6, (0.0));
  const t9 = s.k2 * t8;
  const t10 = t4 + t9;
  const t14 = s.v * s.v;
  const t15 = s.alpha * t14;
  const t16 = t10 + t15;
  const t19 = s.C * s.phi;
  const t21 = t19 * s.rho;
  const t23 = t21 * s.mu;
  const t26 = Math.tan(s.theta);
  const t27 = (3.141592653589793) * t26;
  const t29 = (3.0) * s.mu;
  const t30 = t27 / t29;
  const t32 = s.R * s.R * s.R;
  const t33 = s.mu / t26;
  const t34 = t33 * s.z;
  const t35 = s.R - t34;
  const t36 = Math.max(t35, (0.0));
  const t37 = t36 * t36 * t36;
  const t38 = t32 - t37;
  const t39 = t30 * t38;
  const t40 = t23 * t39;
  return { static: t10, force: t16, mass: t40, radius: t36 };
};

export default { cone, drag, drag_cone };
