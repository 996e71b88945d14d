// Script of a viser page: reads the keyboard, the gamepads and the SpaceMice of the user's computer.
// It writes the input as JSON into a hidden text field of the panel, whose value viser sends to the server.
(() => {
  if (window.betterPage) return;
  const MARK = __MARK__;
  const PUSH = __PUSH_KEYS__;
  const TAPS = __TAP_KEYS__;
  // Buttons of a standard gamepad (W3C Gamepad, "standard" mapping).
  const BUTTONS = __BUTTONS__;
  const me = (window.betterPage = { held: new Set(), taps: {}, push: [0, 0, 0, 0, 0, 0], slow: false, n: 0 });
  let sent = "", sentAt = 0;

  const field = () => {
    const found = [...document.querySelectorAll("input")].find((e) => e.value.startsWith(MARK));
    if (found && !found.dataset.hidden) {
      let row = found;
      while (row.parentElement && row.parentElement.querySelectorAll("input, button, img").length === 1)
        row = row.parentElement;
      row.style.display = "none";
      found.dataset.hidden = "1";
    }
    return found;
  };
  const write = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
  const send = () => {
    const to = field();
    if (!to) return;
    me.n += 1;
    const form = { held: [...me.held], taps: me.taps, push: me.push, slow: me.slow, n: me.n };
    sent = JSON.stringify({ ...form, n: 0 });
    sentAt = performance.now();
    write.call(to, MARK + JSON.stringify(form));
    to.dispatchEvent(new Event("input", { bubbles: true }));
  };
  const tap = (name) => {
    me.taps[name] = (me.taps[name] || 0) + 1;
    send();
  };
  const typing = (event) => {
    const e = event.target;
    return e && (e.isContentEditable || (e.tagName === "INPUT" && e.type !== "range" && !e.dataset.hidden));
  };
  const onKey = (event) => {
    if (typing(event) || event.ctrlKey || event.metaKey || event.altKey) return;
    me.slow = event.shiftKey;
    const down = event.type === "keydown";
    if (!PUSH.includes(event.code) && !(event.code in TAPS)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.code in TAPS) {
      if (down && !event.repeat) tap(TAPS[event.code]);
      return;
    }
    if (down === me.held.has(event.code)) return;
    if (down) me.held.add(event.code);
    else me.held.delete(event.code);
    send();
  };
  window.addEventListener("keydown", onKey, true);
  window.addEventListener("keyup", onKey, true);
  window.addEventListener("blur", () => {
    me.held.clear();
    send();
  });

  const pressed = {};
  const isSpaceMouse = (pad) => /256f|3dconnexion|space ?(mouse|navigator|pilot|explorer)/i.test(pad.id);
  const deflection = (pad) => {
    const a = (i) => (Number.isFinite(pad.axes[i]) ? Math.max(-1, Math.min(1, pad.axes[i])) : 0);
    const b = (i) => (pad.buttons[i] ? pad.buttons[i].value : 0);
    // Axes of a SpaceMouse: translations along x (right), y (toward the user) and z (down), then rotations about them.
    if (isSpaceMouse(pad)) return [-a(1), -a(0), -a(2), a(3), -a(4), -a(5)];
    return [-a(1), -a(0), b(7) - b(6), (b(15) - b(14)) * 0.6, -a(3), -a(2)];
  };
  const poll = () => {
    let push = [0, 0, 0, 0, 0, 0];
    for (const pad of BUTTONS && navigator.getGamepads ? navigator.getGamepads() : []) {
      if (!pad || !pad.connected) continue;
      push = push.map((v, i) => Math.max(-1, Math.min(1, v + deflection(pad)[i])));
      pad.buttons.forEach((button, i) => {
        const key = pad.index + ":" + i;
        if (button.pressed && !pressed[key]) {
          const name = BUTTONS[i];
          if (name) tap(name);
        }
        pressed[key] = button.pressed;
      });
    }
    me.push = push.map((v) => Math.round(v * 1000) / 1000);
    const form = JSON.stringify({ held: [...me.held], taps: me.taps, push: me.push, slow: me.slow, n: 0 });
    const active = me.held.size > 0 || me.push.some((v) => Math.abs(v) > 0.05);
    const due = performance.now() - sentAt;
    if ((form !== sent && due > 110) || (active && due > 200)) send();
  };
  setInterval(poll, 33);
  setTimeout(send, 300);
})();
