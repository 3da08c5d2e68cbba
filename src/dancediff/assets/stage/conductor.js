// Plays a notebook's stage: moves clip, slider, clock and camera, all of it in the browser.
//
// stage_timeline.py hands this function to the page, with the widget manager and what it needs to
// know. Models are changed with `set` alone: the views follow, and nothing is sent to the kernel.
// With a song the sound is the clock: what is drawn follows audio.currentTime.
async (manager, facts) => {
  const part = {};
  const begun = performance.now();
  for (const [name, id] of Object.entries(facts.models)) {
    while (!manager.has_model(id)) {
      if (performance.now() - begun > 60_000) return; // the kernel has closed it meanwhile
      await new Promise((go) => setTimeout(go, 50));
    }
    part[name] = await manager.get_model(id);
    await part[name].initPromise; // three.js' objects come later than their models
  }
  const { renderer, scene, mixer, action, middle, camera, orbit } = part;
  const { play, slider, clock, speed, loop, views } = part;
  const last = facts.frames - 1;
  const duration = facts.frames / facts.fps;
  const on = (model, event, then) => renderer.listenTo(model, event, then); // until the stage is closed

  // ------------------------------------------------------------------------------------ skins

  // pythreejs binds a skin to bones that nobody has placed yet
  scene.obj.traverse((skin) => {
    if (!skin.isSkinnedMesh) return;
    facts.rest.forEach(([x, y, z], j) => skin.skeleton.boneInverses[j].makeTranslation(-x, -y, -z));
    skin.bindMatrix.identity();
    skin.bindMatrixInverse.identity();
  });

  // ------------------------------------------------------------------------------------- time

  const own = { at: 0, since: 0, rate: 1 }; // where there is no song
  let playing = false;
  let audio = null;
  if (part.sound) {
    audio = new Audio(URL.createObjectURL(new Blob([part.sound.get("value")], { type: "audio/mpeg" })));
    audio.onerror = () => (audio = null);
    on(part.sound_on, "change:value", () => audio && (audio.muted = !part.sound_on.get("value")));
    audio.muted = !part.sound_on.get("value");
  }
  const rate = () => Number(speed.get("_options_labels")[speed.get("index")]);

  function now() {
    if (audio) return audio.currentTime;
    return own.at + (playing ? (own.rate * (performance.now() - own.since)) / 1000 : 0);
  }

  function seek(time) {
    if (audio) audio.currentTime = time;
    Object.assign(own, { at: time, since: performance.now() });
  }

  // ----------------------------------------------------------------------------------- camera

  const walked = middle.obj.position.clone();

  function look() {
    const view = facts.views[views.get("index")];
    camera.obj.position.fromArray(view.eye);
    orbit.obj.target.fromArray(view.target);
    orbit.obj.enableRotate = view.turns;
    walked.set(0, 0, 0);
    follow();
  }

  // the eye walks as the middle of the group does; from where it looks is left to the mouse
  function follow() {
    if (facts.views[views.get("index")].follows) {
      const step = middle.obj.position.clone().sub(walked);
      camera.obj.position.add(step);
      orbit.obj.target.add(step);
      walked.add(step);
    }
    orbit.obj.update();
  }

  // ---------------------------------------------------------------------------------- playing

  let moving = false; // it is we who move the slider
  let told = null; // the place that the kernel was told last: its echo comes late, and is no wish

  function show(time) {
    let frame = Math.min(time * facts.fps, last);
    if (Math.abs(frame - Math.round(frame)) < 1e-3) frame = Math.round(frame); // 31/30 s is frame 31
    action.obj.time = frame;
    mixer.obj.update(0);
    follow();
    moving = true;
    slider.set("value", Math.floor(frame));
    moving = false;
    clock.set("value", `${time.toFixed(2)} s · frame ${slider.get("value")}`);
    scene.trigger("rerender", scene, {});
  }

  function start() {
    if (window.dancediff !== stage) window.dancediff?.pause(); // one song at a time on a page
    window.dancediff = stage;
    if (ended() || now() >= duration - 1.5 / facts.fps) seek(0); // in the last frame
    Object.assign(own, { at: now(), since: performance.now(), rate: rate() });
    playing = true;
    untilUnseen();
    if (audio) audio.playbackRate = rate();
    sound();
    say();
    requestAnimationFrame(tick);
  }

  // at its end, and in some browsers in a tab that nobody looks at, a sound pauses itself
  function sound() {
    if (audio?.paused) audio.play().catch(() => playing && audio?.paused && stop());
  }

  const ended = () => now() >= duration - 0.5 / facts.fps || audio?.ended;

  function stop() {
    own.at = now();
    playing = false;
    if (audio) audio.pause();
    show(Math.min(now(), duration));
    play.set("value", false);
    told = slider.get("value");
    slider.save_changes(); // now the kernel may know where we are
    say();
  }

  // later, as a button that is being pressed does not listen
  function say() {
    setTimeout(() => {
      play.set("description", playing ? "❚❚ Pause" : "▶ Play");
      play.save_changes();
    });
  }

  function tick() {
    if (!playing) return;
    if (!Object.keys(renderer.views ?? {}).length) return stop(); // the cell was run again
    if (ended()) {
      if (!loop.get("value")) return stop();
      seek(0);
    }
    sound();
    show(now());
    requestAnimationFrame(tick);
  }

  // a cell that is run again takes its picture away, and the sound goes with it; nobody asks for that
  // in `tick`, which does not come while the tab is hidden
  const watched = new WeakSet();
  async function untilUnseen() {
    for (const coming of Object.values(renderer.views ?? {})) {
      const view = await coming;
      if (!watched.has(view)) view.once("remove", () => setTimeout(unseen));
      watched.add(view);
    }
    unseen(); // it was away already
  }
  const unseen = () => playing && !Object.keys(renderer.views ?? {}).length && stop();

  // the kernel has closed the stage: the page keeps nothing of it; `renderer` listens no more
  renderer.once("destroy", () => {
    playing = false;
    if (audio) {
      audio.onerror = null;
      audio.pause();
      URL.revokeObjectURL(audio.src);
      audio.removeAttribute("src");
      audio = null;
    }
    if (window.dancediff === stage) delete window.dancediff;
  });

  on(play, "change:value", () => play.get("value") !== playing && (playing ? stop() : start()));
  on(slider, "change:value", (_, value, options) => {
    if (moving || (playing && value === told && !options.updated_view)) return;
    told = value;
    seek(slider.get("value") / facts.fps);
    show(slider.get("value") / facts.fps);
  });
  on(speed, "change:index", () => {
    Object.assign(own, { at: now(), since: performance.now(), rate: rate() });
    if (audio) audio.playbackRate = rate();
  });
  on(views, "change:index", () => (look(), show(Math.min(now(), duration))));
  // of the stages on a page, the one that was played last, or came last
  const stage = {
    audio: () => audio,
    pause: () => playing && stop(),
    state: () => ({ time: now(), frame: action.obj?.time, playing }), // its models may be closed
  };
  window.dancediff ??= stage;
  if (!window.dancediff.state().playing) window.dancediff = stage;
  action.obj.play();
  seek(slider.get("value") / facts.fps);
  show(slider.get("value") / facts.fps);
}
