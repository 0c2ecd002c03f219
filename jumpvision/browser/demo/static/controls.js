import { t } from "./words.js";

// Sliders as page.js declares them. A value is kept in SI units; it is shown times `factor`, in `unit`.
const digits = (step) => Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));

const el = (tag, props = {}, ...children) => {
  const node = Object.assign(document.createElement(tag), props);
  node.append(...children);
  return node;
};

function row(slider, change) {
  const id = `s-${slider.key}`;
  const range = el("input", { type: "range", id, min: slider.lo, max: slider.hi, step: slider.step });
  const number = el("input", { type: "number", step: "any", id: `${id}-n` });
  const unit = el("span", { className: "unit", textContent: slider.unit });
  const wrong = el("p", { className: "wrong", id: `${id}-wrong`, hidden: true });
  number.setAttribute("aria-label", `${t(`s_${slider.key}`)}, ${slider.unit || t("number")}`);
  number.setAttribute("aria-describedby", wrong.id);
  range.setAttribute("aria-describedby", wrong.id);
  const node = el("div", { className: "row" }, el("label", { htmlFor: id, textContent: t(`s_${slider.key}`) }),
    el("span", { className: "value" }, number, unit), range, wrong);
  node.dataset.key = slider.key;
  const say = (shown) => range.setAttribute("aria-valuetext", `${shown} ${slider.unit}`);
  range.oninput = () => { number.value = range.value; say(range.value); change(slider, Number(range.value) / slider.factor); };
  number.oninput = () => {
    const shown = number.value === "" ? null : Number(number.value);
    if (shown !== null) { range.value = shown; say(shown); }
    change(slider, shown === null ? null : shown / slider.factor);
  };
  const set = (value) => {
    const shown = Number((value * slider.factor).toFixed(digits(slider.step) + 1));
    number.value = shown;
    range.value = shown;
    say(shown);
  };
  const fail = (text) => {
    node.classList.toggle("bad", Boolean(text));
    number.setAttribute("aria-invalid", String(Boolean(text)));
    wrong.hidden = !text;
    wrong.textContent = text || "";
    if (text) node.closest("details").open = true;
  };
  return { slider, node, set, fail };
}

export function build(form, page, on, isShown) {
  form.replaceChildren();
  const narrow = matchMedia("(max-width: 46rem)").matches; // a phone shows one group at first
  form.onsubmit = (event) => event.preventDefault();
  const rows = page.sliders.map((s) => row(s, on.change));
  const two = el("input", { type: "checkbox", id: "two" });
  two.onchange = () => on.two(two.checked);
  const sand = el("fieldset", { className: "choice", id: "sand" }, el("legend", { textContent: t("sand_law") }),
    ...Object.keys(page.sand).map((value) => {
      const input = el("input", { type: "radio", name: "sand", value });
      input.onchange = () => on.sand(value);
      return el("label", {}, input, el("span", { textContent: t(value) }));
    }));
  const why = el("p", { className: "why", textContent: t("why_g") });
  for (const name of [...new Set(page.sliders.map((s) => s.group))]) {
    const box = el("details", { open: name === "Motor" || !narrow }, el("summary", { textContent: t(name) }));
    if (name === "Ground") box.append(sand);
    for (const r of rows.filter((r) => r.slider.group === name)) {
      if (r.slider.key === "frequency2") box.append(el("label", { className: "check" }, two, t("two")));
      box.append(r.node);
      if (r.slider.key === "gravity") box.append(why);
    }
    form.append(box);
  }
  const reset = el("button", { type: "button", className: "foot", textContent: t("reset") });
  reset.onclick = on.reset;
  form.append(reset);
  return {
    show(state) {
      for (const r of rows) {
        const { section, key } = r.slider;
        r.node.hidden = !isShown(r.slider, state);
        const value = key === "frequency2" ? state.frequency2 : state.set[section]?.[key];
        if (value !== undefined && value !== null) r.set(value);
        r.fail("");
      }
      two.checked = state.two;
      why.hidden = state.ground !== "hard"; // on sand gravity is whole
      sand.hidden = state.ground !== "granular";
      for (const input of sand.querySelectorAll("input")) input.checked = input.value === state.sand;
    },
    // Each problem at the fields that it names.
    fail(problems) {
      for (const r of rows) r.fail(problems.find((p) => p.keys.includes(r.slider.key))?.text);
    },
    set(key, value) { rows.find((r) => r.slider.key === key).set(value); },
    range(key) { const s = rows.find((r) => r.slider.key === key).slider; return [s.lo / s.factor, s.hi / s.factor]; },
  };
}
