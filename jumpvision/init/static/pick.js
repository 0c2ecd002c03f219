// Shows each picture with its tools. Pixel centres are at integers; columns run right, rows down.
const page = await (await fetch("api/pictures")).json();
document.querySelector("#folder").textContent = page.folder;
const shown = page.pictures.map(show);

function element(name, attributes = {}, ...children) {
  const e = Object.assign(document.createElement(name), attributes);
  e.append(...children);
  return e;
}

function show(picture) {
  const [rows, columns] = picture.shape;
  const canvas = element("canvas");
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `First frame of ${picture.file}; its numbers can be typed beside it`);
  const image = new Image();
  const tools = picture.tools.map((tool) => {
    const inputs = Array.from({ length: tool.numbers }, (_, i) => {
      const input = element("input", { type: "number", step: "any", id: `${picture.section}-${tool.key}-${i}` });
      const names = tool.numbers === 1 ? "" : [" column", " row"][i % 2] + (tool.numbers === 4 ? ` ${1 + (i >> 1)}` : "");
      input.setAttribute("aria-label", tool.label + names);
      input.addEventListener("input", draw);
      return input;
    });
    const box = element("fieldset", {}, element("legend", { textContent: tool.label }), ...inputs);
    const clicks = !["distance", "ball_diameter"].includes(tool.key);
    const made = { ...tool, inputs, box, clicks, next: 0 };
    if (clicks) box.addEventListener("focusin", () => activate(made));
    if (clicks) box.addEventListener("click", () => activate(made));
    return made;
  });
  let active = tools.find((t) => t.clicks);
  const zoom = element("select", { id: `${picture.section}-zoom` });
  zoom.setAttribute("aria-label", "Magnification");
  const frame = element("div", { className: "frame", tabIndex: 0 }, canvas);
  const section = element("section", { id: picture.section },
    element("div", {}, element("h2", { textContent: `[${picture.section}] ${picture.file}` }),
      element("p", { textContent: picture.facts }), frame),
    element("div", {}, element("label", {}, "Magnification ", zoom), ...tools.map((t) => t.box)));
  document.querySelector("#pictures").append(section);
  const fit = Math.max(0.1, Math.min(8, frame.clientWidth / columns, 500 / rows));
  for (const k of [...new Set([Number(fit.toFixed(2)), 0.5, 1, 2, 4, 8])]) {
    zoom.append(element("option", { value: k, textContent: `${k} x` }));
  }
  zoom.addEventListener("change", draw);
  canvas.addEventListener("click", (event) => {
    const box = canvas.getBoundingClientRect();
    const k = Number(zoom.value);
    const place = [event.clientX - box.left, event.clientY - box.top].map((v) => (v / k - 0.5).toFixed(1));
    if (active.numbers === 1) active.inputs[0].value = place[1];
    else {
      active.inputs[active.next].value = place[0];
      active.inputs[active.next + 1].value = place[1];
      active.next = (active.next + 2) % active.numbers;
    }
    draw();
  });
  image.addEventListener("load", draw);
  image.src = `picture/${picture.section}.png`;
  activate(active);

  function activate(tool) {
    active = tool;
    for (const t of tools) t.box.classList.toggle("active", t === tool);
  }

  function draw() {
    const k = Number(zoom.value), c = canvas.getContext("2d");
    canvas.width = Math.round(columns * k);
    canvas.height = Math.round(rows * k);
    c.imageSmoothingEnabled = false;
    c.drawImage(image, 0, 0, canvas.width, canvas.height);
    c.lineWidth = 1.5;
    for (const t of tools.filter((t) => t.clicks)) {
      const v = t.inputs.map((i) => (i.value === "" ? NaN : (Number(i.value) + 0.5) * k));
      c.strokeStyle = c.fillStyle = t.key === "marks" ? "#e69f00" : "#56b4e9";
      c.beginPath();
      if (t.numbers === 1 && !Number.isNaN(v[0])) { c.moveTo(0, v[0]); c.lineTo(canvas.width, v[0]); }
      for (let i = 0; i + 1 < v.length; i += 2) {
        if (Number.isNaN(v[i] + v[i + 1])) continue;
        c.moveTo(v[i] - 9, v[i + 1]); c.lineTo(v[i] + 9, v[i + 1]);
        c.moveTo(v[i], v[i + 1] - 9); c.lineTo(v[i], v[i + 1] + 9);
      }
      if (t.numbers === 4 && !v.some(Number.isNaN)) {
        if (t.key === "roi") c.rect(v[0], v[1], v[2] - v[0], v[3] - v[1]);
        else { c.moveTo(v[0], v[1]); c.lineTo(v[2], v[3]); }
      }
      c.stroke();
    }
  }

  return { section: picture.section, tools };
}

document.querySelector("#save").addEventListener("click", async () => {
  const answer = {}, said = document.querySelector("#said");
  for (const { section, tools } of shown) {
    answer[section] = {};
    for (const t of tools) {
      const values = t.inputs.filter((i) => i.value !== "").map((i) => Number(i.value));
      if (values.length) answer[section][t.key] = t.numbers === 1 ? values[0] : values;
    }
  }
  const reply = await fetch("api/picks", {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify(answer),
  });
  if (reply.ok) {
    said.textContent = "Written. This page can be closed.";
    document.querySelector("#save").disabled = true;
  } else said.textContent = (await reply.json()).problems.join("; ");
});
