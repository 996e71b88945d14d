"use strict";

const $ = (id) => document.getElementById(id);
let state = null;
let shownCode = null;

async function send(name, value = "", note = "") {
  const answer = await fetch("do", { method: "POST", body: JSON.stringify({ name, value, note }) });
  const said = await answer.json();
  if (said.error) $("message").textContent = said.error;
}

function enter(outcome) {
  const note = $("note").value.trim();
  if (outcome.name === "other" && !note) {
    $("message").textContent = "Write a note first: what happened?";
    $("note").focus();
    return;
  }
  send("enter", outcome.name, note);
  $("note").value = "";
}

function fill(list, rows) {
  list.replaceChildren(...rows);
}

function element(tag, text, kind = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

function outcomeRow(outcome) {
  const row = document.createElement("tr");
  const key = document.createElement("td");
  key.append(element("kbd", outcome.key));
  row.append(key, element("td", outcome.title, "title"), element("td", outcome.definition));
  row.addEventListener("click", () => enter(outcome));
  return row;
}

function show() {
  const stage = state.stage;
  document.body.dataset.stage = stage;
  $("code").textContent = state.code || "–";
  $("count").textContent = `trial ${state.number} of ${state.planned} · ${state.done} done`;
  $("instruction").textContent = state.instruction ? `“${state.instruction}”` : "";
  $("message").textContent = state.message || (state.armed ? "The arm is switched on." : `The arm is off: ${state.why_off}.`);
  $("cloth").textContent = state.cloth ? `Tablecloth: ${state.cloth}` : "";
  $("arm").textContent = state.armed ? "Switch the arm off (A)" : "Switch the arm on (A)";
  $("arm").className = state.armed ? "on" : "";
  $("start").disabled = stage !== "setup" || !state.armed;
  $("force").disabled = stage !== "setup" || !state.armed || (state.agreement !== null && state.agreement.accepted);
  $("end").disabled = stage !== "running";
  $("undo").disabled = !state.can_undo;
  $("again").disabled = stage !== "enter";
  $("release").disabled = stage === "running";
  $("time").value = Math.min(1, state.elapsed_s / state.time_limit_s);
  $("seconds").textContent = `${state.elapsed_s.toFixed(1)} of ${state.time_limit_s} s`;
  const found = stage === "setup" ? state.agreement : null;
  const match = $("match");
  match.className = found === null ? "" : found.accepted ? "good" : "bad";
  match.textContent = found === null ? "not measured yet" : `match ${found.score.toFixed(2)}: ${found.accepted ? "the scene fits" : "not yet"}`;
  fill($("off"), found === null ? [] : found.sentences.map((text) => element("li", text)));
  if (shownCode !== state.code) {
    shownCode = state.code;
    fill($("steps"), state.steps.map((step) => element("li", step.text, step.place)));
    for (const [id, path] of [["ghost", "ghost.png"], ["twin", "twin.jpg"]]) $(id).src = `${path}?${state.code}`;
    fill($("outcomes"), state.outcomes.map(outcomeRow));
    $("wristbox").hidden = !state.cameras.includes("wrist");
  }
}

async function watch() {
  for (;;) {
    try {
      state = await (await fetch("state")).json();
      show();
      if (state.stage === "done") return;
    } catch (problem) {
      $("message").textContent = "The program does not answer. The arm does not move; start better real run again.";
    }
    await new Promise((done) => setTimeout(done, 200));
  }
}

// The next image is requested when the last one has arrived, so that requests do not pile up on a slow connection.
async function picture(id, camera, everyMs) {
  for (let n = 0; ; n++) {
    const next = new Image();
    next.src = `${camera}.jpg?${n}`;
    try {
      await next.decode();
      $(id).src = next.src;
    } catch (problem) {
      await new Promise((done) => setTimeout(done, 500));
    }
    await new Promise((done) => setTimeout(done, everyMs));
  }
}

for (const name of ["start", "force", "end", "undo", "release"]) $(name).addEventListener("click", () => send(name));
$("stop").addEventListener("click", () => send("stop"));
$("arm").addEventListener("click", () => send(state && state.armed ? "disarm" : "arm"));
$("again").addEventListener("click", () => send("again", "", $("note").value));
$("strength").addEventListener("input", () => { $("ghost").style.opacity = $("strength").value / 100; });
$("ghost").style.opacity = 0.6;

document.addEventListener("keydown", (event) => {
  if (event.code === "Space" && event.target !== $("note")) {
    event.preventDefault();
    send("stop");
    return;
  }
  if (event.target === $("note") || event.repeat || event.ctrlKey || event.altKey || event.metaKey || !state) return;
  const outcome = state.stage === "enter" ? state.outcomes.find((each) => each.key === event.key) : undefined;
  if (outcome) {
    event.preventDefault();
    enter(outcome);
    return;
  }
  const plain = { KeyA: state.armed ? "disarm" : "arm", KeyS: "start", KeyE: "end", Backspace: "undo" };
  const name = event.shiftKey ? { KeyF: "force" }[event.code] : plain[event.code];
  if (name) {
    event.preventDefault();
    send(name);
  }
});

$("note").addEventListener("keydown", (event) => {
  if (event.key === "Enter" || event.key === "Escape") $("note").blur();
});
// A focused button would be pressed by the space key, which stops the arm.
document.addEventListener("click", () => { if (document.activeElement !== $("note")) document.activeElement.blur(); });
$("twin").addEventListener("load", () => {
  $("front").style.aspectRatio = `${$("twin").naturalWidth} / ${$("twin").naturalHeight}`;
});

watch();
picture("live", "front", 80);
picture("wrist", "wrist", 300);
