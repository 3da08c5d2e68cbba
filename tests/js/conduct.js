// What the conductor of a stage does, without a browser: `node conduct.js CONDUCTOR`.
//
// It plays with models of our own, which close as those of @jupyter-widgets/base do, and a clock
// that passes when we say so. Prints a line a check, which begins with "ok" or "FAIL".
const fs = require("fs");
const assert = require("assert");
class Model {
  constructor(values = {}, more = {}) {
    Object.assign(
      this,
      { values, ears: [], heard: [], views: {}, saved: [], comm_live: true },
      more,
    );
  }
  get(name) {
    return this.values[name];
  }
  set(name, value, options = {}) {
    if (typeof name === "object") {
      for (const [k, v] of Object.entries(name)) this.set(k, v);
      return;
    }
    if (this.values[name] === value) return;
    this.values[name] = value;
    this.trigger(`change:${name}`, this, value, options);
  }
  on(name, f, owner) {
    this.ears.push({ name, f, owner });
  }
  once(name, f) {
    const ear = {
      name,
      f: (...x) => {
        this.ears = this.ears.filter((e) => e !== ear);
        f(...x);
      },
    };
    this.ears.push(ear);
  }
  listenTo(other, name, f) {
    other.on(name, f, this);
    this.heard.push(other);
  }
  stopListening() {
    for (const other of this.heard) other.ears = other.ears.filter((e) => e.owner !== this);
  }
  trigger(name, ...x) {
    for (const e of [...this.ears]) if (e.name === name) e.f(...x);
  }
  save_changes() {
    this.saved.push({ ...this.values });
  }
  close() {
    this.stopListening();
    this.trigger("destroy", this);
    const v = Object.values(this.views);
    delete this.views;
    delete this.obj;
    return Promise.all(v.map(async (one) => (await one).remove()));
  }
}
const vector = () => ({ clone: vector, set() {}, fromArray() {}, sub: () => vector(), add() {} });
let clockNow = 0,
  frames = [];
globalThis.window = globalThis;
Object.defineProperty(globalThis, "performance", {
  value: { now: () => clockNow },
  configurable: true,
});
globalThis.requestAnimationFrame = (f) => frames.push(f);
const draw = (ms = 16) => {
  clockNow += ms;
  for (const a of sounds) a.pass(ms);
  const now = frames;
  frames = [];
  now.forEach((f) => f());
};
const sounds = [];
globalThis.Audio = class {
  constructor(src) {
    Object.assign(this, {
      src,
      paused: true,
      ended: false,
      currentTime: 0,
      playbackRate: 1,
      muted: false,
    });
    sounds.push(this);
  }
  play() {
    this.paused = false;
    return Promise.resolve();
  }
  pause() {
    this.paused = true;
  }
  pass(ms) {
    if (!this.paused) this.currentTime += (ms / 1000) * this.playbackRate;
  }
  removeAttribute() {
    this.src = "";
  }
  load() {}
};
const urls = new Set();
URL.createObjectURL = () => {
  const u = "blob:" + Math.random();
  urls.add(u);
  return u;
};
URL.revokeObjectURL = (u) => urls.delete(u);
const rest = () => new Promise((go) => setTimeout(go, 5));
const read = () => (0, eval)(fs.readFileSync(process.argv[2], "utf8"));
async function stage(sound) {
  const obj = (o) => ({ obj: o });
  const parts = {
    renderer: new Model(),
    scene: new Model({}, obj({ traverse() {} })),
    mixer: new Model({}, obj({ update() {} })),
    action: new Model(
      {},
      obj({
        time: 0,
        play() {
          this.on = true;
        },
      }),
    ),
    middle: new Model({}, obj({ position: vector() })),
    camera: new Model({}, obj({ position: vector() })),
    orbit: new Model({}, obj({ target: vector(), update() {} })),
    play: new Model({ value: false }),
    slider: new Model({ value: 0 }),
    clock: new Model(),
    speed: new Model({ _options_labels: ["0.25", "0.5", "1"], index: 2 }),
    loop: new Model({ value: true }),
    views: new Model({ index: 0 }),
  };
  if (sound)
    Object.assign(parts, {
      sound: new Model({ value: new Uint8Array(4) }),
      sound_on: new Model({ value: true }),
    });
  const view = new Model(
    {},
    {
      remove() {
        this.trigger("remove");
      },
    },
  );
  parts.renderer.views.a = Promise.resolve(view);
  view.once("remove", () => parts.renderer.views && delete parts.renderer.views.a);
  const ids = Object.fromEntries(Object.keys(parts).map((n) => [n, n]));
  const manager = { has_model: () => true, get_model: async (id) => parts[id] };
  const facts = {
    models: ids,
    frames: 900,
    fps: 30,
    views: [{ eye: [0, 0, 0], target: [0, 0, 0], turns: true, follows: false }],
    rest: [],
  };
  await read()(manager, facts);
  return { ...parts, view, stage: window.dancediff, audio: sounds.at(-1) };
}
async function check(what, f) {
  try {
    delete window.dancediff;
    frames = [];
    sounds.length = 0;
    urls.clear();
    await f();
    console.log("ok  ", what);
  } catch (e) {
    console.log("FAIL", what, "-", String(e.message).split("\n")[0]);
  }
}
(async () => {
  await check("a cell run again ends the sound in a hidden tab", async () => {
    const s = await stage(true);
    s.play.set("value", true);
    draw();
    await rest();
    s.view.remove();
    await rest();
    assert(s.audio.paused);
    assert(!s.stage.state().playing);
  });
  await check("a cell run again ends the sound in a shown tab", async () => {
    const s = await stage(true);
    s.play.set("value", true);
    draw();
    s.view.remove();
    draw();
    assert(s.audio.paused);
  });
  await check("a closed stage keeps no ears and no sound", async () => {
    const s = await stage(true);
    s.play.set("value", true);
    draw();
    await s.renderer.close();
    draw();
    await rest();
    assert(s.audio.paused);
    assert.equal(urls.size, 0);
    assert.equal(s.play.ears.length, 0);
  });
  await check("a new stage plays where all old widgets were closed", async () => {
    const s = await stage(false);
    for (const n of ["action", "renderer", "slider"]) s[n].close();
    const t = await stage(false);
    assert(t.action.obj.on);
  });
  await check("speed changes without a jump (no song)", async () => {
    const s = await stage(false);
    s.play.set("value", true);
    for (let k = 0; k < 500; k++) draw();
    const before = s.stage.state().time;
    s.speed.set("index", 0);
    const after = s.stage.state().time;
    assert(Math.abs(after - before) < 0.05, `${before} -> ${after}`);
    for (let k = 0; k < 100; k++) draw();
    assert(Math.abs(s.stage.state().time - before - 0.4) < 0.05);
  });
  await check("the kernel's echo of a place does not jump", async () => {
    const s = await stage(true);
    s.play.set("value", true);
    draw();
    s.slider.set("value", 300, { updated_view: {} });
    for (let k = 0; k < 200; k++) draw();
    const before = s.stage.state().time;
    s.slider.set("value", 300);
    draw();
    const after = s.stage.state().time;
    assert(after >= before, `${before} -> ${after}`);
  });
  await check("nor that of a pause", async () => {
    const s = await stage(true);
    s.play.set("value", true);
    for (let k = 0; k < 100; k++) draw();
    s.play.set("value", false);
    const v = s.slider.get("value");
    s.play.set("value", true);
    for (let k = 0; k < 200; k++) draw();
    const before = s.stage.state().time;
    s.slider.set("value", v);
    draw();
    assert(s.stage.state().time >= before);
  });
  await check("the kernel may still seek", async () => {
    const s = await stage(true);
    s.play.set("value", true);
    draw();
    s.slider.set("value", 600);
    assert(Math.abs(s.stage.state().time - 20) < 0.1);
  });
  await check("feet of the frame that is named (31/30 s as browsers say it)", async () => {
    const s = await stage(true);
    let bad = 0;
    for (let k = 0; k < 900; k++) {
      s.slider.set("value", k);
      s.audio.currentTime = Math.round(s.audio.currentTime * 1e6) / 1e6;
      s.play.set("value", true);
      s.play.set("value", false);
      if (Math.floor(s.action.obj.time) !== s.slider.get("value")) bad++;
    }
    assert.equal(bad, 0);
  });
  await check("play in the last frame begins anew", async () => {
    const s = await stage(true);
    s.slider.set("value", 899);
    s.audio.currentTime = Math.floor(s.audio.currentTime * 1e6) / 1e6;
    s.play.set("value", true);
    assert(s.stage.state().time < 1, s.stage.state().time);
  });
  await check("models that never come are not waited for for ever", async () => {
    let asked = 0;
    const manager = {
      has_model: () => {
        asked++;
        clockNow += 30_000;
        return false;
      },
    };
    await read()(manager, { models: { renderer: "gone" } });
    assert(asked < 10);
  });
  await check("another stage plays after one was closed", async () => {
    const a = await stage(true);
    const b = await stage(true);
    b.play.set("value", true);
    draw();
    await b.renderer.close();
    a.play.set("value", true);
    draw();
    assert(window.dancediff.state().playing);
  });
})();
