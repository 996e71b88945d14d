"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const last = data.times.length - 1;
  const get = (id) => document.getElementById(id);
  const make = (tag, className, content) => {
    const element = document.createElement(tag);
    if (className) element.className = className;
    if (content !== undefined) element.textContent = content;
    return element;
  };
  const SCALE = 2;
  let frame = 0;

  const views = data.views.map((view) => {
    const figure = make("figure");
    const canvas = make("canvas");
    canvas.width = SCALE * view.width;
    canvas.height = SCALE * view.height;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `View ${view.name}`);
    figure.append(canvas, make("figcaption", "", view.name));
    get("views").append(figure);
    return { ...view, canvas, loaded: new Map() };
  });
  const image = (view, kind, number) => {
    const key = kind + number;
    let found = view.loaded.get(key);
    if (!found) {
      found = new Image();
      found.addEventListener("load", () => { if (number === frame) draw(view); });
      found.src = `data:image/${kind === "pictures" ? "jpeg" : "png"};base64,${view[kind][number]}`;
      view.loaded.set(key, found);
      if (view.loaded.size > 400) view.loaded.delete(view.loaded.keys().next().value);
    }
    return found.complete && found.naturalWidth ? found : null;
  };
  function draw(view) {
    const pen = view.canvas.getContext("2d");
    const { width, height } = view.canvas;
    const picture = image(view, "pictures", frame);
    if (!picture) return;
    pen.imageSmoothingEnabled = true;
    pen.drawImage(picture, 0, 0, width, height);
    if (get("masks").checked) {
      const mask = image(view, "masks", frame);
      pen.imageSmoothingEnabled = false;
      if (mask) pen.drawImage(mask, 0, 0, width, height);
    }
    if (!get("boxes").checked) return;
    pen.font = "12px system-ui, sans-serif";
    pen.lineWidth = 1.5;
    view.boxes[frame].forEach(([object, left, top, right, bottom, seen]) => {
      const { name, color } = data.objects[object];
      const said = seen < 0.995 ? `${name} ${Math.round(100 * seen)} %` : name;
      pen.strokeStyle = `rgb(${color.join(",")})`;
      pen.strokeRect(SCALE * left, SCALE * top, SCALE * (right - left), SCALE * (bottom - top));
      const wide = pen.measureText(said).width + 6;
      const x = Math.max(0, Math.min(width - wide, SCALE * left));
      const y = SCALE * top >= 15 ? SCALE * top - 15 : SCALE * top;
      pen.fillStyle = "rgba(20,22,25,0.72)";
      pen.fillRect(x, y, wide, 15);
      pen.fillStyle = "#fff";
      pen.fillText(said, x + 3, y + 11.5);
    });
  }

  const lanes = get("lanes");
  const needle = make("div", "needle");
  const tracks = data.lanes.map((lane) => {
    const row = make("div", "lane");
    const track = make("div", "track");
    lane.spans.forEach(([first, end, said]) => {
      const span = make("div", `span ${lane.kind}`, lane.kind === "held" ? said : "");
      span.style.left = `${(100 * first) / (last + 1)}%`;
      span.style.width = `${(100 * (end + 1 - first)) / (last + 1)}%`;
      span.title = `${lane.name}: ${said}, ${data.times[first].toFixed(2)} to ${data.times[end].toFixed(2)} s`;
      track.append(span);
    });
    const name = make("div", "name", lane.name.replaceAll("_", " "));
    name.title = lane.name;
    row.append(name, track);
    lanes.append(row);
    return track;
  });
  const ticks = make("div", "lane ticks");
  const scale = make("div", "track");
  const seconds = data.times[last] || 1;
  const step = [0.5, 1, 2, 5, 10, 20, 50, 100].find((s) => seconds / s <= 12) || 500;
  for (let s = 0; s <= seconds; s += step) {
    const tick = make("span", "", `${s} s`);
    tick.style.left = `${(100 * s) / seconds}%`;
    if (s > 0.97 * seconds) tick.className = "last"; // else it ends beyond the page
    scale.append(tick);
  }
  ticks.append(make("div", "name", "time"), scale);
  lanes.append(ticks, needle);
  const ruler = tracks[0] || scale;

  function show(number) {
    frame = Math.max(0, Math.min(last, number));
    views.forEach(draw);
    for (let ahead = 1; ahead <= 8 && frame + ahead <= last; ahead += 1) {
      views.forEach((view) => { image(view, "pictures", frame + ahead); image(view, "masks", frame + ahead); });
    }
    get("clock").textContent = `${data.times[frame].toFixed(2)} s · row ${frame} of ${last}`;
    const at = ruler.offsetLeft + (ruler.clientWidth * (frame + 0.5)) / (last + 1);
    needle.style.left = `${at}px`;
    lanes.setAttribute("aria-valuemax", String(last));
    lanes.setAttribute("aria-valuenow", String(frame));
    lanes.setAttribute("aria-valuetext", `${data.times[frame].toFixed(2)} s`);
  }

  let playing = false;
  let began = 0;
  let from = 0;
  function play(wanted) {
    playing = wanted;
    get("play").textContent = playing ? "Pause" : "Play";
    if (!playing) return;
    if (frame === last) show(0);
    began = performance.now();
    from = data.times[frame];
    requestAnimationFrame(tick);
  }
  function tick(now) {
    if (!playing) return;
    const time = from + ((now - began) / 1000) * Number(get("speed").value);
    let number = frame;
    while (number < last && data.times[number + 1] <= time) number += 1;
    if (number !== frame) show(number);
    if (number === last) play(false); else requestAnimationFrame(tick);
  }
  get("play").addEventListener("click", () => play(!playing));
  get("speed").addEventListener("change", () => { if (playing) play(true); });
  ["masks", "boxes"].forEach((id) => get(id).addEventListener("change", () => views.forEach(draw)));
  const move = (event) => {
    const box = ruler.getBoundingClientRect();
    play(false);
    show(Math.floor(((event.clientX - box.left) / box.width) * (last + 1)));
  };
  lanes.addEventListener("pointerdown", (event) => { lanes.setPointerCapture(event.pointerId); move(event); });
  lanes.addEventListener("pointermove", (event) => { if (event.buttons) move(event); });
  document.addEventListener("keydown", (event) => {
    if (/SELECT|BUTTON|INPUT/.test(document.activeElement.tagName) && event.key === " ") return;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) { play(false); show(frame + step); event.preventDefault(); }
    if (event.key === " ") { play(!playing); event.preventDefault(); }
  });
  window.addEventListener("resize", () => show(frame));
  const asked = () => show(Number(new URLSearchParams(location.hash.slice(1)).get("row")) || 0);
  window.addEventListener("hashchange", asked);
  asked();  // "#row=120" opens the page there
})();
