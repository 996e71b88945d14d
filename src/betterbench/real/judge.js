"use strict";

const $ = (id) => document.getElementById(id);
let state = null;
let shown = null;
const GONE = "The program does not answer: nothing was entered. Start better real judge again, and open its new address.";

async function send(name, value = "") {
  const note = name === "enter" ? $("note").value.trim() : "";
  let said;
  try {
    const answer = await fetch("do", { method: "POST", body: JSON.stringify({ name, film: state.film, value, note }) });
    said = await answer.json();
  } catch (problem) {
    said = { error: GONE };
  }
  if (said.error) say(said.error, true);
  else {
    if (said.film !== state.film) $("note").value = "";
    show(said);
  }
}

function say(text, isProblem) {
  $("message").textContent = text;
  $("message").className = isProblem ? "problem" : "";
}

function element(tag, text) {
  const made = document.createElement(tag);
  made.textContent = text;
  return made;
}

function outcomeRow(outcome) {
  const row = document.createElement("tr");
  const key = document.createElement("td");
  const text = document.createElement("td");
  key.append(element("kbd", outcome.key));
  text.append(element("b", outcome.title), element("span", outcome.definition));
  row.append(key, text);
  row.className = outcome.name === state.chosen ? "chosen" : "";
  row.addEventListener("click", () => send("enter", outcome.name));
  return row;
}

function film(place) {
  const made = document.createElement("video");
  Object.assign(made, { autoplay: true, loop: true, muted: true, controls: true, playsInline: true });
  made.addEventListener("error", () => {
    const told = element("p", "This video cannot be shown. Its file is missing or was changed; the terminal names it.");
    made.replaceWith(told);
  });
  made.src = `film/${state.film}/${place}`;
  return made;
}

function show(now) {
  state = now;
  $("count").textContent = `film ${state.film + 1} of ${state.films} · ${state.judged} judged · ${state.person}`;
  $("done").value = state.judged / state.films;
  $("instruction").textContent = `“${state.instruction}”`;
  say(state.message, state.is_problem);
  $("outcomes").replaceChildren(...state.outcomes.map(outcomeRow));
  if (shown !== state.film) {
    const films = [...Array(state.cameras).keys()].map(film);
    $("films").replaceChildren(...(films.length ? films : [element("p", "This trial has no video.")]));
    shown = state.film;
  }
}

document.addEventListener("keydown", (event) => {
  if (!state || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.id === "note") {
    if (event.key === "Escape" || event.key === "Enter") event.target.blur();
    return;
  }
  const outcome = state.outcomes.find((found) => found.key === event.key);
  const names = { Backspace: "undo", ArrowLeft: "previous", ArrowRight: "next" };
  if (outcome) send("enter", outcome.name);
  else if (names[event.key]) send(names[event.key]);
  else if (event.key === " ") document.querySelectorAll("video").forEach((video) => { video.currentTime = 0; video.play(); });
  else return;
  event.preventDefault();
});

fetch("state").then((answer) => answer.json()).then(show).catch(() => say(GONE, true));
