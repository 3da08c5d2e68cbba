// A dance in a page of its own: turn it, play it with its sound, compare it with another.
//
// The page holds everything (data, song, this file), so it opens from disk without a network.
// The sound is the clock: what is drawn follows audio.currentTime; without a song it is our own.
// On the page of `dancediff live` the dance is not there yet: its pieces come through `put`.
import * as THREE from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const last = data.frames - 1;
const duration = data.frames / data.fps;
const view = { top: false, follow: false, trails: true, contacts: false };
const frameOf = (time) => Math.min(Math.floor(time * data.fps + 1e-3), last); // 31/30 s is frame 31
const TRAIL = Math.round(1.5 * data.fps);
const CONTACT_JOINTS = ["lankle", "rankle", "ltoe", "rtoe"].map((n) => data.body.names.indexOf(n));

// ---------------------------------------------------------------------------------------- data

function bytes(text) {
  const letters = atob(text);
  const found = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) found[i] = letters.charCodeAt(i); // of a long dance no list of letters
  return found.buffer;
}

// quaternions are 16-bit integers, [dancer][frame][joint][x y z w]; roots are metres
function unpack(pane) {
  if (data.live) {
    const cells = pane.colors.length * data.frames;
    const turns = new Int16Array(4 * cells * data.body.names.length);
    return { ...pane, turns, root: new Float32Array(3 * cells), contact: new Uint8Array(cells) };
  }
  const turns = new Int16Array(bytes(pane.turns));
  return { ...pane, turns, root: new Float32Array(bytes(pane.root)), contact: new Uint8Array(bytes(pane.contact)) };
}

// which frames there are, of a dance that is still being made
const have = new Uint8Array(data.frames).fill(data.live ? 0 : 1);

// a piece of a live dance, packed like a pane, from a frame on
function put(piece) {
  const part = { turns: new Int16Array(bytes(piece.turns)), root: new Float32Array(bytes(piece.root)), contact: new Uint8Array(bytes(piece.contact)) };
  for (const stage of stages) {
    const cells = stage.dancers.length * data.frames;
    for (const [name, values] of Object.entries(part)) {
      const width = stage[name].length / cells;
      const each = width * piece.frames;
      stage.dancers.forEach((_, k) => stage[name].set(values.subarray(k * each, (k + 1) * each), width * (k * data.frames + piece.start)));
    }
  }
  have.fill(1, piece.start, piece.start + piece.frames);
  shown = "";
  drawTicks();
}

// the first frame from this one on that is not there
function readyUntil(frame) {
  const missing = have.indexOf(0, frame);
  return missing < 0 ? data.frames : missing;
}

// --------------------------------------------------------------------------------------- bodies

const ball = new THREE.SphereGeometry(1, 20, 14);

function egg(centre, axes, skin) {
  const mesh = new THREE.Mesh(ball, skin);
  mesh.position.set(...centre);
  mesh.scale.set(...axes);
  mesh.castShadow = true;
  return mesh;
}

function capsule(a, b, radiusA, radiusB, skin) {
  const [from, to] = [new THREE.Vector3(...a), new THREE.Vector3(...b)];
  const way = to.clone().sub(from);
  const tube = new THREE.Mesh(new THREE.CylinderGeometry(radiusB, radiusA, way.length(), 16, 1, true), skin);
  tube.position.copy(from.clone().add(to).multiplyScalar(0.5));
  tube.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.clone().normalize());
  tube.castShadow = true;
  return [tube, egg(a, [radiusA, radiusA, radiusA], skin), egg(b, [radiusB, radiusB, radiusB], skin)];
}

function makeDancer(color, number) {
  const { names, parents, offsets, eggs, tubes, skull, face } = data.body;
  const skin = new THREE.MeshStandardMaterial({ color, roughness: 0.75 });
  const light = new THREE.MeshStandardMaterial({ color: new THREE.Color(color).lerp(new THREE.Color("white"), 0.5), roughness: 0.8 });
  const joints = names.map((_, j) => {
    const group = new THREE.Group();
    group.position.set(...offsets[j]);
    return group;
  });
  parents.forEach((p, j) => p >= 0 && joints[p].add(joints[j]));
  const at = (where) => (typeof where === "string" ? offsets[names.indexOf(where)] : where);
  for (const [joint, centre, axes] of eggs) joints[names.indexOf(joint)].add(egg(centre, axes, skin));
  for (const [joint, a, b, ra, rb] of tubes) joints[names.indexOf(joint)].add(...capsule(at(a), at(b), ra, rb, skin));
  joints[names.indexOf("head")].add(egg(skull, [0.105, 0.105, 0.105], skin), egg(face, [0.072, 0.072, 0.072], light));
  const label = makeLabel(String(number));
  const dots = CONTACT_JOINTS.map(() => {
    const dot = new THREE.Mesh(new THREE.CircleGeometry(0.09, 24), new THREE.MeshBasicMaterial({ color: "#22262B", transparent: true, opacity: 0.5 }));
    dot.rotation.x = -Math.PI / 2;
    return dot;
  });
  return { joints, label, dots, trail: makeTrail(color) };
}

// a ribbon on the floor; its points are laid in `pose`
function makeTrail(color) {
  const ribbon = new THREE.BufferGeometry();
  ribbon.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * (TRAIL + 1)), 3));
  ribbon.setIndex(Array.from({ length: TRAIL }, (_, i) => [2 * i, 2 * i + 1, 2 * i + 2, 2 * i + 1, 2 * i + 3, 2 * i + 2]).flat());
  const paint = new THREE.MeshBasicMaterial({ color, side: THREE.DoubleSide });
  const trail = new THREE.Mesh(ribbon, paint);
  trail.frustumCulled = false;
  return trail;
}

// `first` is where the frames begin that are there
function layTrail(trail, at, i, first) {
  const points = trail.geometry.attributes.position;
  for (let back = 0; back <= TRAIL; back++) {
    const [f, behind] = [Math.max(i - back, first), Math.max(i - back - 2, first)];
    const [dx, dz] = [at(f, 0) - at(behind, 0), at(f, 2) - at(behind, 2)];
    const half = (0.018 * (1 - back / TRAIL)) / (Math.hypot(dx, dz) || 1); // it thins out
    points.setXYZ(2 * back, at(f, 0) - half * dz, 0.006, at(f, 2) + half * dx);
    points.setXYZ(2 * back + 1, at(f, 0) + half * dz, 0.006, at(f, 2) - half * dx);
  }
  points.needsUpdate = true;
}

function makeLabel(text) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const pen = canvas.getContext("2d");
  pen.font = "bold 44px sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 7;
  pen.strokeStyle = "#ffffff"; // readable over bodies, too
  pen.strokeText(text, 32, 34);
  pen.fillStyle = "#22262B";
  pen.fillText(text, 32, 34);
  const map = new THREE.CanvasTexture(canvas);
  map.colorSpace = THREE.SRGBColorSpace;
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map, depthTest: false }));
  sprite.scale.set(0.28, 0.28, 1);
  return sprite;
}

// ---------------------------------------------------------------------------------------- stage

function makeStage(pane) {
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(data.colors.wall);
  const side = data.side;
  const floor = new THREE.Mesh(new THREE.PlaneGeometry(side, side), new THREE.MeshStandardMaterial({ color: data.colors.floor, roughness: 1 }));
  floor.rotation.x = -Math.PI / 2;
  floor.position.set(data.centre[0], -0.004, data.centre[1]);
  floor.receiveShadow = true;
  const grid = new THREE.GridHelper(side, side, data.colors.muted, data.colors.grid); // a square is a metre
  grid.position.set(data.centre[0], 0, data.centre[1]);
  const sun = new THREE.DirectionalLight("#ffffff", 1.6);
  sun.position.set(data.centre[0] + 2.5, 6, data.centre[1] + 3.5);
  sun.target.position.set(data.centre[0], 0, data.centre[1]);
  sun.castShadow = true;
  sun.shadow.mapSize.set(1024, 1024);
  Object.assign(sun.shadow.camera, { left: -side / 2, right: side / 2, top: side / 2, bottom: -side / 2 });
  scene.add(floor, grid, sun, sun.target, new THREE.HemisphereLight("#ffffff", "#d9d4cc", 2.0));
  const dancers = pane.colors.map((color, k) => makeDancer(color, k));
  for (const d of dancers) scene.add(d.joints[0], d.label, d.trail, ...d.dots);
  return { ...unpack(pane), scene, dancers };
}

const quaternions = [new THREE.Quaternion(), new THREE.Quaternion()];
const point = new THREE.Vector3();

// between two frames positions are mixed and rotations turned evenly, so slow motion is smooth
function pose(stage, frame) {
  const J = data.body.names.length;
  const i = Math.min(Math.floor(frame), last);
  if (!have[i]) return; // the last pose stays
  const next = have[i + 1] ? i + 1 : i;
  const share = Math.min(Math.max(frame - i, 0), 1);
  let first = i;
  while (first > i - TRAIL - 2 && have[first - 1]) first--;
  stage.dancers.forEach((dancer, k) => {
    dancer.joints.forEach((joint, j) => {
      [i, next].forEach((f, side) => quaternions[side].fromArray(stage.turns, 4 * ((k * data.frames + f) * J + j)).normalize());
      joint.quaternion.copy(quaternions[0]).slerp(quaternions[1], share);
    });
    const at = (f, c) => stage.root[3 * (k * data.frames + f) + c];
    dancer.joints[0].position.set(...[0, 1, 2].map((c) => (1 - share) * at(i, c) + share * at(next, c)));
    dancer.joints[0].updateMatrixWorld(true);
    dancer.label.position.setFromMatrixPosition(dancer.joints[data.body.names.indexOf("head")].matrixWorld).add(point.set(0, 0.38, 0));
    const bits = stage.contact[k * data.frames + i];
    dancer.dots.forEach((dot, c) => {
      dot.visible = view.contacts && ((bits >> c) & 1) === 1;
      dot.position.setFromMatrixPosition(dancer.joints[CONTACT_JOINTS[c]].matrixWorld).setY(0.004);
    });
    dancer.trail.visible = view.trails;
    if (view.trails) layTrail(dancer.trail, at, i, first);
  });
}

// ---------------------------------------------------------------------------------------- clock

let audio = data.song ? new Audio(data.song) : null;
const own = { playing: false, at: 0, since: 0, speed: 1 }; // where there is no song
let drawn = 0; // the time that the picture shows
let shown = ""; // all that it was drawn of: it is drawn anew when that has changed
let wanted = false; // play was pressed, and pause was not; a sound pauses itself at its end

// a sound that cannot be decoded: the dance goes on without it (that of a live dance is a WAV)
if (audio && !data.live) {
  audio.onerror = () => {
    Object.assign(own, { playing: wanted, at: clock.time(), since: performance.now() });
    audio = null;
  };
}

const clock = {
  waits: false, // a live dance is not there yet, and goes on by itself
  time() {
    if (audio) return Math.min(audio.currentTime, duration);
    const t = own.at + (own.playing ? (own.speed * (performance.now() - own.since)) / 1000 : 0);
    return Math.min(t, duration);
  },
  playing() {
    return audio ? !audio.paused : own.playing;
  },
  ended() {
    return this.time() >= duration - 0.5 / data.fps || audio?.ended;
  },
  seek(t) {
    t = Math.min(Math.max(t, 0), last / data.fps);
    if (audio) audio.currentTime = t;
    else Object.assign(own, { at: t, since: performance.now() });
  },
  play() {
    wanted = true;
    if (this.ended() || this.time() >= duration - 1.5 / data.fps) this.seek(0); // in the last frame
    if (audio) audio.play().catch(() => audio?.paused && (wanted = false));
    else Object.assign(own, { playing: true, since: performance.now() });
  },
  pause() {
    wanted = this.waits = false;
    if (audio) audio.pause();
    else Object.assign(own, { at: this.time(), playing: false });
  },
  toggle() {
    this.playing() || this.waits ? this.pause() : this.play();
  },
  setSpeed(speed) {
    Object.assign(own, { at: this.time(), since: performance.now(), speed });
    if (audio) audio.playbackRate = speed;
  },
};

// ----------------------------------------------------------------------------------------- page

$("title").textContent = document.title = data.title;
const stages = data.panes.map(makeStage);
const canvas = $("stage");
const renderer = makeRenderer();
renderer.shadowMap.enabled = true;
renderer.setScissorTest(true);
const camera = new THREE.PerspectiveCamera(32, 1, 0.1, 200);
const orbit = new OrbitControls(camera, canvas);
canvas.addEventListener("webglcontextrestored", () => (shown = ""));

function makeRenderer() {
  try {
    return new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  } catch (error) {
    $("clock").textContent = "This browser has no WebGL, so it cannot show the dance: turn on hardware acceleration, or take another browser";
    throw error;
  }
}

data.panes.forEach((pane) => {
  const card = document.createElement("div");
  const name = document.createElement("b");
  name.textContent = pane.title;
  card.append(name);
  for (const [metric, value] of pane.metrics) {
    const cell = document.createElement("span");
    cell.textContent = `${metric} ${value}`;
    card.append(cell);
  }
  $("cards").append(card);
});

function lookAround() {
  const [x, z] = data.centre;
  const aspect = canvas.clientWidth / stages.length / canvas.clientHeight || 1.2;
  const far = Math.max(data.side, 4) * (view.top ? 1.2 : 0.8) * Math.max(1, 1.2 / aspect);
  orbit.target.set(x, view.top ? 0 : 0.9, z);
  camera.up.set(0, 1, 0);
  if (view.top) camera.position.set(x, far, z + 0.001);
  else camera.position.set(x + 0.2 * far, 0.9 + 0.3 * far, z + far);
  orbit.enableRotate = !view.top;
  orbit.update();
}

function follow() {
  point.set(0, 0, 0);
  let count = 0;
  for (const stage of stages) for (const d of stage.dancers) (point.add(d.joints[0].position), count++);
  point.divideScalar(count).setY(orbit.target.y);
  const step = point.sub(orbit.target).multiplyScalar(0.06);
  orbit.target.add(step);
  camera.position.add(step);
}

function draw() {
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  const size = renderer.getSize(new THREE.Vector2());
  if (size.x !== width || size.y !== height) {
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer.setSize(width, height, false);
  }
  const each = width / stages.length;
  camera.aspect = each / height;
  camera.updateProjectionMatrix();
  stages.forEach((stage, k) => {
    renderer.setViewport(k * each, 0, each, height);
    renderer.setScissor(k * each, 0, each, height);
    renderer.render(stage.scene, camera);
  });
}

function drawTicks() {
  const ticks = $("ticks");
  ticks.width = ticks.clientWidth;
  ticks.height = ticks.clientHeight;
  const pen = ticks.getContext("2d");
  const at = (frame) => 8 + (frame / Math.max(last, 1)) * (ticks.width - 16); // where the handle is
  if (data.live) {
    pen.fillStyle = data.colors.grid;
    for (let from = have.indexOf(1); from >= 0; ) {
      const to = readyUntil(from);
      pen.fillRect(at(from), ticks.height - 3, at(to - 1) - at(from), 3);
      from = have.indexOf(1, to);
    }
  }
  pen.fillStyle = data.colors.beat;
  for (const beat of data.beats) pen.fillRect(at(beat * data.fps) - 0.75, 0, 1.5, ticks.height);
}

// a text that stands there already is left alone: a screen reader hears of every change
function write(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}

function tick() {
  if (clock.ended() && wanted) {
    if ($("loop").checked) clock.play();
    else clock.pause();
  }
  const time = clock.time();
  let frame = Math.min(time * data.fps, last);
  if (Math.abs(frame - Math.round(frame)) < 1e-3) frame = Math.round(frame); // as frameOf does
  for (const stage of stages) pose(stage, frame);
  if (view.follow) follow();
  orbit.update();
  const now = [time, ...Object.values(view), ...camera.position, ...orbit.target, canvas.clientWidth, canvas.clientHeight, window.devicePixelRatio].join();
  if (now !== shown) draw();
  shown = now;
  drawn = time;
  $("time").value = frameOf(time);
  write("clock", `${time.toFixed(2)} s · frame ${frameOf(time)}`);
  write("play", clock.playing() || clock.waits ? "❚❚ Pause" : "▶ Play");
  requestAnimationFrame(tick);
}

function press(id, name, after = () => {}) {
  view[name] = !view[name];
  $(id).setAttribute("aria-pressed", view[name]);
  after();
}

const actions = {
  play: () => clock.toggle(),
  top: () => press("top", "top", lookAround),
  follow: () => press("follow", "follow"),
  trails: () => press("trails", "trails"),
  contacts: () => press("contacts", "contacts"),
  home: () => clock.seek(0),
  back: () => clock.seek(clock.time() - 1),
  ahead: () => clock.seek(clock.time() + 1),
  before: () => clock.seek((frameOf(clock.time()) - 1) / data.fps),
  after: () => clock.seek((frameOf(clock.time()) + 1) / data.fps),
};
const keys = { " ": "play", t: "top", f: "follow", r: "trails", c: "contacts", Home: "home", ArrowLeft: "back", ArrowRight: "ahead", ",": "before", ".": "after" };
// keys that a control needs for itself, where it has the focus
const OWN_KEYS = { BUTTON: /^( |Enter)$/, checkbox: /^ $/, range: /^(Arrow|Home|End|Page)/, SELECT: /./ };

// who clicks with the mouse (detail counts clicks) goes on with the player's keys
for (const id of ["play", "top", "follow", "trails", "contacts"]) $(id).onclick = (event) => (actions[id](), event.detail && $(id).blur());
$("loop").onclick = (event) => event.detail && $("loop").blur();
$("time").max = last;
$("time").oninput = () => clock.seek($("time").value / data.fps);
$("time").onpointerup = () => $("time").blur();
$("speed").onchange = () => clock.setSpeed(Number($("speed").value));
// who chose from a list with the mouse goes on with the player's keys; with the keyboard one stays
function leftByMouse(select) {
  let mouse = false;
  select.onpointerdown = () => (mouse = true);
  select.onkeydown = () => (mouse = false);
  select.addEventListener("change", () => mouse && select.blur());
}
leftByMouse($("speed"));
// what a key means; on a keyboard of other letters it is the Latin one of its place
function meant({ key, code }) {
  if (key.length > 1 || key <= "~") return key;
  return { Comma: ",", Period: "." }[code] ?? code.replace(/^Key/, "").toLowerCase();
}
document.addEventListener("keydown", (event) => {
  const key = meant(event);
  const action = keys[key] ?? keys[key.toLowerCase()]; // CapsLock
  const { tagName, type } = event.target;
  if (!action || event.ctrlKey || event.metaKey || event.altKey || OWN_KEYS[tagName === "INPUT" ? type : tagName]?.test(event.key)) return;
  event.preventDefault();
  actions[action]();
});
window.addEventListener("resize", drawTicks);

window.dancediff = { get audio() { return audio; }, leftByMouse, clock, data, put, readyUntil, drawTicks, view, state: () => ({ time: clock.time(), frame: frameOf(clock.time()), playing: clock.playing(), drawn }) };
lookAround();
drawTicks();
tick();
