"use strict";
// The live page: draws what comes over /live, asks for faults, and connects again by itself.
const kPoints = 400;      // of each curve: 16 s at 25 states a second
const kReconnect_ms = 500;
const by = (id) => document.getElementById(id);
let run = {}, socket = null, curves = [], quick = [], asked = null, rebuilt = -1;

function set(node, text) { if (node.textContent !== text) node.textContent = text; }
function number(value, digits = 3) { return Number.isFinite(value) ? Number(value.toPrecision(digits)).toString() : "–"; }

function build(count, revision) {
  curves = [];
  by("charts").replaceChildren();
  by("lamps").replaceChildren();
  for (let i = 0; i < count; ++i) {
    const name = (run.residuals || [])[i] || `residual ${i + 1}`;
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    const canvas = document.createElement("canvas"), lamp = document.createElement("li");
    canvas.setAttribute("role", "img");
    figure.append(caption, canvas);
    by("charts").append(figure);
    by("lamps").append(lamp);
    curves.push({ name, caption, canvas, lamp, points: [] });
  }
  by("targets").replaceChildren(...[...new Set([...(run.faults || []), ...(run.inputs || []), ...(run.outputs || [])])]
    .map((name) => { const option = document.createElement("option"); option.value = name; return option; }));
  quick = Object.entries(run.sizes || {}).map(([target, size]) => {
    const button = document.createElement("button");
    button.type = "button";
    button.dataset.target = target;
    button.addEventListener("click", () => ask(button.getAttribute("aria-pressed") === "true"
      ? { type: "clear", target } : { type: "inject", target, kind: "bias", value: size }));
    return { button, target, size };
  });
  by("quick").replaceChildren(...quick.map(({ button }) => {
    const item = document.createElement("li");
    item.append(button);
    return item;
  }));
  rebuilt = revision;
}

function draw(curve, style) {
  const { canvas, points } = curve, ratio = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, width, height);
  const top = 1.1 * Math.max(1e-12, ...points.map((p) => Math.max(p.greatest || 0, p.threshold || 0)));
  const x = (i) => (i + kPoints - points.length) * width / kPoints, y = (value) => height * (1 - value / top);
  pen.lineWidth = ratio;
  pen.strokeStyle = style.getPropertyValue("--fired");
  pen.setLineDash([6 * ratio, 4 * ratio]);
  pen.beginPath();
  points.forEach((p, i) => pen.lineTo(x(i), y(p.threshold)));
  pen.stroke();
  pen.setLineDash([]);
  pen.lineWidth = 1.5 * ratio;
  pen.strokeStyle = style.getPropertyValue("--curve");
  pen.beginPath();
  points.forEach((p, i) => { pen.lineTo(x(i), y(p.least)); pen.lineTo(x(i), y(p.greatest)); });
  pen.stroke();
}

function rows(body, lines) {
  while (body.rows.length > lines.length) body.deleteRow(-1);
  lines.forEach((line, r) => {
    const row = body.rows[r] || body.insertRow();
    line.forEach((text, c) => set(row.cells[c] || row.insertCell(), String(text)));
  });
}

function show(state) {
  set(by("connection"), state.running ? `${run.name || "bench"} is running` : "waiting for the bench");
  set(by("verdict"), state.verdict || "no verdict yet");
  by("verdict").className = state.kind || "";
  set(by("since"), state.since_s === undefined ? "" : `for ${state.since_s.toFixed(1)} s, since cycle ${state.since_cycle}`);
  const values = state.evaluation || [];
  if (values.length !== curves.length || rebuilt !== state.revision) build(values.length, state.revision);
  const style = getComputedStyle(document.documentElement);
  curves.forEach((curve, i) => {
    const is_fired = state.fired[i] === 1;
    if (state.running) {
      curve.points.push({ least: state.least[i] ?? values[i], greatest: state.greatest[i] ?? values[i], threshold: state.threshold[i] });
      if (curve.points.length > kPoints) curve.points.shift();
    }
    curve.lamp.className = is_fired ? "fired" : "";
    set(curve.lamp, `${curve.name}${is_fired ? " fires" : ""}`);
    const text = `${curve.name}: ${number(values[i])}, threshold ${number(state.threshold[i])}`;
    set(curve.caption, text);
    curve.canvas.setAttribute("aria-label", text);
    draw(curve, style);
  });
  rows(by("traffic"), state.traffic.map((t) => [t.name, t.bus, t.frames, `${number(t.period_ms)} ms`,
    t.due_ms > 0 ? `${number(t.due_ms)} ms` : "–", `${number(t.jitter_ms)} ms`, t.lost, t.bad]));
  rows(by("latency"), state.latency.map((l) => [l.stage, number(l.p50_us), number(l.p99_us), number(l.p999_us), number(l.max_us)]));
  const c = state.counters;
  set(by("counters"), c ? `frames ${c.frames}, dropped ${c.dropped}, bad samples ${c.bad_samples}, overruns ${c.overruns}, late cycles ${c.late_cycles}` : "");
  const injected = (state.injected || []).map((f) => `${f.kind} ${number(f.value)} on ${f.target}`);
  set(by("injected"), state.injected ? `acting: ${injected.join("; ") || "none"}` : "");
  const acting = new Set((state.injected || []).map((f) => f.target));
  for (const { button, target, size } of quick) {
    button.setAttribute("aria-pressed", String(acting.has(target)));
    set(button, acting.has(target) ? `clear ${target}` : `inject ${target} bias ${number(size)}`);
  }
  const answer = asked && state.events.find((e) => e.source === "inject" && e.text.startsWith(asked + ":"));
  if (answer) { set(by("answer"), answer.text.slice(asked.length + 2)); asked = null; }
}

function connect() {
  socket = new WebSocket(`ws://${location.host}/live${location.search}`);
  socket.onmessage = (event) => {
    const message = JSON.parse(event.data);
    if (message.type === "run") run = message;
    else if (message.type === "state") show(message);
    else if (message.type === "sent") { asked = message.request; set(by("answer"), "asked; waiting for the bench's answer"); }
    else if (message.type === "refused") set(by("answer"), message.text);
  };
  socket.onclose = () => {
    set(by("connection"), "connection lost: connecting again");
    setTimeout(connect, kReconnect_ms);
  };
}

function ask(request) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(request));
  else set(by("answer"), "not connected: nothing was sent");
}

by("inject").addEventListener("submit", (event) => {
  event.preventDefault();
  const request = { type: "inject", target: by("target").value, kind: by("kind").value };
  if (by("value").value !== "") request.value = Number(by("value").value);
  ask(request);
});
by("do-clear").addEventListener("click", () => ask({ type: "clear" }));
connect();
