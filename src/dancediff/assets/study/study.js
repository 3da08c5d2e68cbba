// A blind comparison: pairs of dances, votes by keys, and a file of answers to download.
//
// Each pair is the HTML player's page in a frame. The page knows pairs by ids and dances as left
// and right; which system danced which stands in the key, which is not here.
"use strict";
const $ = (id) => document.getElementById(id);
const read = (id) => JSON.parse($(id).textContent);
const study = read("study");
const [before, after] = read("player");
const SAVED = `dancediff-study-${study.id}`;
const SIDES = { q: "left", p: "right" }; // no digits: those stand over the dancers
const plural = (n, what) => `${n} ${what}${n === 1 ? "" : "s"}`;

// keys that a control needs for itself, where it has the focus
const OWN_KEYS = { BUTTON: /^( |Enter)$/, checkbox: /^ $/, range: /^(Arrow|Home|End|Page)/, SELECT: /./ };

// answers[pair][question] is "left" or "right"; watched[pair] is in seconds
let state = null;
let active = 0; // the question that keys answer
let ready = false; // the player of this pair is there
let seen = { time: 0, at: 0 }; // where the player was a moment ago, and when that was

const pair = () => study.pairs[state.at];
const answered = (id) => study.questions.filter((q) => state.answers[id]?.[q.name]).length;
const complete = (id) => answered(id) === study.questions.length;
const votes = () => study.pairs.reduce((sum, id) => sum + answered(id), 0);
const open = () => (state.watched[pair()] ?? 0) > study.least - 0.1; // clocks end a little early

// ------------------------------------------------------------------------------------- keeping

// a reload loses nothing, where the browser lets a page keep something
function keep() {
  try {
    localStorage.setItem(SAVED, JSON.stringify(state));
  } catch {}
}

function kept() {
  try {
    return JSON.parse(localStorage.getItem(SAVED));
  } catch {
    return null;
  }
}

function forget() {
  try {
    localStorage.removeItem(SAVED);
  } catch {}
}

function token() {
  return Array.from(crypto.getRandomValues(new Uint8Array(8)), (b) => b.toString(16).padStart(2, "0")).join("");
}

// ------------------------------------------------------------------------------------- showing

function show(section) {
  for (const id of ["start", "pair", "end"]) $(id).hidden = id !== section;
}

function showPair(at) {
  state.at = at;
  active = Math.max(study.questions.findIndex((q) => !state.answers[pair()]?.[q.name]), 0);
  ready = false;
  seen = { time: 0, at: performance.now() };
  $("stage").srcdoc = before + $(`pair-${pair()}`).textContent + after;
  show("pair");
  keep();
  drawVotes();
}

function drawVotes() {
  const mine = state.answers[pair()] ?? {};
  $("where").textContent = `Pair ${state.at + 1} of ${study.pairs.length}`;
  $("progress").max = study.pairs.length * study.questions.length;
  $("progress").value = votes();
  study.questions.forEach((question, k) => {
    const row = $("votes").children[k];
    row.classList.toggle("active", k === active && open());
    if (k === active && open()) row.setAttribute("aria-current", "true");
    else row.removeAttribute("aria-current");
    for (const button of row.querySelectorAll("button")) {
      button.disabled = !open();
      button.setAttribute("aria-pressed", mine[question.name] === button.dataset.side);
    }
  });
  $("back").disabled = state.at === 0;
  $("next").disabled = !complete(pair());
  $("next").firstChild.textContent = state.at === study.pairs.length - 1 ? "Finish " : "Next pair ";
  write("status", !open() ? "Watch the dances first: space plays" : complete(pair()) ? "All answered; you may still change a vote" : "Q votes for the left dance, P for the right");
  write("left", open() ? "" : ` (${Math.ceil(study.least - (state.watched[pair()] ?? 0))} s to go)`);
}

// a screen reader says every change of a status, also to the text that stands there already
function write(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}

function makeVotes() {
  study.questions.forEach((question, k) => {
    const row = document.createElement("div");
    row.className = "question";
    const text = document.createElement("p");
    text.textContent = question.text;
    const buttons = Object.entries(SIDES).map(([key, side]) => {
      const button = document.createElement("button");
      const hint = document.createElement("kbd");
      hint.textContent = key.toUpperCase();
      button.append(side === "left" ? "Left " : "Right ", hint);
      button.dataset.side = side;
      button.setAttribute("aria-label", `${question.text} ${side}`);
      button.onclick = () => (vote(k, side), button.blur());
      return button;
    });
    row.append(buttons[0], text, buttons[1]);
    $("votes").append(row);
  });
}

function finish() {
  player()?.clock.pause();
  const [given, all] = [votes(), study.pairs.length * study.questions.length];
  $("said").textContent = `You gave ${given} of ${plural(all, "vote")}. Download the file and hand it in.`;
  $("fresh").disabled = given > 0 && !state.downloaded;
  show("end");
}

// ------------------------------------------------------------------------------------- voting

function vote(k, side) {
  if (!open()) return;
  (state.answers[pair()] ??= {})[study.questions[k].name] = side;
  state.downloaded = false;
  const mine = state.answers[pair()];
  const missing = study.questions.findIndex((q) => !mine[q.name]);
  active = missing < 0 ? k : missing;
  keep();
  drawVotes();
}

function next() {
  if (!complete(pair())) return;
  if (state.at === study.pairs.length - 1) finish();
  else showPair(state.at + 1);
}

function player() {
  return ready ? $("stage").contentWindow.dancediff : null;
}

// how long a pair was watched: jumps along the time line do not count
function watch() {
  const now = player()?.state();
  if (!now || $("pair").hidden) return;
  const [step, passed] = [now.time - seen.time, (performance.now() - seen.at) / 1000];
  seen = { time: now.time, at: performance.now() };
  if (step <= 0 || step > 2 * passed + 0.2) return; // 2 is the highest speed
  state.watched[pair()] = (state.watched[pair()] ?? 0) + step;
  keep();
  drawVotes();
}

// what a key means; on a keyboard of other letters it is the Latin one of its place
function meant({ key, code }) {
  return key.length > 1 || key <= "~" ? key : code.replace(/^Key/, "");
}

function pressed(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || $("pair").hidden) return;
  const { tagName, type } = event.target;
  if (OWN_KEYS[tagName === "INPUT" ? type : tagName]?.test(event.key)) return;
  const step = { ArrowUp: -1, ArrowDown: 1 }[event.key];
  const side = SIDES[meant(event).toLowerCase()];
  if (side) vote(active, side);
  else if (step) active = (active + step + study.questions.length) % study.questions.length;
  else if (event.key === "Enter") next();
  else if (event.key === "Backspace" && state.at > 0) showPair(state.at - 1);
  else if (event.key !== "Backspace") {
    // what is left is the player's
    if (event.view === window) $("stage").contentDocument.dispatchEvent(new KeyboardEvent("keydown", { key: event.key, code: event.code, cancelable: true }));
    if (event.key === " ") event.preventDefault();
    return;
  }
  event.preventDefault();
  event.stopPropagation();
  drawVotes();
}

// ------------------------------------------------------------------------------------- answers

function download() {
  const answers = study.pairs.flatMap((id) => Object.entries(state.answers[id] ?? {}).map(([question, choice]) => ({ pair: id, question, choice })));
  const file = { study: study.id, rater: state.rater, token: state.token, answers, watched: state.watched };
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([JSON.stringify(file, null, 1)], { type: "application/json" }));
  link.download = `answers_${state.rater.replace(/[^\p{L}\p{N}]+/gu, "-")}_${state.token.slice(0, 4)}.json`;
  link.click();
  state.downloaded = true;
  keep();
  $("fresh").disabled = false;
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

function start() {
  const old = kept();
  $("rater").value = "";
  $("begin").disabled = true;
  $("resume").hidden = !old;
  if (old) {
    $("resume").textContent = `Go on as ${old.rater}`;
    $("resume").onclick = () => ((state = old), showPair(old.at));
  }
  show("start");
  $("rater").focus();
}

$("count").textContent = plural(study.pairs.length, "pair");
$("least").textContent = plural(study.least, "second");
$("rater").oninput = () => ($("begin").disabled = !$("rater").value.trim());
$("rater").onkeydown = (event) => event.key === "Enter" && $("begin").click();
$("begin").onclick = () => {
  const old = kept();
  const lost = old && !old.downloaded && Object.keys(old.answers).length;
  if (lost && !confirm(`The answers of ${old.rater} were not downloaded. Throw them away?`)) return;
  state = { rater: $("rater").value.trim(), token: token(), at: 0, answers: {}, watched: {} };
  showPair(0);
};
$("stage").onload = () => {
  if (!state || !$("stage").contentWindow.dancediff) return;
  ready = true;
  $("stage").contentDocument.addEventListener("keydown", pressed, true);
  $("stage").contentWindow.focus();
};
$("back").onclick = () => state.at > 0 && showPair(state.at - 1);
$("next").onclick = next;
$("stop").onclick = finish;
$("again").onclick = () => showPair(state.at);
$("download").onclick = download;
$("fresh").onclick = () => (forget(), start());
document.addEventListener("keydown", pressed);
setInterval(watch, 200);
makeVotes();
start();
window.study = { state: () => state, ready: () => ready, open: () => state !== null && open() };
