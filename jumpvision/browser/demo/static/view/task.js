// The task that was chosen: its words, and how the jump shown stands to it. It lies in the page's state (state.task).
import { BOUNCE, CHALLENGES, FLIGHT, SEALED, judge, landing } from "../play/challenges.js";
import { MOST, NOISE } from "../play/world.js";
import { mm, number, t } from "../words.js";
import { Sealed, anyWorld } from "./sealed.js";

const $ = (id) => document.getElementById(id);

export class Task {
  // on: chosen() after the task has changed, and what Sealed takes.
  constructor(on) {
    this.sealed = new Sealed($("sealed"), on);
    $("challenge").onchange = () => on.chosen($("challenge").value);
  }

  // The list, in the language of the page.
  name(task) {
    $("challenge").replaceChildren(...["", ...Object.keys(CHALLENGES), SEALED].map((c) => Object.assign(document.createElement("option"), { value: c, textContent: t(c ? `c_${c}` : "free") })));
    $("challenge").value = task;
  }

  // Puts a task into a state.
  set(state, task) {
    state.task = task;
    if (task !== SEALED) state.world = null;
    else if (!state.world) Object.assign(state, { world: anyWorld(), sand: "drag" });
    $("challenge").value = task;
  }

  tell({ numbers, motion, question }, state) {
    const { task } = state, sealed = task === SEALED;
    $("doing").hidden = !task;
    $("judged").hidden = !task;
    $("sealed").hidden = !sealed;
    if (!task) return;
    const holes = sealed ? { n: state.world.number, most: MOST, noise: `${number(NOISE * 1e3, 1)}\u00a0mm` } : { mm: mm(FLIGHT), most: mm(BOUNCE) };
    $("doing").textContent = t(`c_${task}_do`, holes);
    if (sealed) {
      this.sealed.show(state, motion);
      $("judged").textContent = this.sealed.sentence(state);
      return;
    }
    numbers.stuck ??= landing(motion, numbers.flights, question.set.robot.gravity);
    const verdict = judge(task, numbers, state), { flight, bounce } = numbers.stuck;
    const reached = task === "stick" ? t("stuck", { flight: mm(flight), bounce: mm(bounce) }) : `${mm(numbers.jump_height_m)}, ${number(numbers.peak_power_W, 2)}\u00a0W`;
    $("judged").textContent = verdict === "won" ? `${t("won")} ${reached}` : verdict === "not_yet" ? t("not_yet", { reached }) : t("not_allowed", { what: t(verdict) });
  }
}
