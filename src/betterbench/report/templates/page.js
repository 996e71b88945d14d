"use strict";
(() => {
  const root = document.documentElement;
  const theme = document.getElementById("theme");
  const wantsDark = window.matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : wantsDark.matches);
  const nameTheme = () => { theme.textContent = isDark() ? "Light" : "Dark"; };
  theme.hidden = false;
  theme.addEventListener("click", () => { root.dataset.theme = isDark() ? "light" : "dark"; nameTheme(); });
  wantsDark.addEventListener("change", nameTheme);
  nameTheme();

  const data = JSON.parse(document.getElementById("data").textContent);
  const text = (i) => (i < 0 ? null : data.strings[i]);
  const COLUMNS = ["policy", "task", "variation", "condition", "axis", "seed", "instruction", "success", "expected",
    "label", "first", "slot", "intended", "intention", "progress", "attempts", "rule", "why", "start", "end",
    "objects", "shared", "candidates", "steps", "duration", "record", "film"];
  const TEXTS = new Set(["policy", "task", "variation", "condition", "axis", "instruction", "expected", "label",
    "first", "slot", "intended", "rule", "why", "record"]);
  const trials = data.trials.map((row) => {
    const trial = {};
    COLUMNS.forEach((name, i) => { trial[name] = TEXTS.has(name) ? text(row[i]) : row[i]; });
    trial.place = trial.variation === null ? trial.condition : trial.variation;
    trial.key = `${trial.task}/${trial.place}/${trial.seed}`;
    return trial;
  });
  const id = (policy, key) => JSON.stringify([policy, key]);
  const byKey = new Map(trials.map((t) => [id(t.policy, t.key), t]));
  const label = (t) => data.labels[t.label] || [t.label, "system", ""];

  const make = (tag, className, content) => {
    const element = document.createElement(tag);
    if (className) element.className = className;
    if (content !== undefined && content !== null) element.textContent = content;
    return element;
  };
  const draw = (tag, attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
    Object.entries(attributes).forEach(([name, value]) => element.setAttribute(name, value));
    return element;
  };
  const swatch = (family) => make("span", `swatch ${family}`);
  const seconds = (value) => (value === null ? "–" : `${value.toFixed(1)} s`);

  const FILTERS = {
    policy: { of: (t) => t.policy, name: (v) => v },
    task: { of: (t) => t.task, name: (v) => v },
    axis: { of: (t) => t.axis || "", name: (v) => (v === "" ? "training (none)" : data.axes[v] || v) },
    condition: {
      of: (t) => `${t.task}/${t.place}`, name: (v) => v,
      also: (t, v) => t.variation === null && v === `${t.task}/training`,
    },
    label: { of: (t) => t.label, name: (v) => (data.labels[v] || [v])[0] },
    success: { of: (t) => String(t.success), name: (v) => (v === "1" ? "yes" : "no") },
  };
  const ALL = "\u0000";
  const selects = {};
  const option = (value, name) => { const o = make("option", "", name); o.value = value; return o; };
  document.querySelectorAll("select[data-filter]").forEach((select) => {
    const filter = FILTERS[select.dataset.filter];
    const counts = new Map();
    trials.forEach((t) => { const v = filter.of(t); counts.set(v, (counts.get(v) || 0) + 1); });
    let values = [...counts.keys()];
    if (select.dataset.filter === "label") {
      const order = Object.keys(data.labels);
      values.sort((a, b) => order.indexOf(a) - order.indexOf(b));
    } else if (select.dataset.filter !== "policy") values.sort();
    select.append(option(ALL, "all"));
    if (select.dataset.filter === "condition") {
      new Set(trials.filter((t) => t.variation === null).map((t) => `${t.task}/training`))
        .forEach((v) => select.append(option(v, `${v} (all)`)));
    }
    values.forEach((v) => select.append(option(v, `${filter.name(v)} (${counts.get(v)})`)));
    select.addEventListener("change", show);
    selects[select.dataset.filter] = select;
  });

  const list = document.getElementById("list");
  const count = document.getElementById("count");
  const CHUNK = 60;
  let found = [];
  let drawn = 0;

  function show() {
    const wanted = Object.entries(selects).filter(([, s]) => s.value !== ALL).map(([n, s]) => [FILTERS[n], s.value]);
    found = trials.filter((t) => wanted.every(([f, v]) => f.of(t) === v || (f.also && f.also(t, v))));
    const solved = found.filter((t) => t.success).length;
    count.textContent = `${found.length} of ${trials.length} trials, ${solved} successful.`;
    list.replaceChildren();
    drawn = 0;
    more();
  }
  function more() {
    const part = document.createDocumentFragment();
    found.slice(drawn, drawn + CHUNK).forEach((t) => part.append(rowOf(t)));
    drawn = Math.min(found.length, drawn + CHUNK);
    list.append(part);
  }
  function rowOf(t) {
    const row = make("div", "trial");
    const button = make("button");
    button.type = "button";
    button.setAttribute("aria-expanded", "false");
    const [name, family] = label(t);
    const outcome = make("span", "cell outcome");
    outcome.append(swatch(family), make("span", "", name));
    const first = t.first === null ? "no attempt at an object" : `first grasp ${t.first}`;
    const asked = t.intended === null ? "" : `, asked ${t.intended}`;
    button.append(make("span", "arrow", "›"), make("span", "cell policy", t.policy), make("span", "cell", t.key),
      outcome, make("span", "cell first", first + asked + (t.film >= 0 ? " · film" : "")));
    button.addEventListener("click", () => {
      const open = row.toggleAttribute("data-open");
      button.setAttribute("aria-expanded", String(open));
      if (open) row.append(detailOf(t)); else row.lastElementChild.remove();
    });
    row.append(button);
    return row;
  }
  function detailOf(t) {
    const box = make("div", "open");
    box.append(make("p", "why", t.why), make("p", "", `“${t.instruction}”`));
    const facts = [`expected: ${(t.expected || "").replace("_", " ")}`, `rule: ${t.rule}`,
      `progress ${t.progress === null ? "–" : t.progress.toFixed(2)}`, `${t.steps} steps`, seconds(t.duration)];
    if (t.shared.length) facts.push(`shares ${t.shared.map(text).join(", ")} with the target`);
    if (t.candidates.length) facts.push(`could also be: ${t.candidates.map(text).join(", ")}`);
    if (t.record !== null) facts.push(t.record);
    box.append(make("p", "facts", facts.join(" · ")));
    const times = make("div", "times");
    times.append(timeline(t, "This trial"));
    const twin = t.variation === null ? null : byKey.get(id(t.policy, `${t.task}/${t.condition}/${t.seed}`));
    if (twin) times.append(timeline(twin, `Its training twin: ${label(twin)[0].toLowerCase()}`));
    box.append(times);
    if (t.film >= 0) {
      const strips = document.querySelector(`#film-${t.film} .strips`);
      if (strips) box.append(strips.cloneNode(true));
    }
    return box;
  }
  function timeline(t, title) {
    const part = make("div");
    part.append(make("h4", "", title));
    const length = Math.max(t.duration || 0, 0.001);
    const at = (s) => `${Math.min(100, Math.max(0, (100 * s) / length))}%`;
    const svg = draw("svg", { width: "100%", height: 30, role: "img", "aria-label": "time line" });
    if (t.start !== null && t.end !== null && label(t)[1] !== "right") {
      svg.append(draw("rect", { class: "span", x: at(t.start), width: at(Math.max(t.end - t.start, length / 100)), y: 0, height: 30 }));
    }
    svg.append(draw("line", { class: "base", x1: "0", x2: "100%", y1: 15, y2: 15 }));
    t.attempts.forEach(([a, b, , , result]) => {
      if (a === null || b === null) return;
      svg.append(draw("rect", { class: `a ${text(result)}`, x: at(a), width: at(Math.max(b - a, length / 120)), y: 8, height: 14, rx: 2 }));
    });
    part.append(svg, make("p", "detail", `0 to ${seconds(t.duration)}; shaded: the evidence, from ${seconds(t.start)} to ${seconds(t.end)}`));
    const items = make("ol");
    t.attempts.forEach(([a, b, object, slot, result, secured]) => {
      const what = text(object) === null ? "air grasp" : `grasp at ${text(object)}`;
      const where = text(slot) === null ? "" : ` in slot ${text(slot)}`;
      const how = text(result) === "null" ? "" : `: ${text(result)}, ${secured ? "lifted" : "not lifted"}`;
      items.append(make("li", "", `${seconds(a)} to ${seconds(b)}, ${what}${where}${how}`));
    });
    if (t.attempts.length) part.append(items);
    return part;
  }

  document.getElementById("clear").addEventListener("click", () => {
    Object.values(selects).forEach((s) => { s.value = ALL; });
    show();
  });
  document.querySelectorAll("a.seg").forEach((segment) => segment.addEventListener("click", () => {
    Object.values(selects).forEach((s) => { s.value = ALL; });
    ["policy", "condition", "label"].forEach((name) => { selects[name].value = segment.dataset[name]; });
    show();
  }));
  document.getElementById("browser").hidden = false;
  const sentinel = document.getElementById("sentinel");
  const watch = new IntersectionObserver((seen) => {
    if (!seen.some((s) => s.isIntersecting) || drawn >= found.length) return;
    more();
    watch.unobserve(sentinel);  // observing anew reports again if the end is still near
    watch.observe(sentinel);
  }, { rootMargin: "800px" });
  watch.observe(sentinel);
  show();
})();
