// Joins the player of a page to the session that dances for it, by one websocket.
//
// The session sends pieces, the page tells where it is. Where the next frame is not there yet the
// sound waits with the picture, so that they stay in step.
(() => {
  const { audio, data, put, readyUntil, drawTicks, clock } = window.dancediff;
  const $ = (id) => document.getElementById(id);
  const ENOUGH = 1.0; // seconds that must be ready before a dance that had to wait goes on
  const live = { pieces: [], knobs: [], stalls: 0, unsaved: false, waiting: true, state: {}, closed: false, begun: performance.now(), moved: null };
  let asked = -1; // the frame that the session was asked to go to
  let coming = 0; // the frame with which the next piece begins
  let jumped = false; // to a place that is not ready
  let since = performance.now(); // when the frame that is shown now was missed first
  const socket = new WebSocket(`ws://${location.host}/session`);
  const send = (facts) => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify(facts));

  socket.onmessage = (event) => {
    const [kind, facts] = JSON.parse(event.data);
    told[kind](facts);
  };
  socket.onclose = (event) => {
    live.closed = true;
    say(event.reason || "The session has ended.");
  };

  function say(text) {
    $("said").textContent = text;
  }

  const told = {
    piece(piece) {
      put(piece);
      live.unsaved = true;
      coming = piece.start + piece.frames;
      live.moved ??= performance.now() - live.begun;
      live.pieces.push({ start: piece.start, frames: piece.frames, at: performance.now() });
      if (live.pieces.length > 100) live.pieces.shift();
    },
    knob(facts) {
      live.knobs.push(facts);
      if (facts.set) say(`${Object.keys(facts.set).join(", ")}: seen from ${facts.from.toFixed(1)} s on`);
    },
    state(state) {
      live.state = state;
      if (state.now) follow(state.now);
      $("slow").textContent = state.slow;
    },
    beats({ beats }) {
      data.beats = beats;
      drawTicks();
    },
    saved({ files }) {
      live.unsaved = false;
      say(`Saved: ${files.join(", ")}`);
    },
    failed: ({ text }) => say(text),
  };

  // ---------------------------------------------------------------------------------------- time

  const frame = () => Math.min(Math.floor(clock.time() * data.fps), data.frames - 1);
  const ready = () => Math.max(readyUntil(frame()) / data.fps - clock.time(), 0);
  const enough = () => ready() >= ENOUGH || readyUntil(frame()) >= data.frames;

  // a microphone does not wait: the picture is where the sound in the room is, until Pause is pressed
  function follow(now) {
    if (!live.waiting && !clock.playing()) return;
    if (Math.abs(clock.time() - now) > 0.1) clock.seek(now);
    if (live.waiting) clock.play();
    live.waiting = false;
  }

  function watch() {
    const here = frame();
    if (data.live.listens) return show();
    if (readyUntil(here) > here) since = performance.now();
    if (clock.playing() && ready() < 2 / data.fps && readyUntil(here) < data.frames) {
      audio.pause();
      if (!live.waiting && !jumped) live.stalls += 1; // who jumps must wait
      live.waiting = clock.waits = true;
    }
    if (live.waiting && enough()) {
      live.waiting = jumped = false;
      if (clock.waits) clock.play();
      clock.waits = false;
    }
    // a place that nobody is on the way to
    const far = here < coming || here > coming + 2.5 * data.fps;
    if (readyUntil(here) === here && far && asked !== here && performance.now() - since > 300) {
      asked = here;
      coming = here;
      send({ seek: here / data.fps });
    }
    show();
  }

  function show() {
    const seconds = ready();
    $("ahead").firstElementChild.style.width = `${Math.min(seconds / 10, 1) * 100}%`;
    $("ahead").lastElementChild.textContent = clock.waits ? "waiting for the dance" : `${seconds.toFixed(1)} s ahead · ${live.state.steps ?? "?"} steps`;
    requestAnimationFrame(watch);
  }

  audio?.addEventListener("seeking", () => (jumped = !enough()));
  setInterval(() => send({ at: clock.time(), stalls: live.stalls }), 200);

  // --------------------------------------------------------------------------------------- knobs

  function choices(id, rows) {
    for (const [text, value] of rows) $(id).add(new Option(text, JSON.stringify(value)));
    $(id).onchange = () => send({ set: { [id]: JSON.parse($(id).value) } });
    window.dancediff.leftByMouse($(id));
  }
  for (const label of document.querySelectorAll("[data-knob]")) label.hidden = !(label.dataset.knob in data.live.knobs);
  for (const [id, rows] of Object.entries(data.live.knobs)) if (id !== "energy") choices(id, rows);
  $("energy").onchange = () => send({ set: { energy: Number($("energy").value) } });
  $("energy").onpointerup = () => $("energy").blur(); // keys are the player's again
  $("save").onclick = (event) => {
    if (event.detail) $("save").blur(); // a click of the mouse
    if (live.closed) return say("The session has ended; nothing can be saved any more.");
    send({ save: true });
    say("Saving …");
  };
  window.addEventListener("beforeunload", (event) => live.unsaved && !live.closed && event.preventDefault());

  window.dancediff.live = Object.assign(live, { ready, send });
  if (window === window.top) $("play").focus(); // in a notebook keys are the notebook's
  watch();
})();
