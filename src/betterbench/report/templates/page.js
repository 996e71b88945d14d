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
    "objects", "shared", "candidates", "steps", "duration", "record", "film", "needless", "needlessAt"];
  const TEXTS = new Set(["policy", "task", "variation", "condition", "axis", "instruction", "expected", "label",
    "first", "slot", "intended", "rule", "why", "record"]);
  const trials = data.trials.map((row) => {
    const trial = {};
    COLUMNS.forEach((name, i) => { trial[name] = TEXTS.has(name) ? text(row[i]) : row[i]; });
    trial.place = trial.variation === null ? trial.condition : trial.variation;
    trial.key = `${trial.task}/${trial.place}/${trial.seed}`;
    trial.kind = (data.labels[trial.label] || [null, "system"])[1];
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
    kind: { of: (t) => t.kind, name: (v) => data.kinds[v] || v },
    label: { of: (t) => t.label, name: (v) => (data.labels[v] || [v])[0] },
    seed: { of: (t) => String(t.seed), name: (v) => v },
  };
  const ORDERS = { kind: Object.keys(data.kinds), label: Object.keys(data.labels), axis: ["", ...Object.keys(data.axes)] };
  const ALL = "\u0000";
  const selects = {};
  const option = (value, name) => { const o = make("option", "", name); o.value = value; return o; };
  document.querySelectorAll("select[data-filter]").forEach((select) => {
    const filter = FILTERS[select.dataset.filter];
    const counts = new Map();
    trials.forEach((t) => { const v = filter.of(t); counts.set(v, (counts.get(v) || 0) + 1); });
    const values = [...counts.keys()];
    const order = ORDERS[select.dataset.filter];
    if (order) values.sort((a, b) => order.indexOf(a) - order.indexOf(b));
    else if (select.dataset.filter === "seed") values.sort((a, b) => a - b);
    else if (select.dataset.filter !== "policy") values.sort();
    select.append(option(ALL, "all"));
    if (select.dataset.filter === "condition") {
      new Set(trials.filter((t) => t.variation === null).map((t) => `${t.task}/training`))
        .forEach((v) => select.append(option(v, `${v} (all)`)));
    }
    values.forEach((v) => select.append(option(v, `${filter.name(v)} (${counts.get(v)})`)));
    select.addEventListener("change", show);
    select.parentElement.hidden = counts.size < 2;
    selects[select.dataset.filter] = select;
  });

  const early = (a, b) => (a === null ? Infinity : a) - (b === null ? Infinity : b) || 0;
  const KINDS = ["reasoning", "execution", "system", "unfinished", "right"];
  const place = (t) => KINDS.indexOf(t.kind) + (t.variation === null ? KINDS.length : 0);
  const rank = (t) => Object.keys(data.labels).indexOf(t.label);
  const SORTS = {
    "failures first": (a, b) => place(a) - place(b),
    "outcome": (a, b) => (a.kind === "right") - (b.kind === "right") || rank(a) - rank(b),
    "plan order": null,
    "seed": (a, b) => a.seed - b.seed,
    "time of the evidence": (a, b) => early(a.start, b.start),
    "duration, longest first": (a, b) => (b.duration || 0) - (a.duration || 0),
    "progress, least first": (a, b) => early(a.progress, b.progress),
  };
  const sort = document.getElementById("sort");
  Object.keys(SORTS).forEach((name) => sort.append(option(name, name)));
  sort.addEventListener("change", show);
  const search = document.getElementById("search");
  search.addEventListener("input", show);
  trials.forEach((t) => {
    t.words = [t.policy, t.key, t.instruction, t.first, t.intended, t.slot, t.rule, t.why, label(t)[0]].join(" ").toLowerCase();
  });

  const list = document.getElementById("list");
  const count = document.getElementById("count");
  const CHUNK = 60;
  const several = new Set(trials.map((t) => t.policy)).size > 1;
  list.classList.toggle("one", !several);
  let found = [];
  let drawn = 0;

  function show() {
    const wanted = Object.entries(selects).filter(([, s]) => s.value !== ALL).map(([n, s]) => [FILTERS[n], s.value]);
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    found = trials.filter((t) => wanted.every(([f, v]) => f.of(t) === v || (f.also && f.also(t, v)))
      && words.every((w) => t.words.includes(w)));
    if (SORTS[sort.value]) found.sort(SORTS[sort.value]);
    const counted = found.filter((t) => t.expected !== "ambiguous");
    const solved = counted.filter((t) => t.success).length;
    const rest = found.length - counted.length;
    const aside = rest ? `, ${rest} ambiguous and not counted` : "";
    count.textContent = `${found.length} of ${trials.length} trials, ${solved} successful${aside}.`;
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
  function clear() {
    Object.values(selects).forEach((s) => { s.value = ALL; });
    search.value = "";
    sort.selectedIndex = 0;
  }
  const link = (href, content) => { const a = make("a", "", content); a.href = href; return a; };
  const routeOf = (t) => `#trial=${encodeURIComponent(t.policy)}/${t.key}`;
  function rowOf(t) {
    const row = make("div", "trial");
    const button = make("button");
    button.type = "button";
    button.setAttribute("aria-expanded", "false");
    const [name, family] = label(t);
    const outcome = make("span", "cell outcome");
    outcome.append(swatch(family), make("span", "", name));
    const none = "reasoning" in data.kinds ? "no attempt at an object" : ""; // else attempts are not judged
    const first = t.first === null ? none : `first grasp ${t.first}`;
    const asked = t.intended === null ? "" : `, asked ${t.intended}`;
    const said = t.kind === "right" ? first + asked : t.why;
    button.append(make("span", "arrow", "›"));
    if (several) button.append(make("span", "cell policy", t.policy));
    button.append(make("span", "cell key", t.key), outcome,
      make("span", "cell first", (t.film >= 0 ? "Film. " : "") + said));
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
    t.needless.forEach((said, i) => box.append(make("p", "", `Needless step at ${seconds(t.needlessAt[i])}: ${text(said)}`)));
    const times = make("div", "times");
    times.append(timeline(t, "This trial"));
    const twin = t.variation === null ? null : byKey.get(id(t.policy, `${t.task}/${t.condition}/${t.seed}`));
    if (twin) times.append(timeline(twin, `Its training twin: ${label(twin)[0].toLowerCase()}`));
    box.append(times);
    const go = make("p", "go");
    go.append(link(routeOf(t), "Link to this trial"), link(`#task=${t.task}`, "Its task"));
    if (twin) go.append(link(routeOf(twin), "Open the twin"));
    if (t.film >= 0) go.append(link(`#film-${t.film}`, "Its film"));
    box.append(go);
    if (t.film < 0) {
      const pair = make("div", "pathpair");
      [[t, "This trial"], [twin, "Its training twin"]].forEach(([one, title]) => {
        const image = one && data.paths[`${one.policy} ${one.key}`];
        if (!image) return;
        const figure = make("figure");
        const picture = make("img");
        picture.src = `data:image/jpeg;base64,${image}`;
        picture.alt = `Start of ${one.key} with the path of the end effector`;
        figure.append(make("figcaption", "", `${title}: “${one.instruction}”`), picture);
        pair.append(figure);
      });
      if (pair.children.length) box.append(pair);
    }
    if (t.record !== null && data.replay[t.policy]) {
      const command = make("p", "replay");
      command.append(make("span", "", "Replay this "), make("code", "", `${data.replay[t.policy]}${t.record} --twin${data.options}`));
      box.append(command);
    }
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
    const said = t.attempts.length === 1 ? "1 grasp attempt" : `${t.attempts.length} grasp attempts`;
    const svg = draw("svg", { width: "100%", height: 46, role: "img", "aria-label": `Time line of ${t.key}: ${said} in ${seconds(t.duration)}` });
    const step = [1, 2, 5, 10, 20, 50, 100].find((s) => length / s <= 8) || 500;
    for (let s = 0; s <= length; s += step) {
      svg.append(draw("line", { class: "sec", x1: at(s), x2: at(s), y1: 4, y2: 32 }));
      const tick = draw("text", { x: at(s), y: 44, style: s === 0 ? "text-anchor:start" : s > 0.95 * length ? "text-anchor:end" : "" });
      tick.textContent = `${s} s`;
      svg.append(tick);
    }
    if (t.start !== null && t.end !== null && t.kind !== "right") {
      svg.append(draw("rect", { class: "span", x: at(t.start), width: at(Math.max(t.end - t.start, length / 100)), y: 0, height: 34 }));
    }
    svg.append(draw("line", { class: "base", x1: "0", x2: "100%", y1: 18, y2: 18 }));
    t.attempts.forEach(([a, b, object, , result]) => {
      if (a === null || b === null) return;
      const kind = text(result);
      const mark = draw("svg", { x: at(a), y: 11, width: 14, height: 14, overflow: "visible" });
      const shape = kind === "distractor" ? draw("path", { d: "M1 13 7 1 13 13Z" })
        : kind === "null" ? draw("circle", { cx: 7, cy: 7, r: 5.5 })
          : draw("rect", { x: 1, y: 1, width: 11, height: 12 });
      shape.setAttribute("class", `a ${kind}`);
      const hint = draw("title", {});
      hint.textContent = `${seconds(a)}: ${text(object) === null ? "air grasp" : text(object)}`;
      shape.append(hint);
      mark.append(shape);
      svg.append(draw("rect", { class: `a ${kind}`, x: at(a), width: at(Math.max(b - a, length / 200)), y: 28, height: 4 }), mark);
    });
    const evidence = t.kind === "right" || t.start === null ? "" : `; shaded: the evidence, from ${seconds(t.start)} to ${seconds(t.end)}`;
    part.append(svg, make("p", "detail", `0 to ${seconds(t.duration)}${evidence}`));
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

  document.getElementById("clear").addEventListener("click", () => { clear(); show(); });
  document.querySelectorAll("a.seg").forEach((segment) => segment.addEventListener("click", () => {
    clear();
    const { policy, condition, label: outcome } = segment.dataset;
    selects.policy.value = policy;
    selects.label.value = outcome;
    if (condition.includes("/")) selects.condition.value = condition;
    else if (condition) selects.task.value = condition;
    show();
  }));
  const rows = () => [...list.querySelectorAll(".trial > button")];
  list.addEventListener("keydown", (event) => {
    const button = event.target.closest(".trial")?.firstElementChild;
    if (!button) return;
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      const all = rows();
      const next = all[all.indexOf(button) + (event.key === "ArrowDown" ? 1 : -1)];
      if (next) { next.focus(); event.preventDefault(); }
    } else if (event.key === "Escape" && button.parentElement.hasAttribute("data-open")) {
      button.click();
      button.focus();
    }
  });
  document.addEventListener("keydown", (event) => {
    if (event.key !== "/" || event.ctrlKey || event.metaKey || /INPUT|SELECT|TEXTAREA/.test(document.activeElement.tagName)) return;
    if (document.getElementById("trials").hasAttribute("data-away")) location.hash = "#trials";
    search.focus();
    event.preventDefault();
  });

  const sections = [...document.querySelectorAll("main > section")];
  function route() {
    let wanted = "";
    try { wanted = decodeURIComponent(location.hash.slice(1)); } catch { /* a broken address shows the overview */ }
    const target = document.getElementById(wanted);
    const view = target ? target.closest("section.taskview") : null;
    sections.forEach((s) => s.toggleAttribute("data-away", view ? s !== view : s.classList.contains("taskview")));
    if (wanted.startsWith("trial=")) openTrial(wanted.slice(6).split("/"));
    else if (target) target.scrollIntoView({ behavior: "instant" });
  }
  function openTrial(parts) {
    const wanted = byKey.get(id(parts.slice(0, -3).join("/"), parts.slice(-3).join("/")));
    document.getElementById("trials").scrollIntoView({ behavior: "instant" });
    if (!wanted) return;
    clear();
    show();
    const at = found.indexOf(wanted);
    while (drawn <= at) more();
    const row = list.children[at];
    if (!row.hasAttribute("data-open")) row.firstElementChild.click();
    row.firstElementChild.focus({ preventScroll: true });
    row.scrollIntoView({ behavior: "instant" });
  }
  window.addEventListener("hashchange", route);

  document.querySelectorAll("video.clip").forEach((clip) => {
    clip.addEventListener("error", () => clip.classList.add("broken"));  // the stills below show the same
    if (clip.error || !clip.canPlayType("video/mp4; codecs=avc1.64000a")) clip.classList.add("broken");
  });
  document.querySelectorAll("a.cell-film").forEach((cell) => {
    const clip = document.querySelector(`${cell.hash} video.clip`);
    if (!clip || clip.classList.contains("broken")) return;
    cell.addEventListener("pointerenter", () => {  // the film plays in its cell; a click leads to it
      if (cell.querySelector("video")) return;
      const film = document.createElement("video");
      Object.assign(film, { src: clip.src, muted: true, loop: true, playsInline: true });
      film.addEventListener("loadeddata", () => { cell.replaceChildren(film); film.play(); }, { once: true });
    });
  });
  document.querySelectorAll("button[data-png]").forEach((button) => {
    button.hidden = false;
    button.addEventListener("click", () => {
      const picture = new Image();
      picture.addEventListener("load", () => {
        const canvas = document.createElement("canvas");
        canvas.width = 3 * picture.naturalWidth;
        canvas.height = 3 * picture.naturalHeight;
        canvas.getContext("2d").drawImage(picture, 0, 0, canvas.width, canvas.height);
        const save = link(canvas.toDataURL("image/png"), "");
        save.download = `${button.dataset.png}.png`;
        save.click();
      });
      picture.src = button.parentElement.querySelector("a").href;
    });
  });
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
  route();
})();
